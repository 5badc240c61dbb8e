"""G+Smo XML: round trips, real-file oddities, chaining of boundaries, refusals, other programs."""

from __future__ import annotations

import base64
import re
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import patchtransfer as pt
import real
from other_programs import gismo_model, gismo_sides, glued_sides
from patchtransfer import Boundary, BSplineCurve, InputError, Interface, MultiPatch, Patch, Side
from patchtransfer.io import gismo
from patchtransfer.io.loops import chain, clamp
from strategies import boundaries, curves, multipatches, patches

quick = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def save(folder: Path, text: str | bytes, name: str = "model.xml") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def basis(*knots: str, degree: int = 1) -> str:
    inner = "".join(f'<Basis type="BSplineBasis"><KnotVector degree="{degree}">{k}</KnotVector></Basis>' for k in knots)
    return inner if len(knots) == 1 else f'<Basis type="TensorBSplineBasis{len(knots)}">{inner}</Basis>'


def square(id_: int, x: float = 0, knots: str = "0 0 1 1", coefs: str | None = None, geo: int = 2) -> str:
    coefs = coefs or f"{x} 0 {x + 1} 0 {x} 1 {x + 1} 1"
    head = f'<Geometry type="TensorBSpline2" id="{id_}">{basis(knots, knots)}'
    return f'{head}<coefs geoDim="{geo}">{coefs}</coefs></Geometry>'


def block(patches: str, interfaces: str = "", boundary: str = "", kind: str = "id_range") -> str:
    return (
        f'<MultiPatch parDim="2" id="99"><patches type="{kind}">{patches}</patches>'
        f"<interfaces>{interfaces}</interfaces><boundary>{boundary}</boundary></MultiPatch>"
    )


def curve(coefs: str, knots: str = "0 0 1 1", degree: int = 1, geo: int = 2) -> str:
    head = f'<Geometry type="BSpline">{basis(knots, degree=degree)}'
    return f'{head}<coefs geoDim="{geo}">{coefs}</coefs></Geometry>'


def parse(*parts: str) -> MultiPatch:
    return gismo.read_multipatch(f"<xml>{''.join(parts)}</xml>".encode())


def parse_boundary(*parts: str) -> Boundary:
    return gismo.read_boundary(f"<xml>{''.join(parts)}</xml>".encode())


# --- round trips ----------------------------------------------------------------------------------


@quick
@given(multipatches())
def test_a_multipatch_survives_writing_to_the_bit(mp):
    assert gismo.read_multipatch(gismo.format_multipatch(mp).encode()) == mp


@quick
@given(patches(), st.integers(0, 9))
def test_any_single_patch_survives_writing_to_the_bit(patch, id_):
    mp = MultiPatch([patch], (), [id_])
    assert gismo.read_multipatch(gismo.format_multipatch(mp).encode()) == mp


@quick
@given(boundaries())
def test_a_boundary_survives_writing_to_the_bit(boundary):
    assert gismo.read_boundary(gismo.format_boundary(boundary).encode()) == boundary


@quick
@given(multipatches(), st.data())
def test_stated_and_inferred_interfaces_agree(mp, data):
    text = re.sub(r"<interfaces>.*?</interfaces>|<boundary>.*?</boundary>", "", gismo.format_multipatch(mp), flags=re.S)
    assert gismo.read_multipatch(text.encode()).interfaces == mp.interfaces


def test_touching_patches_stay_apart_if_the_file_says_so():
    both = [s.control_points for s in parse(square(0), square(1, 1)).patches]
    knots = ([0, 0, 1, 1], [0, 0, 1, 1])
    mp = MultiPatch([Patch(knots, (1, 1), c) for c in both], interfaces=())
    assert gismo.read_multipatch(gismo.format_multipatch(mp).encode()).interfaces == ()


@real.needed
@pytest.mark.parametrize(("name", "counts"), [("yeti", (21, 24, 5)), ("turtle", (15, 22, 1)), ("disc", (5, 8, 1))])
def test_real_models_are_read_fast_and_written_back(tmp_path, name, counts):
    path = real.path(name)
    mp = pt.read(path)
    assert (len(mp), len(mp.interfaces), len(mp.loops)) == counts
    pt.write(mp, tmp_path / "out.xml")
    assert pt.read(tmp_path / "out.xml") == mp
    boundary = pt.read_boundary(path)
    assert [len(loop) for loop in boundary.loops] == [len(loop) for loop in mp.loops]
    pt.write(boundary, tmp_path / "boundary.xml")
    assert pt.read_boundary(tmp_path / "boundary.xml") == boundary
    best = min(_seconds(lambda: pt.read(path)) for _ in range(5))
    assert best < 0.03


def _seconds(work) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


# --- oddities of real files -----------------------------------------------------------------------


def test_blanks_before_the_declaration_fractions_and_flat_space(tmp_path):
    coefs = "0 0 0  2/5 0 0.0  0 1/3 -0  2/5 1/3 0"
    mp = pt.read(
        save(
            tmp_path,
            f'\n \t<?xml version="1.0"?>\n<xml>{square(4, coefs=coefs, knots="0 0 1/3 1/3", geo=3)}</xml>',
        )
    )
    assert mp.ids == (4,)
    assert mp.patches[0].control_points[1, 1].tolist() == [2 / 5, 1 / 3]
    assert mp.patches[0].knots[0][-1] == 1 / 3


def test_mixed_rational_patches_and_degrees():
    left = square(1)
    right = (
        '<Geometry type="TensorNurbs2" id="2"><Basis type="TensorNurbsBasis2">'
        '<Basis type="TensorBSplineBasis2">'
        '<Basis type="BSplineBasis"><KnotVector degree="2">0 0 0 1 1 1</KnotVector></Basis>'
        '<Basis type="BSplineBasis"><KnotVector degree="1">0 0 1 1</KnotVector></Basis></Basis>'
        "<weights>1 2 3 4 5 6</weights></Basis>"
        '<coefs geoDim="2">1 0 2 0 3 0 1 1 2 1 3 1</coefs></Geometry>'
    )
    mp = parse(left, right, block("1 2"))
    assert mp.patches[1].degrees == (2, 1)
    assert mp.patches[1].weights.tolist() == [[1, 4], [2, 5], [3, 6]]
    assert mp.interfaces == (Interface(0, Side.EAST, 1, Side.WEST, False),)


@pytest.mark.parametrize("rows", ["7 2 3 1 0 1 1 1", "0 2 1 1 0 1 1 1"], ids=["by id", "by position"])
@pytest.mark.parametrize("across", ["1", "0"])
def test_interfaces_by_id_and_by_position(rows, across):
    rows = rows[:-3] + across + rows[-2:]
    mp = parse(square(7), square(3, 1), block("7 3", rows, kind="id_index"))
    assert mp.ids == (7, 3)
    assert mp.interfaces == (Interface(0, Side.EAST, 1, Side.WEST, False),)


def test_positions_that_are_ids_too_are_told_apart_by_the_geometry():
    # 1 and 2 are ids, but only as positions do these sides coincide.
    mp = parse(square(1), square(2, 5), square(3, 6), block("1 3", "1 2 2 1 0 1 1 1"))
    assert mp.interfaces == (Interface(1, Side.EAST, 2, Side.WEST, False),)


def test_the_first_of_several_blocks_is_read_with_a_warning():
    with pytest.warns(UserWarning, match="2 MultiPatch blocks"):
        mp = parse(square(0), square(1, 1), block("1 1"), block("0 0"))
    assert mp.ids == (1,)


def test_base64_numbers_and_coordinates_one_after_another():
    encoded = base64.b64encode(np.array([0, 0, 1, 1], "<f8").tobytes()).decode()
    text = square(0).replace('degree="1">0 0 1 1<', f'degree="1" format="B64Float64">{encoded}<')
    text = re.sub(r'geoDim="2">[^<]*', 'geoDim="2" order="coordinates">0 1 0 1 0 0 1 1', text)
    assert parse(text) == parse(square(0))


def test_unclamped_knots_are_clamped_exactly():
    mp = parse(
        square(0, knots="-1 0 1 2"),
    )
    assert mp.patches[0].knots[0].tolist() == [0, 0, 1, 1]
    assert np.array_equal(mp.patches[0].control_points, parse(square(0)).patches[0].control_points)


@quick
@given(curves(rational=False), st.integers(0, 2), st.integers(0, 2))
def test_clamping_undoes_unclamping(c, left, right):
    """Removing the ends of a refined clamped curve leaves unclamped knots of the same curve on less."""
    p = c.degree
    a, b = c.domain
    inner = a + (b - a) * np.linspace(0.05, 0.95, 4 * p + 5)
    fine = c.insert_knots(np.setdiff1d(inner, c.knots))
    first, last = p + 1 + left, p + 1 + right
    knots, points = fine.knots[first:-last], fine.control_points[first:-last]
    clamped, coefficients = clamp(knots, p, points)
    again = BSplineCurve(clamped, p, coefficients)
    t = np.linspace(*again.domain, 31)
    assert again.domain == (knots[p], knots[-p - 1])
    assert np.abs(again(t) - c(t)).max() <= 1e-9 * max(1.0, np.abs(c.control_points).max())


# --- boundaries -----------------------------------------------------------------------------------

TRIANGLE = [curve("0 0 1 0"), curve("1 0 1 1"), curve("1 1 0 0")]


@quick
@given(boundaries(), st.randoms(use_true_random=False), st.floats(0, 2e-7))
def test_shuffled_reversed_and_slightly_torn_curves_are_chained(boundary, random, tear):
    loose = []
    for loop in boundary.loops:
        for c in loop:
            points = c.control_points.copy()
            points[0] += tear
            torn = BSplineCurve(c.knots, c.degree, points, c.weights)
            loose.append(torn.reversed() if random.random() < 0.5 else torn)
    random.shuffle(loose)
    loops = chain([f"curve {i}" for i in range(len(loose))], loose, 1e-6 * boundary.diameter)
    for loop in loops:
        for c, following in zip(loop, loop[1:] + loop[:1], strict=True):
            assert np.array_equal(c.end, following.start)
    expected = sorted(
        sorted(round(float(c(c.domain[0] * 0.5 + c.domain[1] * 0.5)[0]), 5) for c in x) for x in boundary.loops
    )
    got = sorted(sorted(round(float(c(c.domain[0] * 0.5 + c.domain[1] * 0.5)[0]), 5) for c in x) for x in loops)
    assert [len(x) for x in got] == [len(x) for x in expected]
    assert np.allclose(np.concatenate(got), np.concatenate(expected), atol=3e-5)


def test_loose_curves_in_any_order_and_planar_domains(tmp_path):
    parts = [curve("0 0 1 0"), curve("0 1 1 1"), curve("1 0 1 1"), curve("0 0 0 1")]
    loops = parse_boundary(*parts).loops
    assert [c.start.tolist() for c in loops[0]] == [[0, 0], [1, 0], [1, 1], [0, 1]]
    domain = f"<PlanarDomain><CurveLoop>{''.join(parts)}</CurveLoop></PlanarDomain>"
    assert parse_boundary(domain).loops == loops
    assert parse_boundary(square(0)) == parse(square(0)).boundary()


def test_a_closed_unclamped_curve_is_a_loop():
    ring = "0 0 1 0 1 1 0 1 0 0 1 0"
    boundary = parse_boundary(curve(ring, "-2 -1 0 1 2 3 4 5 6", degree=2))
    (c,) = boundary.loops[0]
    assert c.domain == (0, 4)
    assert np.array_equal(c.start, c.end)
    assert np.allclose(c(0.0), [0.5, 0.0])


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([curve("0 0 1 0"), curve("1 0 1 1"), curve("1 1 .1 0")], r"Geometry number \d.*is open.*0\.1 away"),
        ([curve("0 0 1 0")], "is open"),
        ([curve("0 0 1 0"), curve("1 0 0 0")], "number 2.*repeats.*number 1"),
        ([*TRIANGLE, curve("0 0 -1 1")], r"meet at \(0, 0\)"),
        (
            [*TRIANGLE, curve("0 0 -1 0"), curve("-1 0 -1 1"), curve("-1 1 0 0")],
            r"meet at \(0, 0\)",
        ),
        ([curve("0 0 1 0 1 1 0 0", "0 0 1 2 3 3"), square(0)], "both patches and loose curves"),
        (["<PlanarDomain/>"], "no CurveLoop"),
        (["<PlanarDomain/><PlanarDomain/>"], "2 planar domains"),
        ([curve("0 0 1 1 0 1", geo=3), curve("1 0 0 0")], "lies in space"),
        (
            ["<PlanarDomain><CurveLoop>", *TRIANGLE, *(curve(c) for c in ("5 0 6 0", "6 0 6 1", "6 1 5 0")),
             "</CurveLoop></PlanarDomain>"],
            "form 2 loops",
        ),
    ],
)  # fmt: skip
def test_bad_boundaries_name_the_curve(parts, message):
    with pytest.raises(InputError, match=message):
        parse_boundary(*parts)


@pytest.mark.parametrize("around", ["", "<PlanarDomain><CurveLoop>{}</CurveLoop></PlanarDomain>"])
def test_slips_of_loops_are_mended_unless_told_not_to(tmp_path, around):
    parts = [curve("0 0 1 0"), curve("1 1e-4 1 1"), curve("1 1 0 1e-4"), curve("0 1e-4 0 0"), curve("2 2 2 2")]
    path = tmp_path / "outline.xml"
    path.write_text("<xml>" + (around or "{}").replace("{}", "".join(parts)) + "</xml>")
    boundary = pt.read_boundary(path)
    assert [len(loop) for loop in boundary.loops] == [3]
    told = " ".join(boundary.notes)
    assert all(word in told for word in ("no length", "closed a gap of 0.0001", "sliver of 0.0001"))
    with pytest.raises(InputError, match="no length"):
        pt.read_boundary(path, clean=False)


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<xml>\n<a>\n</xml>", r"malformed XML at line 3"),
        ("\n\n<xml>\n<a>\n</xml>", r"malformed XML at line 5"),
        ("<xml></xml>", "no Geometry"),
        ('<!DOCTYPE xml><xml></xml>', "DOCTYPE"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><xml>&a;</xml>', "DOCTYPE"),
        (curve("0 0 1 1"), "only curves"),
        (square(0, coefs="0 0 1 0 0 1 1"), "7 numbers.*need 8"),
        (square(0, coefs="0 0 1 0 0 1 1 1 1"), "9 numbers.*need 8"),
        (square(0, coefs="0 0 1 0 0 1 1 nan"), "number 8 .nan. in <coefs>"),
        (square(0, coefs="0 0 1 0 0 1 1 1e999"), "number 8 .inf. in <coefs>"),
        (square(0, coefs="0 0 1 0 0 1 1 1/0"), "'1/0'.*not a number"),
        (square(0, coefs="0 0 1 0 0 1 1 1_0"), "'1_0'.*not a number"),
        (square(0, coefs="0 0 1 0 0 1 1 x"), "Geometry id=0.*'x'.*not a number"),
        (square(0, knots="0 0 1 .5"), "decrease at number 4"),
        (square(0, knots="0 0 1"), "too few"),
        (square(0, knots="0 0 0 0"), "spans nothing"),
        (square(0).replace('degree="1"', 'degree="0"'), "degree 0"),
        (square(0).replace('degree="1"', 'degree="one"'), "'one' is not a whole number"),
        (square(0).replace(' degree="1"', ""), "no attribute degree"),
        (square(0, geo=3, coefs="0 0 0 1 0 0 0 1 0 1 1 1"), "lies in space"),
        (square(0, geo=1, coefs="0 1 2 3"), "geoDim 1"),
        (square(0).replace("TensorBSpline2", "THBSpline2"), "hierarchical"),
        (square(0).replace('"TensorBSpline2"', '"TensorBSpline3"'), "volumes"),
        (square(0).replace('"TensorBSpline2"', '"Mesh"'), "type Mesh is not supported"),
        (square(0) + square(0, 1) + block("0 0"), "two geometries have the id 0"),
        (square(0) + block("0 4000000000"), "there are 1 geometries"),
        (square(0) + block("5", kind="id_index"), "no Geometry with id 5"),
        (square(0) + block("0 0", kind="other"), "id_range"),
        (square(0) + block("0 0").replace('parDim="2"', 'parDim="3"'), "parDim 3"),
        (square(0) + square(1, 1) + block("0 1", "0 2 1 1 0 1"), "rows of 8"),
        (square(0) + square(1, 1) + block("0 1", "0 2 9 1 0 1 1 1"), "no patch 9"),
        (square(0) + square(1, 1) + block("0 1", "0 5 1 1 0 1 1 1"), "side is not"),
        (square(0) + square(1, 3) + block("0 1", "0 2 1 1 0 1 1 1"), "apart"),
        (square(0).replace("</coefs>", "</coefs><transform/>"), "transform"),
        (square(0).replace("TensorBSpline2", "TensorNurbs2"), "<weights> is missing"),
        (
            square(0).replace("TensorBSpline2", "TensorNurbs2").replace(
                "</Basis><coefs", "<weights>1 1 0 1</weights></Basis><coefs"
            ),
            "weight 0 is not positive",
        ),
        (square(0).replace('<coefs geoDim="2">', '<coefs geoDim="2" format="b65">'), "unknown number format"),
        (b"<xml>\xff\xfe</xml>", "malformed|not readable"),
        (b'<?xml version="1.0" encoding="klingon"?><xml/>', "malformed|not readable"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_in_one_line(tmp_path, text, message):
    if isinstance(text, str) and "<xml>" not in text:
        text = f"<xml>{text}</xml>"
    path = save(tmp_path, text)
    with pytest.raises(InputError, match=message) as caught:
        pt.read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


# --- other programs -------------------------------------------------------------------------------


def _uv(patch: Patch, count: int = 7) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(k[0], k[-1], count) for k in patch.knots])


def _values(patch: Patch, uv: np.ndarray) -> np.ndarray:
    return np.array([patch(*point) for point in uv])


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(multipatches())
def test_gismo_reads_what_we_write_and_we_what_it_writes(tmp_path, mp):
    pygismo = pytest.importorskip("pygismo")
    pt.write(mp, tmp_path / "ours.xml")
    theirs = gismo_model(tmp_path / "ours.xml")
    assert theirs.nPatches() == len(mp)
    for k, patch in enumerate(mp.patches):
        uv = _uv(patch)
        assert np.allclose(theirs.patch(k).eval(uv.T).T, _values(patch, uv), atol=1e-13)
    assert gismo_sides(theirs) == glued_sides(mp)
    out = pygismo.io.gsFileData()
    out.setFloatPrecision(17)
    out.add(theirs)
    out.save(str(tmp_path / "theirs"))
    back = pt.read(tmp_path / "theirs.xml")
    for a, b in zip(back.patches, mp.patches, strict=True):
        assert np.array_equal(a.control_points, b.control_points)
    assert glued_sides(back) == glued_sides(mp)


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(multipatches(), st.booleans())
def test_splinepy_reads_what_we_write_and_we_what_it_writes(tmp_path, mp, as_base64):
    splinepy = pytest.importorskip("splinepy")
    ours, theirs = tmp_path / "ours.xml", tmp_path / "theirs.xml"
    # splinepy knows ranges of ids only.
    mp = MultiPatch(mp.patches, mp.interfaces, range(100, 100 + len(mp)))
    pt.write(mp, ours)
    loaded = splinepy.io.gismo.load(str(ours))[0]
    for spline, patch in zip(loaded.patches, mp.patches, strict=True):
        uv = _uv(patch)
        assert np.allclose(spline.evaluate(uv), _values(patch, uv), atol=1e-12)
    loaded.determine_interfaces()
    splinepy.io.gismo.export(str(theirs), loaded, as_base64=as_base64)
    back = pt.read(theirs)
    for a, b in zip(back.patches, mp.patches, strict=True):
        uv = _uv(b)
        assert np.allclose(_values(a, uv), _values(b, uv), atol=1e-12)
    assert glued_sides(back) == glued_sides(mp)
