"""G+Smo XML: labels, boundary conditions, functions and all else of a file survive; interface rows old and new."""

from __future__ import annotations

import re
import warnings

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import patchtransfer as pt
import real
from patchtransfer import InputError, InputWarning, Interface, MultiPatch, Patch, Side
from patchtransfer.geometry.blocks import renumbered
from patchtransfer.io import gismo
from strategies import multipatches

quick = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])

CONDITIONS = """<boundaryConditions multipatch='7' id="12">
  <!-- walls --> <Function type="FunctionExpr" dim="2" index="0">sin(x) &lt; 1</Function>
  <bc   name="inlet" type="Dirichlet" function="0" unknown="0"/>
  <bc type="Neumann" function="0" unknown="0">1 3
 0 3</bc><cv unknown="0" patch="0" corner="1">0</cv>
</boundaryConditions>"""
FUNCTION = '<Function id="13" type="FunctionExpr" dim="2">1 + 0*t</Function>'


def words(text: str) -> str:
    return " ".join(text.split())


def square(id_: int, x: float = 0, attributes: str = "", more: str = "") -> str:
    basis = '<Basis type="BSplineBasis"><KnotVector degree="1">0 0 1 1</KnotVector></Basis>'
    return (
        f'<Geometry type="TensorBSpline2" id="{id_}"{attributes}>'
        f'<Basis type="TensorBSplineBasis2">{basis}{basis}</Basis>'
        f'<coefs geoDim="2">{x} 0 {x + 1} 0 {x} 1 {x + 1} 1</coefs>{more}</Geometry>'
    )


def block(inside: str, patches: str = "0 1", attributes: str = 'id="7"') -> str:
    return f'<MultiPatch parDim="2" {attributes}><patches type="id_range">{patches}</patches>{inside}</MultiPatch>'


ROW = "<interfaces>0 2 1 1 0 1 1 1</interfaces>"
LABELS = (
    '<boundary name="inlet">0 1</boundary><boundary name="top &amp; tail">1 4\n0 4 0 3</boundary>'
    "<boundary>1 2</boundary>"
)
BOTH = square(0) + square(1, 1)


def parse(text: str) -> MultiPatch:
    return gismo.read_multipatch(f"<xml>{text}</xml>".encode())


def again(mp: MultiPatch) -> MultiPatch:
    return gismo.read_multipatch(gismo.format_multipatch(mp).encode())


# --- labels ---------------------------------------------------------------------------------------


def test_names_of_sides_are_read_and_written():
    mp = parse(BOTH + block(ROW + LABELS))
    assert dict(mp.sides) == {
        "inlet": ((0, Side.WEST),),
        "top & tail": ((1, Side.NORTH), (0, Side.NORTH), (0, Side.SOUTH)),
    }
    assert again(mp) == mp


def test_names_by_position_and_by_id():
    for rows in ("5 2 3 1 0 1 1 1", "0 2 1 1 0 1 1 1"):
        first = rows.split()[0]
        inside = f'<interfaces>{rows}</interfaces><boundary name="inlet">{first} 1</boundary>'
        text = f'<MultiPatch parDim="2"><patches type="id_index">5 3</patches>{inside}</MultiPatch>'
        assert parse(square(5) + square(3, 1) + text).sides["inlet"] == ((0, Side.WEST),)


def test_names_of_interfaces_name_both_sides():
    mp = parse(BOTH + block('<interfaces name="weld">0 2 1 1 0 1 1 1</interfaces>'))
    assert mp.sides["weld"] == ((0, Side.EAST), (1, Side.WEST))
    assert again(mp) == mp


@pytest.mark.filterwarnings("ignore:label .rim. is left out")
def test_one_side_of_an_interface_cannot_be_named_in_the_file():
    mp = parse(BOTH + block(ROW)).with_labels({"left of it": [(0, Side.EAST)], "rim": [(0, Side.WEST), (0, Side.EAST)]})
    with pytest.warns(InputWarning, match="label 'left of it' is left out on interface patch 0 east - patch 1 west"):
        text = gismo.format_multipatch(mp)
    assert dict(gismo.read_multipatch(text.encode()).sides) == {"rim": ((0, Side.WEST),)}


@pytest.mark.parametrize(
    ("rows", "message"), [("9 1", "does not exist"), ("0 5", "side of 1 to 4"), ("0 1 1", "side of 1 to 4")]
)
def test_bad_rows_of_a_label_are_an_error_that_names_it(rows, message):
    with pytest.raises(InputError, match=f"boundary 'inlet': .*{message}"):
        parse(BOTH + block(f'{ROW}<boundary name="inlet">{rows}</boundary>'))


@st.composite
def labelled(draw) -> MultiPatch:
    """A model with labels on its boundary, some sides in several and some in none, and blocks of all kinds."""
    mp = draw(multipatches())
    letters = st.characters(codec="utf-8", categories=("L", "N", "P", "S", "Zs"))
    names = draw(st.lists(st.text(letters, min_size=1, max_size=12).filter(str.strip), max_size=4, unique=True))
    sides = st.lists(st.sampled_from(mp.boundaries), max_size=6, unique=True)
    return mp.with_labels({name: draw(sides) for name in names})


@quick
@given(labelled())
def test_any_labels_survive_writing(mp):
    assert again(mp) == mp


def test_labels_that_no_file_can_hold_are_refused():
    mp = parse(BOTH + block(ROW)).with_labels({"a\x00b": [(0, Side.WEST)]})
    with pytest.raises(InputError, match=r"labels or blocks .*cannot be written as XML"):
        gismo.format_multipatch(mp)


# --- everything else ------------------------------------------------------------------------------

WHOLE = f"""<?xml version="1.0"?><!-- made by hand --><xml>
<!-- a plate -->{BOTH}{block(ROW + LABELS)}
 {CONDITIONS}
<OptionList id='14'><int label="n" value="3"/></OptionList>{FUNCTION}</xml>"""


def kept(mp: MultiPatch) -> list[str]:
    return [words(b.text) for b in mp.blocks if not b.kind.endswith("head")]


def test_other_elements_are_kept_word_for_word():
    mp = gismo.read_multipatch(WHOLE.encode())
    expected = [
        "<!-- made by hand -->",
        "<!-- a plate -->",
        CONDITIONS,
        '<OptionList id=\'14\'><int label="n" value="3"/></OptionList>',
        FUNCTION,
    ]
    assert kept(mp) == [words(text) for text in expected]
    text = gismo.format_multipatch(mp)
    places = [
        words(text).index(words(part))
        for part in (
            *expected[:2],
            '<Geometry type="TensorBSpline2" id="0">',
            '<MultiPatch parDim="2" id="7">',
            *expected[2:],
        )
    ]
    assert places == sorted(places)
    assert again(mp) == mp


def test_they_stay_through_all_that_makes_new_models():
    mp = gismo.read_multipatch(WHOLE.encode())
    moved = mp.with_control_points([p.control_points * 2 for p in mp.patches])
    frame = pt.morph(mp, moved, 3)[1]
    for other in (moved, mp.elevate(), mp.split_spans(2), mp.reduce_continuity(0), frame):
        assert kept(other) == kept(mp)
        assert other.sides == mp.sides
        assert again(other) == other


@quick
@given(
    multipatches(),
    st.lists(st.sampled_from([CONDITIONS, FUNCTION, "<!-- é -->", "<a/>", "<?go on?>", "stray"]), max_size=6),
    st.integers(0, 6),
)
def test_any_mixture_survives_in_its_order(mp, texts, split):
    text = gismo.format_multipatch(mp)
    start, end = text.index("<Geometry"), text.index("</xml>")
    text = "\n".join([text[:start], *texts[:split], text[start:end], *texts[split:], text[end:]])
    first = gismo.read_multipatch(text.encode())
    # Text that follows text is one.
    assert words(" ".join(kept(first))) == words(" ".join(texts))
    second = again(first)
    assert second == first
    assert again(second) == second


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_encodings(encoding):
    text = (
        f'<?xml version="1.0" encoding="{encoding.removesuffix("-sig")}"?><xml>{BOTH}{block(ROW)}<note>Öl</note></xml>'
    )
    mp = gismo.read_multipatch(text.encode(encoding))
    assert kept(mp) == ["<note>Öl</note>"]
    assert again(mp) == mp


def test_ids_of_others_are_not_taken():
    mp = parse(BOTH + FUNCTION + '<OptionList id="2"/>')
    text = gismo.format_multipatch(mp)
    assert '<MultiPatch parDim="2" id="14">' in text


def test_second_models_curves_and_solids_are_kept():
    knots = '<Basis type="BSplineBasis"><KnotVector degree="1">0 0 1 1</KnotVector></Basis>'
    curve = f'<Geometry type="BSpline" id="30">{knots}<coefs geoDim="2">0 0 1 0</coefs></Geometry>'
    other = square(40, 9) + '<MultiPatch parDim="2" id="41"><patches type="id_range">40 40</patches></MultiPatch>'
    with pytest.warns(InputWarning, match="2 MultiPatch blocks; the first is read, the others are kept"):
        mp = parse(BOTH + block(ROW) + curve + other)
    assert len(mp) == 2
    with pytest.warns(InputWarning, match="2 MultiPatch blocks"):
        assert again(mp) == mp
    assert kept(parse(square(0) + curve)) == [words(curve)]


def test_attributes_and_children_that_are_not_read_stay_on_their_elements():
    head = block(ROW + "<colour>red</colour>", attributes='id="7" label="wing"')
    mp = parse(square(0, 0, ' label="root &lt;1&gt;"', "<thick>2</thick>") + square(1, 1) + head)
    text = gismo.format_multipatch(mp)
    assert '<MultiPatch parDim="2" id="7" label="wing">' in text
    assert re.search('<Geometry [^>]*label="root &lt;1&gt;">', text)
    assert text.index("<thick>2</thick>") < text.index("</Geometry>")
    assert text.index("<colour>red</colour>") < text.index("</MultiPatch>")
    assert again(mp) == mp


def test_roots_attributes_and_namespaces_stay():
    text = f'<model xmlns:m="urn:m" version="2">{BOTH}{block(ROW)}<m:extra m:a="1"/></model>'
    mp = gismo.read_multipatch(text.encode())
    assert '<model xmlns:m="urn:m" version="2">' in gismo.format_multipatch(mp)
    assert again(mp) == mp
    assert kept(mp) == ['<m:extra m:a="1"/>']


def test_attributes_of_namespaces_stay_too():
    mp = parse(square(0, 0, ' xmlns:m="urn:m" m:a="1"') + square(1, 1) + block(ROW))
    assert 'xmlns:ns0="urn:m"' in gismo.format_multipatch(mp)
    assert again(mp) == mp


def test_data_of_patches_without_an_id_stay_on_them():
    text = square(0, 0, ' label="left"').replace(' id="0"', "") + square(0, 1, ' label="right"').replace(' id="0"', "")
    made = gismo.format_multipatch(parse(text))
    assert made.index('label="left"') < made.index('label="right"')
    assert gismo.read_multipatch(made.encode()) == parse(text)


def test_conditions_follow_split_and_dropped_patches():
    mp = gismo.read_multipatch(WHOLE.encode())
    # Patch 0 is halved along u into 0 and 1, patch 1 becomes 2 with u and v exchanged but loses its south side.
    west, east, south, north = Side
    parts = {
        (0, west): [(0, west)], (0, south): [(0, south), (1, south)], (0, north): [(0, north), (1, north)],
        (1, east): [(2, north)], (1, north): [(2, east)],
    }  # fmt: skip
    blocks, lost = renumbered(mp.blocks, parts)
    changed = words(next(b.text for b in blocks if b.kind == "boundaryConditions"))
    assert '<bc type="Neumann" function="0" unknown="0">0 3 1 3</bc>' in changed
    assert '<bc name="inlet" type="Dirichlet" function="0" unknown="0"/>' in changed
    assert lost == ["boundaryConditions id=12: patch 1 side 3 has a condition, and is there no more"]
    assert [b for b in blocks if b.kind != "boundaryConditions"] == [
        b for b in mp.blocks if b.kind != "boundaryConditions"
    ]


@pytest.mark.parametrize(("corner", "expected"), [(1, "no more"), (4, 'patch="2" corner="4"'), (3, "no more")])
def test_corner_values_follow_their_sides(corner, expected):
    parts = {(1, Side.EAST): [(2, Side.NORTH)], (1, Side.NORTH): [(2, Side.EAST)]}
    text = f'<boundaryConditions id="3"><cv unknown="0" patch="1" corner="{corner}">0</cv></boundaryConditions>'
    (block_,), lost = renumbered([pt.Block("G+Smo XML", "boundaryConditions", text)], parts)
    if expected == "no more":
        assert block_.text == text
        assert lost == [f"boundaryConditions id=3: the value at corner {corner} of patch 1 keeps its old numbers"]
    else:
        assert expected in block_.text
        assert not lost


def test_comments_inside_patches_are_kept_too():
    mp = parse(square(0).replace("<coefs", "<!-- from the wind tunnel --><coefs"))
    assert kept(mp) == ["<!-- from the wind tunnel -->"]


def test_blocks_that_are_not_xml_are_refused():
    mp = parse(BOTH + block(ROW))
    broken = MultiPatch(mp.patches, mp.interfaces, blocks=[pt.Block("G+Smo XML", "note", "<a>")])
    with pytest.raises(InputError, match=r"blocks .note. cannot be written as XML"):
        gismo.format_multipatch(broken)


def test_functions_of_the_place_are_known():
    mp = gismo.read_multipatch(WHOLE.encode())
    assert [b.name for b in mp.blocks if b.of_place] == ["boundaryConditions id=12"]


# --- interfaces -----------------------------------------------------------------------------------


def old_rows(text: str) -> str:
    """A file with interface rows of five numbers."""

    def shorten(match):
        rows = [row.split() for row in match[1].strip().splitlines()]
        # The flag along the first side is the last but one if that runs along u.
        rows = [[*row[:4], row[6] if int(row[1]) > 2 else row[7]] for row in rows]
        return "<interfaces>" + "\n".join(map(" ".join, rows)) + "</interfaces>"

    return re.sub(r"<interfaces>(.*?)</interfaces>", shorten, text, flags=re.S)


@quick
@given(multipatches())
def test_rows_of_five_are_rows_of_eight(mp):
    assert gismo.read_multipatch(old_rows(gismo.format_multipatch(mp)).encode()) == mp


def strip(n: int) -> MultiPatch:
    """A row of n + 1 unit squares."""
    knots = ([0, 0, 1, 1], [0, 0, 1, 1])
    return MultiPatch([Patch(knots, (1, 1), [[[x, 0], [x, 1]], [[x + 1, 0], [x + 1, 1]]]) for x in range(n + 1)])


@pytest.mark.parametrize("n", [5, 8, 40, 16])
def test_tables_that_could_be_rows_of_either_length(n):
    mp = strip(n)
    text = gismo.format_multipatch(mp)
    assert len(mp.interfaces) == n
    assert gismo.read_multipatch(text.encode()) == mp
    assert gismo.read_multipatch(old_rows(text).encode()) == mp


def test_eight_old_rows_whose_numbers_would_do_as_five_new_ones():
    # Read as rows of 8 all patches, sides and flags exist as well; only in rows of 5 do the sides coincide.
    rows = "0 2 1 1 0 1 2 2 1 0 2 2 3 1 0 3 2 4 1 0 4 2 5 1 0 5 2 6 1 0 6 2 7 1 0 7 2 8 1 0"
    patches = "".join(square(k, k) for k in range(9))
    mp = parse(patches + block(f"<interfaces>{rows}</interfaces>", "0 8"))
    assert len(mp.interfaces) == 8


def test_a_file_whose_topology_was_never_computed():
    listed = " ".join(f"{k} {s}" for k in (0, 1) for s in (1, 2, 3, 4))
    with pytest.warns(InputWarning, match="all sides are listed as boundary, .* found where sides coincide: 1"):
        mp = parse(BOTH + block(f"<boundary>{listed}</boundary>"))
    assert mp.interfaces == (Interface(0, Side.EAST, 1, Side.WEST, False),)
    with pytest.warns(InputWarning, match="all sides are listed as boundary"):
        assert parse(BOTH + block(f"<interfaces> </interfaces><boundary>{listed}</boundary>")) == mp
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        apart = f'<interfaces rows="0"></interfaces><boundary>{listed}</boundary>'
        assert parse(BOTH + block(apart)).interfaces == ()
        assert parse(square(0) + square(1, 5) + block(f"<boundary>{listed}</boundary>")).interfaces == ()


def test_sides_that_nearly_fit_are_left_apart_with_the_mend():
    with pytest.warns(
        InputWarning,
        match=r"control points are 0.001 apart .*left apart; `patchtransfer refine --conform --weld 0.001`",
    ):
        assert parse(square(0) + square(1, 1.001) + block(ROW)).interfaces == ()
    finer = square(1, 1).replace(">0 0 1 1</KnotVector></Basis></Basis>", ">0 0 .5 1 1</KnotVector></Basis></Basis>")
    finer = finer.replace("1 0 2 0 1 1 2 1", "1 0 2 0 1 .5 2 .5 1 1 2 1")
    with pytest.warns(InputWarning, match="knots differ: 1 and 2 spans: left apart; `patchtransfer refine --conform`"):
        assert parse(square(0) + finer + block(ROW)).interfaces == ()


# --- weights --------------------------------------------------------------------------------------


def rational(id_: int, x: float, weights: str) -> str:
    text = square(id_, x).replace('"TensorBSpline2"', '"TensorNurbs2"')
    return text.replace(
        '<Basis type="TensorBSplineBasis2">', '<Basis type="TensorNurbsBasis2"><Basis type="TensorBSplineBasis2">'
    ).replace("</Basis><coefs", f"</Basis><weights>{weights}</weights></Basis><coefs")


@pytest.mark.parametrize("weights", ["1 1 1 1", "0.3 .3 3e-1 0.3"])
def test_equal_weights_are_polynomial(weights):
    mp = parse(square(0) + rational(1, 1, weights) + block(ROW))
    assert mp == parse(BOTH + block(ROW))


def test_weights_equal_but_for_rounding_are_polynomial_with_a_warning():
    with pytest.warns(InputWarning, match="weights of Geometry id=1 .* equal but for rounding; read as polynomial"):
        assert not parse(square(0) + rational(1, 1, "1 1 0.9999999999999998 1") + block(ROW)).is_rational
    assert parse(square(0) + rational(1, 1, "1 1 0.99999999999 1") + block(ROW)).is_rational


# --- other programs and real files ----------------------------------------------------------------


def test_gismo_reads_labels_and_conditions_of_what_we_write(tmp_path):
    pygismo = pytest.importorskip("pygismo")
    mp = gismo.read_multipatch(WHOLE.encode()).elevate()
    pt.write(mp, tmp_path / "ours.xml")
    data = pygismo.io.gsFileData(str(tmp_path / "ours.xml"))
    model, conditions = pygismo.core.gsMultiPatch(), pygismo.pde.gsBoundaryConditions()
    data.getId(7, model)
    data.getId(12, conditions)
    assert model.nPatches() == 2
    # One side by its label, two by number, and a corner.
    assert re.findall(r"[:=] *(\d+)", str(conditions)) == ["1", "2", "1"]


@real.needed
@pytest.mark.parametrize("folder", ["gismo", "unstructured", "splinepy"])
def test_real_files_survive(folder, tmp_path):
    files = [
        f for f in sorted((real.path("x").parent / "real" / folder).glob("*.xml")) if b"Geometry" in f.read_bytes()
    ]
    if not files:
        pytest.skip("no such models")
    for file in files:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            if b'geoDim="3"' in file.read_bytes() or b"<PlanarDomain" in file.read_bytes():
                continue
            mp = pt.read(file)
            pt.write(mp, tmp_path / "out.xml")
            assert pt.read(tmp_path / "out.xml") == mp, file
