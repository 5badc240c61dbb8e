"""Integer arc lengths of T-meshes made by hand: against enumeration, and what callers may demand."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patchtransfer import InputError
from patchtransfer.sources.auto_layout.assembly import assemble
from patchtransfer.sources.auto_layout.gluing import glue
from patchtransfer.sources.auto_layout.prices import (
    CollapsePrice,
    arc_prices,
    collapse_prices,
    edge_prices,
    shear_tangents,
)
from patchtransfer.sources.auto_layout.quantize import arcs_between, quantize
from patchtransfer.sources.auto_layout.reasons import NoLayoutError
from patchtransfer.sources.auto_layout.t_mesh import TMesh
from t_meshes import rectangles, squares, t_mesh_of

#: Collapses cost little: as few edges as the rules allow.
COARSE = CollapsePrice(100.0, steepest=90.0)
#: Nothing collapses.
FINE = CollapsePrice(1e-3)

L_SHAPE = [(0, 0, 1, 1), (1, 0, 2, 1), (0, 1, 1, 2)]
PLUS = [(1, 1, 2, 2), (0, 1, 1, 2), (2, 1, 3, 2), (1, 0, 2, 1), (1, 2, 2, 3)]
RING = [(0, 0, 1, 1), (1, 0, 2, 1), (2, 0, 3, 1), (0, 1, 1, 2), (2, 1, 3, 2), (0, 2, 1, 3), (1, 2, 2, 3), (2, 2, 3, 3)]
#: A bar with a tower at its left end and a cellar at its right one: 1 apart, 1 high.
Z_SHAPE = [(0, 1, 1, 2), (0, 0, 1, 1), (1, 0, 2, 1), (2, 0, 4, 1), (2, -1, 4, 0)]


def z_shape(width):
    """The distance of the reflex corners along the bar is `width`, its height 1."""
    boxes = [(a, b + 1, c, d + 1) for a, b, c, d in Z_SHAPE]
    return rectangles(boxes, xs=[0, 1, 1 + width, 2 + width, 3 + width])


def square_with_hole():
    """A round hole in a square, with a singularity of valence 5 before each corner: 12 quads."""
    turns = np.arange(4) * np.pi / 2
    hole = [0.5 * np.array([np.cos(a + np.pi / 4), np.sin(a + np.pi / 4)]) for a in turns]
    singular = [1.6 * p for p in hole]
    corners = [np.array(p) for p in ((2.0, 2.0), (-2.0, 2.0), (-2.0, -2.0), (2.0, -2.0))]
    # Two points on every side: before and after each corner, counter-clockwise.
    before = [np.array(p) for p in ((2.0, 0.7), (-0.7, 2.0), (-2.0, -0.7), (0.7, -2.0))]
    after = [np.array(p) for p in ((0.7, 2.0), (-2.0, 0.7), (-0.7, -2.0), (2.0, -0.7))]
    quads = []
    for i in range(4):
        j = (i + 1) % 4
        quads += [(i, 4 + i, 4 + j, j), (4 + i, 12 + i, 8 + i, 16 + i), (4 + i, 16 + i, 12 + j, 4 + j)]
    points = np.array(hole + singular + corners + before + after)
    faces = [[[quad[k], quad[(k + 1) % 4]] for k in range(4)] for quad in quads]
    t_mesh, outline = t_mesh_of(points, faces, lambda a, b: 1.0)
    # The hole is round.
    round_hole = np.linalg.norm(outline.points, axis=1) < 1
    outline = dataclasses.replace(outline, corner_angle=np.where(round_hole, np.nan, outline.corner_angle))
    smooth = np.isin(t_mesh.node_vertex, np.flatnonzero(round_hole))
    return dataclasses.replace(t_mesh, node_critical=t_mesh.node_critical & ~smooth), outline


def disk():
    """Five quads in a round outline, four singularities of valence 3."""
    a = np.arange(4) * np.pi / 2 + np.pi / 4
    ring = np.column_stack([np.cos(a), np.sin(a)])
    quads = [(0, 1, 2, 3)] + [(i, 4 + i, 4 + (i + 1) % 4, (i + 1) % 4) for i in range(4)]
    return squares(np.concatenate([ring / 2, ring]), quads, smooth=True)


def one_face_ring(n):
    """A smooth ring of one face, cut once."""
    a = 2 * np.pi * np.arange(n + 1) / n
    circle = np.column_stack([np.cos(a), np.sin(a)])
    _, outline = squares(np.concatenate([circle[:-1], circle[:-1] / 2]), ring_quads(n), smooth=True)
    return TMesh(
        node_kind=np.zeros(2, dtype=int),
        node_vertex=np.array([0, n]),
        node_critical=np.zeros(2, dtype=bool),
        node_index=np.array([2, 2]),
        node_loop=np.array([0, 1]),
        node_position=np.zeros(2),
        node_point=np.array([[1.0, 0.0], [0.5, 0.0]]),
        arc_nodes=np.array([[0, 0], [1, 1], [0, 1]]),
        arc_length=np.array([1.0, 1.0, 0.2]),
        arc_size=np.array([2 * np.pi, np.pi, 0.5]),
        arc_loop=np.array([0, 1, -1]),
        arc_interval=np.array([[0.0, n], [0.0, n], [-1, -1]]),
        arc_points=(circle, circle[::-1] / 2, np.array([[1.0, 0.0], [0.5, 0.0]])),
        arc_places=(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), np.array([0.0, 0.2])),
        faces=((np.array([0]), np.array([4]), np.array([2]), np.array([5])),),
        sector_next=np.array([4, 0, 5, 2, 1, 3]),
        sector_quarters=np.array([1, 0, 1, 0, 1, 1]),
    ), outline


def ring_quads(n):
    return [(i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)]


def quads_of(t_mesh, lengths):
    return len(glue(t_mesh, lengths).quads)


@pytest.mark.parametrize(
    ("boxes", "quads"), [([(0, 0, 1, 1)], 1), (L_SHAPE, 3), (PLUS, 5), (RING, 8)], ids=["square", "L", "plus", "ring"]
)
@pytest.mark.parametrize("price", [COARSE, FINE])
def test_shapes_without_anything_to_collapse(boxes, quads, price):
    t_mesh, outline = rectangles(boxes)
    result = quantize(t_mesh, outline, price)
    assert result.lengths.tolist() == [1] * len(t_mesh.arc_nodes)
    layout = assemble(t_mesh, outline, result.lengths)
    assert len(layout.quads) == quads
    np.testing.assert_allclose(
        layout.points[layout.quads].mean(axis=1), [((a + c) / 2, (b + d) / 2) for a, b, c, d in boxes]
    )


def best_by_enumeration(t_mesh, outline, price, most=2):
    """Least price of all lengths up to `most` that make a layout with all critical points apart, strictly."""
    n = len(t_mesh.arc_nodes)
    rows = []
    for face in t_mesh.faces:
        for side in (0, 1):
            row = np.zeros(n, dtype=int)
            np.add.at(row, face[side] // 2, 1)
            np.add.at(row, face[side + 2] // 2, -1)
            rows.append(row)
    equations = np.array(rows)
    edges, collapses = edge_prices(t_mesh, outline), arc_prices(t_mesh, outline, price)
    critical = np.flatnonzero(t_mesh.node_critical)
    inside = critical[t_mesh.node_loop[critical] < 0]
    best = np.inf
    for x in _solutions(equations, most):
        cost = float(edges @ x + collapses[x == 0].sum())
        if cost >= best:
            continue
        label = glue(t_mesh, x).label[: len(t_mesh.node_kind)]
        boundary = set(label[t_mesh.node_loop >= 0].tolist())
        if len(set(label[critical].tolist())) < len(critical) or boundary & set(label[inside].tolist()):
            continue
        try:
            assemble(t_mesh, outline, x)
        except NoLayoutError:
            continue
        best = cost
    return best


def _solutions(equations, most):
    """All x with equations @ x = 0, arc by arc: a row is looked at when its last arc is chosen."""
    n = equations.shape[1]
    last = [np.flatnonzero([row[k] and not row[k + 1 :].any() for row in equations]) for k in range(n)]
    partial = [()]
    for k in range(n):
        partial = [
            (*x, value)
            for x in partial
            for value in range(most + 1)
            if not (equations[last[k], : k + 1] @ np.array([*x, value])).any()
        ]
    return [np.array(x) for x in partial]


@pytest.mark.parametrize("price", [COARSE, CollapsePrice(2.0, steepest=90.0), CollapsePrice(0.3, steepest=90.0)])
@pytest.mark.parametrize("shape", ["L", "plus", "ring", "z", "disk", "stairs"])
def test_cheapest_of_all_small_lengths(shape, price):
    t_mesh, outline = {
        "L": lambda: rectangles(L_SHAPE),
        "plus": lambda: rectangles(PLUS),
        "ring": lambda: rectangles(RING),
        "z": lambda: z_shape(0.6),
        "disk": disk,
        "stairs": lambda: rectangles(
            [(0, 0, 1, 1), (1, 0, 2, 1), (2, 0, 3, 1), (0, 1, 2, 2), (0, 2, 1, 3)], ys=[0, 1, 1.5, 3]
        ),
    }[shape]()
    result = quantize(t_mesh, outline, price)
    assert result.cost == pytest.approx(best_by_enumeration(t_mesh, outline, price), abs=1e-6)


def test_coarse_prices_collapse_what_fine_ones_keep():
    t_mesh, outline = z_shape(0.6)
    assert [quads_of(t_mesh, quantize(t_mesh, outline, price).lengths) for price in (COARSE, FINE)] == [4, 5]


def test_steep_collapses_only_where_nothing_else_is_left():
    # The line between the reflex corners would turn by atan(0.6) = 31 or atan(1.5) = 56 degrees.
    price = CollapsePrice(100.0, steepest=40.0)
    flat, steep = (quantize(*z_shape(width), price) for width in (0.6, 1.5))
    assert [quads_of(z_shape(1.0)[0], q.lengths) for q in (flat, steep)] == [4, 5]
    assert (flat.steep, steep.steep) == (0, 0)
    forced = quantize(*z_shape(1.5), price, max_patches=4)
    assert quads_of(z_shape(1.5)[0], forced.lengths) == 4
    assert forced.steep == 1


def test_tangents_of_shears():
    t_mesh, _ = z_shape(0.6)
    across = [arc for arc, (a, b) in enumerate(t_mesh.node_point[t_mesh.arc_nodes]) if {a[0], b[0]} == {1.0, 1.6}]
    tangents = shear_tangents(t_mesh)
    assert len(across) == 2
    np.testing.assert_allclose(tangents[across], 0.6)


def test_shear_price_keeps_arcs_that_size_alone_collapses():
    t_mesh, outline = z_shape(0.9)
    by_size = CollapsePrice(100.0, steepest=90.0)
    by_shear = CollapsePrice(100.0, shear=8.0, steepest=90.0)
    assert [quads_of(t_mesh, quantize(t_mesh, outline, p).lengths) for p in (by_size, by_shear)] == [4, 5]


def test_merging_moves_singularities_into_the_boundary():
    t_mesh, outline = square_with_hole()
    price = CollapsePrice(1 / 12, steepest=90.0)
    strict, merging = (quantize(t_mesh, outline, price, mode=mode) for mode in ("strict", "merging"))
    assert [quads_of(t_mesh, q.lengths) for q in (strict, merging)] == [12, 8]
    layout = assemble(t_mesh, outline, merging.lengths)
    # Three quads of 60 degrees at four vertices of the hole, none inside.
    assert sorted(layout.valence.tolist()) == [1] * 4 + [2] * 8 + [3] * 4


def test_valence_three_does_not_merge_into_a_smooth_boundary():
    t_mesh, outline = disk()
    # One quad with a straight angle would be left there.
    assert quads_of(t_mesh, quantize(t_mesh, outline, COARSE, mode="merging").lengths) == 5


@pytest.mark.parametrize("limit", [8, 9, 11, 12, 20])
def test_most_patches(limit):
    t_mesh, outline = square_with_hole()
    result = quantize(t_mesh, outline, FINE, mode="merging", max_patches=limit)
    assert quads_of(t_mesh, result.lengths) <= limit
    if limit >= 12:
        assert quads_of(t_mesh, result.lengths) == 12


def test_too_few_patches_say_so():
    t_mesh, outline = rectangles(PLUS)
    with pytest.raises(NoLayoutError, match="at most 4 patches") as error:
        quantize(t_mesh, outline, COARSE, max_patches=4)
    assert error.value.stage == "quantization"


def test_limit_on_patches_counts_products_of_sides():
    t_mesh, outline = rectangles([(0, 0, 1, 1)])
    sides = [frozenset((int(side[0]) // 2,)) for side in t_mesh.faces[0]]
    demands = {sides[0]: 3, sides[1]: 2}
    assert quads_of(t_mesh, quantize(t_mesh, outline, COARSE, at_least=demands, max_patches=6).lengths) == 6
    with pytest.raises(NoLayoutError):
        quantize(t_mesh, outline, COARSE, at_least=demands, max_patches=5)


def test_more_edges_between_two_places_of_the_outline():
    t_mesh, outline = rectangles(L_SHAPE)
    # The long side from (0, 0) to (2, 0): two arcs.
    start = float(outline.s[np.flatnonzero((outline.points == [0, 0]).all(axis=1))[0]])
    side = arcs_between(t_mesh, outline, 0, start, start + 2)
    assert sorted(map(tuple, t_mesh.node_point[t_mesh.arc_nodes[sorted(side)]].mean(axis=1))) == [(0.5, 0), (1.5, 0)]
    assert len(arcs_between(t_mesh, outline, 0, start + 0.2, start + 0.3)) == 1
    lengths = quantize(t_mesh, outline, COARSE, at_least={side: 3}).lengths
    assert lengths[sorted(side)].sum() == 3
    with pytest.raises(InputError, match="no loop 1"):
        arcs_between(t_mesh, outline, 1, 0, 1)


def test_stretch_of_the_outline_in_the_other_sense():
    t_mesh, outline = rectangles(L_SHAPE)
    length = outline.outlines[0].length
    reversed_outline = dataclasses.replace(outline, s=(length - outline.s) % length)
    start = float(outline.s[np.flatnonzero((outline.points == [0, 0]).all(axis=1))[0]])
    found = arcs_between(t_mesh, reversed_outline, 0, (length - start - 2) % length, (length - start) % length)
    assert found == arcs_between(t_mesh, outline, 0, start, start + 2)


def test_ties_of_symmetric_arcs():
    t_mesh, outline = rectangles(L_SHAPE)
    middle = t_mesh.node_point[t_mesh.arc_nodes].mean(axis=1)
    mirror = [int(np.argmin(np.linalg.norm(middle - m[::-1], axis=1))) for m in middle]
    tip = int(np.argmin(np.linalg.norm(middle - [2, 0.5], axis=1)))
    demand = {frozenset((tip,)): 2}
    free = quantize(t_mesh, outline, COARSE, at_least=demand).lengths
    tied = quantize(t_mesh, outline, COARSE, at_least=demand, ties=list(enumerate(mirror))).lengths
    assert free[mirror[tip]] == 1
    np.testing.assert_array_equal(tied, tied[mirror])
    assert tied[tip] == 2


def test_turning_boundary_and_loops_get_enough_edges():
    t_mesh, outline = one_face_ring(40)
    result = quantize(t_mesh, outline, COARSE)
    # 360 degrees in steps of at most 110.
    assert result.lengths.tolist() == [4, 4, 1]
    layout = assemble(t_mesh, outline, result.lengths)
    # At equal parts of the map.
    places = outline.s[[0, 10, 20, 30]] / outline.outlines[0].length
    np.testing.assert_allclose(np.sort(layout.boundary_s[:4] / outline.outlines[0].length), places, atol=1e-3)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"mode": "loose"}, "mode"),
        ({"max_patches": 0}, "max_patches"),
        ({"ties": [(0, 99)]}, "ties names arc 99"),
        ({"at_least": {frozenset((-1,)): 1}}, "at_least names arc -1"),
        ({"at_least": {frozenset(): 1}}, "at_least names no arcs"),
    ],
)
def test_wrong_demands(options, match):
    with pytest.raises(InputError, match=match):
        quantize(*rectangles(L_SHAPE), COARSE, **options)


@pytest.mark.parametrize("values", [(0.0,), (np.nan,), (1.0, -1.0), (1.0, 0.0, 91.0)])
def test_wrong_prices(values):
    with pytest.raises(InputError, match="collapse prices"):
        CollapsePrice(*values)


def test_families_of_prices():
    few, quality = collapse_prices("few"), collapse_prices("quality")
    assert max(p.size for p in few) > max(p.size for p in quality)
    assert all(p.shear > 0 for p in quality)
    with pytest.raises(InputError, match="prefer"):
        collapse_prices("many")


@st.composite
def unions(draw):
    """Connected rectilinear unions of cells whose cells touch along edges only, cut into rows, on uneven lattices."""
    width, height = draw(st.integers(1, 4)), draw(st.integers(1, 4))
    cells = draw(
        st.sets(st.tuples(st.integers(0, width - 1), st.integers(0, height - 1)), min_size=1).map(_largest_part)
    )
    for x, y in itertools.product(range(width), range(height)):
        # Cells that meet in a vertex only get a third one.
        block = {(x + i, y + j) for i in (0, 1) for j in (0, 1)} & cells
        if len(block) == 2 and len({i for i, _ in block}) == len({j for _, j in block}) == 2:
            cells = cells | {(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)}
    steps = st.floats(0.2, 3.0)
    xs, ys = (np.cumsum([0.0, *draw(st.lists(steps, min_size=5, max_size=5))]) for _ in range(2))
    return _rows(cells), xs, ys


def _largest_part(cells):
    parts, left = [], set(cells)
    while left:
        part, front = set(), [min(left)]
        while front:
            x, y = front.pop()
            if (x, y) in left:
                left.remove((x, y))
                part.add((x, y))
                front += [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)]
        parts.append(part)
    return max(parts, key=len)


def _rows(cells):
    boxes = []
    for x, y in sorted(cells):
        if (x - 1, y) not in cells:
            end = x
            while (end, y) in cells:
                end += 1
            boxes.append((x, y, end, y + 1))
    return boxes


@given(unions(), st.sampled_from([COARSE, CollapsePrice(0.5, 1.0), FINE]), st.sampled_from(["strict", "merging"]))
@settings(max_examples=60)
def test_rectilinear_unions(union, price, mode):
    boxes, xs, ys = union
    t_mesh, outline = rectangles(boxes, xs, ys)
    result = quantize(t_mesh, outline, price, mode=mode)
    layout = assemble(t_mesh, outline, result.lengths)
    corners = outline.points[~np.isnan(outline.corner_angle)]
    found = layout.points[layout.boundary_vertices[layout.corner]]
    assert sorted(map(tuple, np.round(found, 6) + 0.0)) == sorted(map(tuple, np.round(corners, 6) + 0.0))
    # With another unit of length, turned by 90 degrees and mirrored, and with noise: the same lengths.
    noise = 1 + 1e-9 * np.sin(np.arange(len(t_mesh.arc_size)))
    other = dataclasses.replace(
        t_mesh,
        arc_size=1e3 * t_mesh.arc_size * noise,
        arc_points=tuple(1e3 * line[:, ::-1] for line in t_mesh.arc_points),
    )
    scaled = dataclasses.replace(outline, points=1e3 * outline.points[:, ::-1], next=np.argsort(outline.next))
    np.testing.assert_array_equal(quantize(other, scaled, price, mode=mode).lengths, result.lengths)
