"""GeoPDEs text: what it means, round trips, labels and names, refusals, told apart from lists of points."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import NdBSpline

import patchtransfer as pt
import real
from patchtransfer import Boundary, InputError, InputWarning, MultiPatch, Patch, Side
from patchtransfer.geometry.blocks import Block
from patchtransfer.io import geopdes
from shapes import bicubic, quad
from strategies import multipatches

quick = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])

RING = """\
# nurbs geometry v.1.0
# a quarter of a ring
2 2 1
1 2
2 3
0 0 1 1
0 0 0 1 1 1
1 2 0.7071067811865476 1.4142135623730951 0 0
0 0 0.7071067811865476 1.4142135623730951 1 2
1 1 0.7071067811865476 0.7071067811865476 1 1
"""

#: Patch 2 is patch 1's neighbour in the north, turned: its west side is their interface, run against patch 1.
TURNED = """\
#  nurbs mesh v.2.1
# an L
#
2 2 3 2 2

lower left
1 1
2 2
0 0 1 1
0 0 1 1
# x, y, weights
-1 0 -1 0
-1 -1 0 0
1 1 1 1
PATCH 2
1 1
2 2
0 0 1 1
0 0 1 1
0 0 -1 -1
0 1 0 1
1 1 1 1
PATCH 3
1 1
2 2
0 0 1 1
0 0 1 1
0 1 0 1
0 0 1 1
1 1 1 1
INTERFACE 1
1 4
2 1
{sense}
weld
2 3
3 1
1
SUBDOMAIN 1
1 3
steel
2
inflow
2
1 1
2 4
BOUNDARY 2
1
1 3
empty
0
"""


def parse(text: str) -> MultiPatch:
    return geopdes.read_multipatch(text.encode())


def silent(mp: MultiPatch) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return geopdes.format_multipatch(mp)


def test_coordinates_are_multiplied_by_their_weights():
    patch = parse(RING)[0]
    for radius in (1.0, 2.0):
        points = patch.grid([radius - 1], np.linspace(0, 1, 9))[0]
        np.testing.assert_allclose(np.hypot(*points.T), radius, atol=1e-15)
    assert pt.certify(parse(RING)).injective


def test_a_turned_patch_with_names_and_comments():
    mp = parse(TURNED.format(sense=-1))
    assert mp[1](0.25, 1.0).tolist() == [-1.0, 0.25]
    glued = {(f.patch_a, f.side_a, f.patch_b, f.side_b, f.reversed) for f in mp.interfaces}
    assert glued == {(0, Side.NORTH, 1, Side.WEST, True), (1, Side.SOUTH, 2, Side.WEST, False)}
    assert dict(mp.sides) == {
        "inflow": ((0, Side.WEST), (1, Side.NORTH)),
        "BOUNDARY 2": ((0, Side.SOUTH),),
        "empty": (),
    }
    assert [(b.kind, b.text) for b in mp.blocks] == [
        ("comment", "an L"),
        ("patch names", "lower left\nPATCH 2\nPATCH 3"),
        ("interface names", "INTERFACE 1\nweld"),
        ("subdomain", "SUBDOMAIN 1\n1 3"),
        ("subdomain", "steel\n2"),
    ]
    assert {b.format for b in mp.blocks} == {"GeoPDEs"}


def test_a_wrong_sense_is_named():
    with pytest.raises(InputError, match=r"patch 0 north - patch 1 west.* 1 apart .*leave the interfaces out"):
        parse(TURNED.format(sense=1))


@pytest.mark.parametrize(
    ("header", "old"),
    [
        ("# nurbs mesh v.0.7\n2 1 0 1\n", True),
        ("# nurbs geometry v.0.6\n2 1\n", True),
        ("2 1\n", True),
        ("2 2\n", False),
        ("# nurbs geometry v.1.0\n2 2 1\n", False),
        ("# nurbs mesh v.2.1\n2 2 1 0 1\n", False),
    ],
)
def test_headers_of_all_versions(header, old):
    subdomain = "all\n1\n" if header.endswith(" 1\n") and len(header.split("\n")[-2].split()) > 3 else ""
    mp = parse(header + "PATCH 1\n" + "\n".join(RING.splitlines()[3:]) + "\n" + subdomain)
    assert mp[0].shape == (2, 3)
    assert len(mp.blocks) == bool(subdomain)
    assert geopdes.looks_like_geopdes(header.encode() + b"PATCH 1\n")


@pytest.mark.parametrize(
    "text",
    ["# nurbs\n2 2\n3 4\n0 1\n", "2 2\n3 4\n0 1\n", "x,y\n0,0\n1,0\n1,1\n", "1,0\nn,o\n", "# nurbs v1.0\n0.5 1\n"],
)
def test_points_are_no_geometry(text):
    assert not geopdes.looks_like_geopdes(text.encode())


def test_content_tells_geometries_from_points(tmp_path):
    (tmp_path / "a.txt").write_text(RING)
    (tmp_path / "b.txt").write_text("# outline\n2 2\n3 2\n3 4\n")
    assert len(pt.read(tmp_path / "a.txt")) == 1
    assert len(pt.read_boundary(tmp_path / "a.txt").loops[0]) == 4
    assert len(pt.read_boundary(tmp_path / "b.txt").loops[0]) == 3
    with pytest.raises(InputError, match="CSV file holds no patches"):
        pt.read(tmp_path / "b.txt")


def one_by_one(mp: MultiPatch) -> None:
    """Compare patches with what is written of them, read by another route: SciPy's splines in three coordinates."""
    lines = [line for line in silent(mp).splitlines() if not line.startswith("#")][1:]
    for patch in mp:
        _, degrees, counts, u, v, *rows = (lines.pop(0) for _ in range(8))
        n, m = map(int, counts.split())
        net = np.array([list(map(float, row.split())) for row in rows]).reshape(3, m, n).transpose(2, 1, 0)
        knots = [np.array(list(map(float, t.split()))) for t in (u, v)]
        spline = NdBSpline(tuple(knots), net, tuple(map(int, degrees.split())))
        at = [np.linspace(t[0], t[-1], 7) for t in knots]
        values = spline(np.stack(np.meshgrid(*at, indexing="ij"), axis=-1))
        size = np.abs(patch.control_points).max() or 1.0
        np.testing.assert_allclose(values[..., :2] / values[..., 2:], patch.grid(*at), atol=1e-12 * size)


@quick
@given(multipatches())
def test_models_survive_writing(mp):
    labelled = mp.with_labels({f"side {k}": [side] for k, side in enumerate(mp.boundaries)})
    read = parse(silent(labelled))
    size = max(np.abs(patch.control_points).max() for patch in mp)
    for patch, other in zip(mp, read, strict=True):
        assert all(map(np.array_equal, patch.knots, other.knots))
        assert np.abs(patch.control_points - other.control_points).max() <= 1e-15 * size
    assert (read.interfaces, read.sides) == (mp.interfaces, labelled.sides)
    assert parse(silent(read)) == read
    one_by_one(labelled)


def test_weights_that_are_equal_up_to_rounding_are_none():
    text = silent(MultiPatch([quad((0, 0), (1, 0), (1, 1), (0, 1))]))
    scaled = text.replace("1.0 1.0 1.0 1.0\nBOUNDARY", "2.0 2.0000000000000004 2.0 2.0\nBOUNDARY")
    assert parse(scaled)[0].weights is None
    assert parse(scaled)[0](1.0, 1.0).tolist() == [0.5, 0.5]
    assert parse(silent(MultiPatch([bicubic(0, weights=True)])))[0].weights is not None


def test_names_and_subdomains_are_written_back():
    mp = parse(TURNED.format(sense=-1))
    again = parse(silent(mp))
    assert again.blocks == mp.blocks
    assert {name: again.sides[name] for name in mp.sides} == dict(mp.sides)
    # Sides that have no label are boundaries one by one.
    assert set(again.sides) - set(mp.sides) == {f"BOUNDARY {k}" for k in (4, 5, 6, 7, 8)}


def test_interfaces_are_found_where_the_file_is_silent_and_not_where_it_denies_them():
    squares = MultiPatch([quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((1, 0), (2, 0), (2, 1), (1, 1))], ())
    text = silent(squares)
    assert parse(text).interfaces == ()
    assert len(parse(text[: text.index("BOUNDARY")]).interfaces) == 1


def test_what_the_format_cannot_hold_is_named():
    squares = MultiPatch([quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((1, 0), (2, 0), (2, 1), (1, 1))])
    labels = {"#in\nlet": [(0, Side.WEST)], "middle": [(0, Side.EAST), (0, Side.SOUTH)]}
    blocks = [
        Block("GeoPDEs", "subdomain", "steel\n1 3"),
        Block("GeoPDEs", "patch names", "a\nb\nc"),
    ]
    with pytest.warns(InputWarning) as caught:
        text = geopdes.format_multipatch(MultiPatch(squares.patches, None, None, labels, blocks))
    for words in (
        "'steel'",
        "3 patch names",
        "'in let'",
        "'middle': 1 sides inside",
    ):
        assert sum(words in str(w.message) for w in caught) == 1
    assert parse(text).sides["in let"] == ((0, Side.WEST),)
    assert parse(text).sides["middle"] == ((0, Side.SOUTH),)


def test_blocks_of_other_formats_are_named_when_a_file_is_written(tmp_path):
    mp = MultiPatch([quad((0, 0), (1, 0), (1, 1), (0, 1))])
    blocks = [Block("GeoPDEs", "subdomain", "a\n1"), Block("MFEM NURBS mesh", "element attributes", "5")]
    for suffix, lost in ((".txt", "element attributes of MFEM"), (".mesh", "subdomain of GeoPDEs")):
        with pytest.warns(InputWarning, match=lost) as caught:
            pt.write(MultiPatch(mp.patches, None, None, None, blocks), tmp_path / f"a{suffix}")
        assert len(caught) == 1
        assert len(pt.read(tmp_path / f"a{suffix}").blocks) == 1


def test_two_boundaries_of_one_name_are_two():
    text = TURNED.format(sense=-1).replace("BOUNDARY 2\n", "inflow\n")
    with pytest.warns(InputWarning, match=r"two boundaries are called 'inflow'; one is read as 'inflow \(2\)'"):
        mp = parse(text)
    assert mp.sides["inflow (2)"] == ((0, Side.SOUTH),)


SURFACE = RING.replace("2 2 1\n", "2 3 1\n").replace("1 1 0.7", "0 0 0 0 {z} 0\n1 1 0.7")


def test_a_surface_in_the_plane_is_planar():
    assert parse(SURFACE.format(z=0)).patches == parse(RING).patches


L = TURNED.format(sense=-1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (L.replace("2 2 3 2 2", "3 3 3 2 2"), r"line 4: holds volumes \(dimension 3\)"),
        (L.replace("2 2 3 2 2", "1 2 3 2 2"), r"line 4: holds curves \(dimension 1\)"),
        (SURFACE.format(z=0.5), r"patch 1: lies in space \(z is not 0\)"),
        (L.replace("2 2 3 2 2", "2 2 99999 2 2"), "99999 patches, at most 10000"),
        (L.replace("2 2 3 2 2", "2 2 -3 2 2"), "line 4: -3 patches"),
        (L.replace("2 2 3 2 2", "2 2 3 9999999 2"), "9999999 interfaces, at most"),
        (L.replace("2 2 3 2 2", "2 2 4 2 2"), r"patch 4 \(INTERFACE 1\): degree 4 needs at least 5 control points"),
        (L.replace("2 2 3 2 2", f"2 2 {'9' * 5000} 2 2"), "line 4, the numbers .* is not a whole number"),
        (L.replace("1 1\n2 2", "1 1\n2 999999", 1), "999999 control points in one direction of patch 1 .lower left."),
        (L.replace("1 1\n2 2", "1 40\n2 41", 1), "40 as degree of patch 1"),
        (L.replace("1 1\n2 2", "0 1\n2 2", 1), "degree 0 is not supported"),
        (L.replace("1 1\n2 2", "1 1\n1 2", 1), "degree 1 needs at least 2 control points, got 1"),
        (L.replace("0 0 1 1", "0 0 1", 1), "line 9, knots u of patch 1 .lower left.: 3 entries instead of 4"),
        (L.replace("0 0 1 1", "0 1 0 1", 1), r"patch 1 \(lower left\): .*knot vector decreases"),
        (L.replace("-1 0 -1 0", "-1 nan -1 0"), "line 12, x of patch 1 .*'nan' is NaN"),
        (L.replace("-1 0 -1 0", "-1 1e999 -1 0"), "line 12, x .*'1e999' is NaN, infinite or above"),
        (L.replace("-1 0 -1 0", "-1 1_0 -1 0"), "line 12, x .*'1_0' is not a number"),
        (L.replace("-1 0 -1 0", "-1 o -1 0"), "line 12, x .*'o' is not a number"),
        (L.replace("1 1 1 1", "1 -1 1 1", 1), "patch 1 .lower left.: weight -1 is not positive"),
        (L.replace("1 1 1 1", "1 1e-300 1 1", 1).replace("-1 0 -1 0", "-1 1 -1 0"), "divided by its weight"),
        (L.replace("1 4\n2 1", "1 4\n4 1"), "interface 1: there is no patch 4, the patches are 1 to 3"),
        (L.replace("1 4\n2 1", "1 5\n2 1"), "interface 1: side 5 is not 1, 2, 3 or 4"),
        (L.replace("1 4\n2 1\n-1", "1 4\n2 1\n7"), "orientation 7 is not 1 or -1"),
        (L.replace("steel\n2", "steel\n2 7"), "subdomain 2: the patches are 1 to 3"),
        (L.replace("inflow\n2\n", "inflow\n99\n"), r"99 sides of boundary 1 \(line 44\), at most 12"),
        (L.replace("inflow\n2\n", "inflow\n-1\n"), "boundary 1: -1 sides"),
        (L.replace("1 1\n2 4\nBOUNDARY", "1 1\n1 1\nBOUNDARY"), "boundary 1: names a side twice"),
        (L[: L.index("steel")], "ends after line 40, where subdomain 2 should follow; the file is truncated"),
        (L[: L.index("1 4")], "ends after line 31, where interface 1 should follow"),
        (L.replace("1 4\n2 1", "1 4\n3 1"), r"control points are .* \(patches counted from 0\)"),
    ],
)
def test_what_is_refused_and_why(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse(text)
    assert "\n" not in str(caught.value)


def test_products_that_overflow_are_not_written():
    patch = bicubic(0, weights=True)
    big = Patch(patch.knots, patch.degrees, 1e149 * patch.control_points, 1e9 * patch.weights)
    with pytest.raises(InputError, match="patch 0: a coordinate times its weight is above 1e150"):
        geopdes.format_multipatch(MultiPatch([big]))


def test_names_in_an_old_encoding_are_read():
    mp = geopdes.read_multipatch(L.replace("steel", "acero (Vázquez)").encode("latin-1"))
    assert mp.blocks[-1].text == "acero (Vázquez)\n2"


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_line_ends_and_byte_order_marks(ends):
    data = b"\xef\xbb\xbf" + L.replace("\n", ends).encode()
    assert geopdes.read_multipatch(data) == parse(L)


def smooth(points: np.ndarray) -> np.ndarray:
    x, y = points.T
    return np.column_stack([1.1 * x + 0.1 * np.sin(y), 0.9 * y + 0.1 * np.cos(x)])


def g1_transferred(mp: MultiPatch) -> float:
    """The G1 residual after a transfer to a smoothly deformed boundary."""
    size = mp.diameter
    loops = [
        [c.with_control_points(size * smooth(c.control_points / size)) for c in loop] for loop in mp.boundary().loops
    ]
    result = pt.transfer(mp, Boundary(loops), continuity="g1")
    assert result.certificate.injective
    return result.continuity.as_g1_residual


def test_a_model_that_was_stored_with_weights_transfers_with_g1():
    mp = parse(L).elevate(2).split_spans(2).reduce_continuity(1)
    assert g1_transferred(parse(silent(mp))) <= 1e-11


@real.needed
@pytest.mark.parametrize("name", ["geo_3patch_ASG1", "geo_6patch_ASG1", "geo_Lshaped_8patches"])
def test_analysis_suitable_models_of_geopdes_transfer_with_g1(name):
    mp = pt.read(real.path("yeti").parent / "real" / "geopdes" / f"{name}.txt")
    if max(mp[0].degrees) < 3:
        mp = mp.elevate(2).split_spans(2).reduce_continuity(1)
    assert g1_transferred(mp) <= 1e-11


@quick
@given(st.binary(max_size=200))
def test_any_bytes_are_told_apart_without_an_error(data):
    assert geopdes.looks_like_geopdes(data) in (True, False)
