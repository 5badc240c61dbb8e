"""MFEM NURBS meshes: both forms, orientations, attributes, refusals, and MFEM's own reader on what we write."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import patchtransfer as pt
import real
from patchtransfer import InputError, InputWarning, Interface, MultiPatch, Patch, Side
from patchtransfer.geometry.blocks import Block
from patchtransfer.io import mfem
from shapes import bicubic, quad
from strategies import multipatches

quick = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])

#: Two patches of degree 2 in u, with knots that are not symmetric; the edge 1-4 is theirs. Vertices and edges are
#: numbered so that degrees of freedom run with and against parameters. The geometry is x = u + 2, y = v, and in
#: the second patch, which lies right of the first and is turned by 180 degrees, x = 4 - u, y = 1 - v.
SHARED = """\
MFEM NURBS mesh v1.{minor}

# a comment
dimension
2

elements
2
{one} 3 3 4 1 0
7 3 5 1 4 2

boundary
6
4 1 3 4
2 1 1 0
1 1 0 3
4 1 4 2
2 1 5 1
3 1 2 5

edges
{edges}

vertices
6

knotvectors
3
2 4 0 0 0 0.25 1 1 1
1 2 0 0 1 1
2 4 0 0 0 0.75 1 1 1
{refining}
weights
1 1 1 1 1 1
1 1 1 1
1 1 1 1

FiniteElementSpace
FiniteElementCollection: NURBS
VDim: 2
Ordering: {ordering}

{points}
"""
EDGES = """\
7
1 3 0
0 3 4
1 4 1
0 0 1
2 5 1
1 5 2
2 2 4
"""
VERTICES = [(2, 1), (3, 1), (4, 0), (2, 0), (3, 0), (4, 1)]
#: Greville abscissae of 0 0 0 1/4 1 1 1 inside are 1/8 and 5/8, of 0 0 0 3/4 1 1 1 they are 3/8 and 7/8. Edges 3-4
#: and 0-1 run from the lower vertex; 5-1 from 1, so from u = 1; 2-4 from 2, so from u = 0.
INSIDE = [(2.125, 0), (2.625, 0), (2.125, 1), (2.625, 1), (3.125, 1), (3.625, 1), (3.625, 0), (3.125, 0)]
BY_NODE = "\n".join(f"{x} {y}" for x, y in VERTICES + INSIDE)
BY_DIMENSION = "\n".join(str(c) for axis in (0, 1) for c in (p[axis] for p in VERTICES + INSIDE))


def shared(minor=0, one=1, edges=EDGES, refining="", ordering=1, points=BY_NODE) -> str:
    return SHARED.format(minor=minor, one=one, edges=edges, refining=refining, ordering=ordering, points=points)


def parse(text: str) -> MultiPatch:
    return mfem.read_multipatch(text.encode())


def silent(mp: MultiPatch) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return mfem.format_multipatch(mp)


SQUARES = MultiPatch([quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((1, 0), (2, 0), (2, 1), (1, 1))])


@pytest.mark.parametrize("text", [shared(), shared(ordering=0, points=BY_DIMENSION), shared(minor=1)])
def test_degrees_of_freedom_are_those_of_vertices_edges_and_insides(text):
    mp = parse(text)
    assert [patch.knots[0][3] for patch in mp] == [0.25, 0.75]
    for u in (0.0, 0.3, 1.0):
        for v in (0.0, 0.6, 1.0):
            np.testing.assert_allclose(mp[0](u, v), (2 + u, v), atol=1e-15)
            np.testing.assert_allclose(mp[1](u, v), (4 - u, 1 - v), atol=1e-15)
    assert mp.interfaces == (Interface(0, Side.EAST, 1, Side.EAST, True),)
    assert pt.certify(mp).injective


def test_knot_vectors_of_edges_that_run_the_other_way():
    reversed_edges = EDGES.replace("0 3 4", "0 4 3").replace("0 0 1", "-1 0 1")
    mp = parse(shared(edges=reversed_edges))
    assert mp[0].knots[0][3] == 0.75
    assert mp[1] == parse(shared())[1]


def test_attributes_of_the_boundary_are_labels_and_those_of_elements_are_kept():
    mp = parse(shared())
    assert dict(mp.sides) == {
        "attribute 4": ((0, Side.SOUTH), (1, Side.NORTH)),
        "attribute 2": ((0, Side.NORTH), (1, Side.SOUTH)),
        "attribute 1": ((0, Side.WEST),),
        "attribute 3": ((1, Side.WEST),),
    }
    assert mp.blocks == (Block("MFEM NURBS mesh", "element attributes", "1 7"),)
    again = parse(silent(mp))
    assert (dict(again.sides), again.blocks) == (dict(mp.sides), mp.blocks)
    assert parse(shared(one=7).replace("\n7 3", "\n1 3", 1).replace("7 3 5", "1 3 5")).blocks == ()


def patches_form(kind: str, points: str, directions: int = 2) -> str:
    return f"""\
MFEM NURBS mesh v1.0
dimension
2
elements
1
1 3 0 1 2 3
boundary
0
edges
0
vertices
4
patches
# the only one
knotvectors
{directions}
1 2 0 0 1 1
2 3 0 0 0 1 1 1
dimension
2
{kind}
{points}
"""


def test_control_points_of_patches_with_and_without_their_weights():
    half = 0.5**0.5
    weighted = f"1 0 1\n2 0 1\n{half} {half} {half}\n{2 * half} {2 * half} {half}\n0 1 1\n0 2 1"
    plain = f"1 0 1\n2 0 1\n1 1 {half}\n2 2 {half}\n0 1 1\n0 2 1"
    rings = [
        parse(patches_form(kind, text))[0]
        for kind, text in [
            ("controlpoints", weighted),
            ("controlpoints_homogeneous", weighted),
            ("controlpoints_cartesian", plain),
        ]
    ]
    assert rings[0] == rings[1] == rings[2]
    np.testing.assert_allclose(np.hypot(*rings[0].grid([0.5], np.linspace(0, 1, 9))[0].T), 1.5, atol=1e-15)


@quick
@given(multipatches())
def test_models_survive_writing_to_the_bit(mp):
    sides = [(0, Side.EAST), *mp.boundaries]
    mp = mp.with_labels({name: tuple(dict.fromkeys(sides[k::2])) for k, name in enumerate(("inlet", "attribute 3"))})
    with warnings.catch_warnings():
        # East of the first patch may be an interface.
        warnings.simplefilter("ignore", InputWarning)
        read = parse(mfem.format_multipatch(mp))
    for patch, other in zip(mp, read, strict=True):
        # Weights that are all equal do nothing.
        kept = patch if patch.weights is None or np.ptp(patch.weights) else Patch(*parts(patch))
        assert other == kept
    assert {frozenset([(f.patch_a, f.side_a), (f.patch_b, f.side_b), f.reversed]) for f in read.interfaces} == {
        frozenset([(f.patch_a, f.side_a), (f.patch_b, f.side_b), f.reversed]) for f in mp.interfaces
    }
    boundary = set(mp.boundaries)
    for name, named in mp.sides.items():
        assert boundary.intersection(read.sides[name]) == boundary.intersection(named)
        assert len(read.sides[name]) == len(named)


def parts(patch: Patch):
    return patch.knots, patch.degrees, patch.control_points


def test_a_side_with_several_labels_and_sides_with_none():
    labels = {
        "wall": [(0, Side.NORTH), (1, Side.NORTH)],
        "attribute 2": [(0, Side.SOUTH)],
        'odd "\n[name]': [(1, Side.NORTH)],
    }
    mp = SQUARES.with_labels(labels)
    text = silent(mp)
    assert dict(parse(text).sides) == dict(mp.sides)
    rows = text[text.index("boundary\n6\n") : text.index("edges")].split("\n")[2:-2]
    assert sorted(row[0] for row in rows) == ["1", "2", "3", "4", "4", "4"]


def test_labels_inside_are_written_with_a_warning_and_stand_for_the_first_patch():
    with pytest.warns(InputWarning, match="label 'middle' names sides inside the model"):
        text = mfem.format_multipatch(
            SQUARES.with_labels({"middle": [(1, Side.WEST)], "attribute 9": [(0, Side.EAST)]})
        )
    assert dict(parse(text).sides) == {"middle": ((0, Side.EAST),), "attribute 9": ((0, Side.EAST),)}
    with pytest.warns(InputWarning, match="label 'nothing' names no side; left out"):
        mfem.format_multipatch(SQUARES.with_labels({"nothing": []}))


def test_attributes_that_do_not_fit_are_named():
    blocks = [Block("MFEM NURBS mesh", "element attributes", "1 2 3")]
    with pytest.warns(InputWarning, match="attributes of 3 elements in the file read do not fit 2 patches"):
        mfem.format_multipatch(MultiPatch(SQUARES.patches, None, None, None, blocks))


def test_left_handed_patches_are_exchanged_for_mfem_and_back():
    left = Patch(SQUARES[1].knots, (1, 1), SQUARES[1].control_points.transpose(1, 0, 2))
    mp = MultiPatch([SQUARES[0], left])
    text = silent(mp)
    assert "# u and v exchanged in patches 1\n" in text
    assert parse(text) == mp
    # Without the comment it is what MFEM reads.
    assert parse(text.replace("# u and v", "# v and u")).patches == SQUARES.patches


def ring(patches: int) -> MultiPatch:
    """A ring of patches around the origin."""
    angles = 2 * np.pi * np.arange(patches + 1) / patches
    ends = [(np.cos(a), np.sin(a)) for a in angles[:-1]]
    knots = [0, 0, 0, 1, 1, 1]
    made = []
    for k in range(patches):
        a, b = np.array(ends[k]), np.array(ends[(k + 1) % patches])
        # Of half a ring the sum is nothing.
        middle = a + b if patches > 2 else 2 * np.array([-a[1], a[0]])
        made.append(Patch((knots, [0, 0, 1, 1]), (2, 1), [[s * x for s in (2, 1)] for x in (a, middle, b)]))
    return MultiPatch(made)


def test_edges_between_the_same_two_vertices_cannot_be_written():
    assert len(ring(2).interfaces) == 2
    with pytest.raises(InputError, match=r"a closed ring of fewer than 3 patches.*split the patches"):
        mfem.format_multipatch(ring(2))
    assert parse(silent(ring(3))) == ring(3)


def test_degrees_beyond_mfem_are_not_written():
    with pytest.raises(InputError, match="patch 0 has degree 11; MFEM's splines have at most 10"):
        mfem.format_multipatch(SQUARES.elevate(10))


def test_patches_that_share_no_vertex_are_glued_by_where_they_are():
    text = silent(SQUARES).replace("\n1 3 1 4 5 2\n", "\n1 3 6 4 5 7\n").replace("vertices\n6", "vertices\n8")
    assert text.count("1 3 6 4 5 7") == 1
    boundary, patches = text.index("boundary\n6"), text.index("\nvertices")
    apart = text[:boundary] + "boundary\n0\nedges\n0\n" + text[patches:]
    assert parse(apart).interfaces == SQUARES.interfaces


def test_spacing_is_named_and_left():
    spacing = "spacing\n2\n0 1 1 2 3 0.5 0.5\n1 0 1 0 2\n"
    with pytest.warns(InputWarning, match="line 40: section 'spacing' says how MFEM refines"):
        assert parse(shared(minor=1, refining=spacing)) == parse(shared())
    with pytest.warns(InputWarning, match="what follows from 'and' on is not read"):
        parse(shared() + "\nand more")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert parse(shared(minor=1, refining="spacing\n0\n") + "mfem_mesh_end\n") == parse(shared())


def test_newer_spaces_and_unit_weights():
    newer = shared().replace("FiniteElementSpace\n", "MFEM FiniteElementSpace v1.0\n", 1)
    newer = newer.replace("Ordering: 1\n", "Ordering: 1\nEnd: MFEM FiniteElementSpace v1.0\n")
    assert parse(newer) == parse(shared())
    weights = shared()[shared().index("weights") : shared().index("FiniteEl")]
    assert parse(shared().replace(weights, "unitweights\n\n")) == parse(shared())


ONE = patches_form("controlpoints", "\n".join(f"{x} {y} 1" for y in (0, 1, 2) for x in (0, 1)))
TWO = shared()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TWO.replace("MFEM NURBS mesh v1.0", "MFEM NURBS NC-patch mesh v1.0"), "non-conforming mesh.*hanging nodes"),
        (TWO.replace("MFEM NURBS mesh v1.0", "MFEM NURBS mesh v2.0"), "'MFEM NURBS mesh v2.0' is not known"),
        (TWO.replace("MFEM NURBS mesh v1.0", "MFEM mesh v1.0"), "'MFEM mesh v1.0' is no NURBS mesh"),
        (TWO.replace("dimension\n2", "dimension\n1"), r"line 5: a mesh of curves \(dimension 1\)"),
        (TWO.replace("dimension\n2", "dimension\n3"), r"line 5: a mesh of volumes \(dimension 3\)"),
        (TWO.replace("elements\n2", "elements\n99999"), r"99999 elements \(line 8\), at most 10000"),
        (TWO.replace("elements\n2", "elements\n3"), "line 12, element 2: 'boundary' is not a whole number"),
        (TWO.replace("elements\n2", "elements\n0"), "line 8: no elements"),
        (TWO.replace("elements\n2", "elements\n-2"), "line 8: -2 elements"),
        (TWO.replace("1 3 3 4 1 0", "1 2 3 4 1"), "line 9, element 0: a triangle instead of a square"),
        (TWO.replace("1 3 3 4 1 0", "1 3 3 4 1 9"), "element 0: there is no vertex 9, the vertices are 0 to 5"),
        (TWO.replace("1 3 3 4 1 0", "1 3 3 4 1 1"), r"element 0: names a vertex twice \(periodic or collapsed\)"),
        (TWO.replace("4 1 3 4", "4 1 3 1"), "boundary element 0: no element has an edge of vertices 3 and 1"),
        (TWO.replace("1 3 0", "1 3 4"), "edges: that of vertices 0 and 3 is missing; list each edge once"),
        (TWO.replace("1 5 2", "1 3 0"), "edges: that of vertices 2 and 5 is missing"),
        (TWO.replace("2 5 1\n1 5 2", "0 5 1\n1 5 2"), "opposite edges of patch 1 have the knot vectors [02] and [02]"),
        (TWO.replace("2 5 1\n1 5 2", "2 1 5\n1 5 2"), "opposite edges of patch 1 let knot vector 2 run in different"),
        (TWO.replace("0 3 4", "9 3 4"), "patch 0: there is no knot vector 9, they are 0 to 2"),
        (shared(edges="0"), "none are listed, so the direction of knot vector 0 is not known"),
        (TWO.replace("knotvectors\n3", "knots\n3"), "section 'knots' instead of 'patches' or 'knotvectors'"),
        (TWO.replace("2 4 0 0 0 0.25", "2 99999999 0 0 0 0.25"), "99999999 control points in one direction of line 37"),
        (TWO.replace("2 4 0 0 0 0.25", "40 41 0 0 0 0.25"), "40 as degree of line 37, knot vector 0"),
        (TWO.replace("2 4 0 0 0 0.25", "2 4 0 0 0 nan"), "line 37, knots of knot vector 0: 'nan' is NaN"),
        (TWO.replace("2 4 0 0 0 0.25", "2 4 0 0 0 -0.25"), "patch 0: .*knot vector decreases"),
        (TWO.replace("weights\n1 1", "weights\n1 -1"), "patch 0: weight -1 is not positive"),
        (TWO.replace("weights", "gewichte"), "section 'weights' should stand here, got 'gewichte'"),
        (
            shared(refining="periodic\n1\n1\n1\n3"),
            "a periodic mesh .section 'periodic' glues boundary attributes 1 to 3",
        ),
        (shared(refining="mesh_elements\n1\n0"), "holds a part of a mesh .'mesh_elements'"),
        (shared(refining="spacing\n99"), "99 spacing functions .line 41., at most 3"),
        (TWO.replace("NURBS\nVDim", "NURBS3\nVDim"), "points of degree 3 on knot vectors of degree 1 and 2"),
        (TWO.replace("NURBS\nVDim", "H1_2D_P2\nVDim"), "points in 'H1_2D_P2' are not NURBS"),
        (TWO.replace("VDim: 2", "VDim: 1"), "points of 1 coordinates"),
        (TWO.replace("Ordering: 1", "Ordering: 5"), "Ordering 5 is neither 0 nor 1"),
        (TWO[: TWO.index("3.625 1")], "ends after line 61, where points of the degrees of freedom should follow"),
        (TWO[: TWO.index("knotvectors")], "where the section 'patches' or 'knotvectors' should follow"),
        (ONE.replace("vertices\n4", "vertices\n4\n4"), "section '4' instead of 'patches'"),
        (ONE.replace("knotvectors\n2", "knotvectors\n3"), "patch 0 has 3 knot vectors; a planar patch has two"),
        (ONE.replace("1\ndimension\n2", "1\ndimension\n4"), "patch 0 lies in space of dimension 4"),
        (ONE.replace("controlpoints", "points"), "control points of patch 0 should stand here, got 'points'"),
        (ONE.replace("1 2 1\n", "1 2 0\n"), "patch 0: weight 0 is not positive"),
        (
            ONE.replace("1 2 1\n", "1 2e200 1\n"),
            "line 27, control points of patch 0: '2e200' is NaN, infinite or above",
        ),
    ],
)
def test_what_is_refused_and_why(text, message):
    with pytest.raises(InputError, match=message) as caught:
        parse(text)
    assert "\n" not in str(caught.value)


def test_patches_at_an_edge_of_three():
    elements = "1 3 0 1 4 3 1 3 1 2 5 4 1 3 1 6 7 4"
    patch = "knotvectors 2 1 2 0 0 1 1 1 2 0 0 1 1 dimension 2 controlpoints 0 0 1 1 0 1 0 1 1 1 1 1"
    text = f"dimension 2 elements 3 {elements} boundary 0 edges 0 vertices 8 patches {patch} {patch} {patch}"
    with pytest.raises(InputError, match="3 patches share the edge of vertices 1 and 4"):
        parse("MFEM NURBS mesh v1.0\n" + text)


# --- real files -----------------------------------------------------------------------------------

REFUSED = {
    "geo_camembert.txt": r"volumes \(dimension 3\)",
    "nc3-nurbs.mesh": "hanging nodes",
    "nurbs-segments2d-patches.mesh": "mesh of curves",
}


@real.needed
@pytest.mark.parametrize("folder", ["geopdes", "mfem", "splinepy"])
def test_real_models_are_read_and_survive_or_are_refused_for_what_they_are(tmp_path, folder):
    files = [f for f in (real.path("").parent / "real" / folder).iterdir() if f.suffix in (".txt", ".mesh")]
    assert files
    for file in files:
        if file.name in REFUSED:
            with pytest.raises(InputError, match=REFUSED[file.name]):
                pt.read(file)
            continue
        mp = pt.read(file)
        for suffix in (".txt", ".mesh"):
            with warnings.catch_warnings():
                # Each format names what the other one holds.
                warnings.simplefilter("ignore", InputWarning)
                pt.write(mp, tmp_path / f"a{suffix}")
            read = pt.read(tmp_path / f"a{suffix}")
            size = max(np.abs(patch.control_points).max() for patch in mp)
            for patch, other in zip(mp, read, strict=True):
                assert np.abs(patch.control_points - other.control_points).max() <= 1e-15 * size
            assert {name: read.sides[name] for name in mp.sides} == dict(mp.sides)
            assert len(read.interfaces) == len(mp.interfaces)


# --- other programs: PyMFEM is 100 MB large and no dependency -------------------------------------


def loaded(path: Path):
    """The mesh as MFEM reads it."""
    return pytest.importorskip("mfem.ser").Mesh(str(path), 1, 1)


def area_by_mfem(mesh) -> float:
    """Area by MFEM's own maps; its elements' volumes are by a rule for polynomials."""
    ser = pytest.importorskip("mfem.ser")
    rule, total = ser.IntRules.Get(ser.Geometry.SQUARE, 45), 0.0
    for k in range(mesh.GetNE()):
        element = mesh.GetElementTransformation(k)
        for i in range(rule.GetNPoints()):
            point = rule.IntPoint(i)
            element.SetIntPoint(point)
            assert element.Weight() > 0
            total += point.weight * element.Weight()
    return total


def area(mp: MultiPatch) -> float:
    x, w = np.polynomial.legendre.leggauss(24)
    total = 0.0
    for patch in mp:
        at, weight = [], []
        for knots in patch.knots:
            breaks = np.unique(knots)
            half = np.diff(breaks)[:, None] / 2
            at.append((breaks[:-1, None] + half * (x + 1)).ravel())
            weight.append((half * w).ravel())
        du, dv = patch.grid(*at, 1, 0), patch.grid(*at, 0, 1)
        total += abs(weight[0] @ (du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]) @ weight[1])
    return total


@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(mp=multipatches())
def test_mfem_finds_the_same_area_and_prints_what_we_read_again(tmp_path, mp):
    (tmp_path / "a.mesh").write_text(silent(mp))
    mesh = loaded(tmp_path / "a.mesh")
    np.testing.assert_allclose(area_by_mfem(mesh), area(mp), rtol=1e-11)
    # MFEM prints the other form, which shares degrees of freedom.
    mesh.Print(str(tmp_path / "b.mesh"), 17)
    printed = (tmp_path / "b.mesh").read_text()
    assert "\npatches" not in printed
    read = parse(printed)
    ours = parse(silent(mp).replace("# u and v", "# v and u"))
    size = max(np.abs(patch.control_points).max() for patch in mp)
    for a, b in zip(ours, read, strict=True):
        at = [np.linspace(t[0], t[-1], 5) for t in a.knots]
        assert all(np.allclose(s, t, atol=1e-15) for s, t in zip(a.knots, b.knots, strict=True))
        np.testing.assert_allclose(a.grid(*at), b.grid(*at), atol=1e-14 * size)
    assert read.interfaces == ours.interfaces


@pytest.mark.parametrize("text", [shared(), ONE], ids=["shared", "patches"])
def test_mfem_reads_our_examples_as_we_do(tmp_path, text):
    (tmp_path / "a.mesh").write_text(text)
    np.testing.assert_allclose(area_by_mfem(loaded(tmp_path / "a.mesh")), area(parse(text)), rtol=1e-13)


def test_splinepy_writes_what_we_read(tmp_path):
    splinepy = pytest.importorskip("splinepy")
    patch = bicubic(3, weights=True)
    weights = patch.weights.T.reshape(-1, 1)
    points = patch.control_points.transpose(1, 0, 2).reshape(-1, 2)
    theirs = splinepy.NURBS(patch.degrees, patch.knots, points, weights)
    splinepy.io.mfem.export(str(tmp_path / "a.mesh"), theirs)
    read = pt.read(tmp_path / "a.mesh")[0]
    at = np.linspace(0, 1, 9)
    np.testing.assert_allclose(read.grid(at, at), patch.grid(at, at), atol=1e-13)
