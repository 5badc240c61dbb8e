"""T-meshes of maps that are known: unions of unit squares mapped to themselves, in charts turned at random; rings."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from patchtransfer.sources.auto_layout.reasons import NoLayoutError
from patchtransfer.sources.auto_layout.t_mesh import TMesh, build_t_mesh

Cells = frozenset[tuple[int, int]]


@dataclass
class Domain:
    """Arguments of `build_t_mesh`."""

    points: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    rotation: np.ndarray
    index: np.ndarray
    outline_next: np.ndarray
    outline_loop: np.ndarray
    corner: np.ndarray

    def t_mesh(self) -> TMesh:
        return build_t_mesh(**vars(self))

    def with_turned_charts(self, rng: np.random.Generator) -> Domain:
        """Every triangle in a chart of its own."""
        quarters = rng.integers(0, 4, len(self.triangles))
        turns = np.array([np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), k) for k in range(4)])
        uv = np.einsum("fab,fib->fia", turns[quarters], self.uv) + rng.integers(-9, 9, (len(quarters), 1, 2)) / 4
        neighbour = neighbours(self.triangles)
        rotation = np.where(neighbour >= 0, (quarters[neighbour] - quarters[:, None]) % 4, 0)
        return Domain(**(vars(self) | {"uv": uv, "rotation": rotation}))


def neighbours(triangles: np.ndarray) -> np.ndarray:
    """The triangle across the edge opposite every corner, or -1."""
    sides = {(int(t[i - 2]), int(t[i - 1])): f for f, t in enumerate(triangles) for i in range(3)}
    return np.array([[sides.get((int(t[i - 1]), int(t[i - 2])), -1) for i in range(3)] for t in triangles])


def loops_of(triangles: np.ndarray) -> tuple[list[list[int]], np.ndarray]:
    """Loops of vertices with the domain on the left, and the vertices inside."""
    across = neighbours(triangles)
    after = {int(triangles[f][i - 2]): int(triangles[f][i - 1]) for f, i in zip(*np.nonzero(across < 0), strict=True)}
    loops: list[list[int]] = []
    left = dict(after)
    while left:
        start = v = min(left)
        loops.append([])
        while v in left:
            loops[-1].append(v)
            v = left.pop(v)
        assert v == start
    return loops, np.setdiff1d(triangles, list(after))


def domain(points: np.ndarray, quads: np.ndarray, uv: np.ndarray) -> Domain:
    """Of quads and their corners in the map, each divided along one of its diagonals; the outline's vertices first."""
    halves = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
    which = [halves[q % 2] for q in range(len(quads))]
    triangles = np.concatenate([quad[half] for quad, half in zip(quads, which, strict=True)])
    corners = np.concatenate([place[half] for place, half in zip(uv, which, strict=True)]).astype(float)
    loops, inside = loops_of(triangles)
    order = np.concatenate([*loops, inside]).astype(np.int64)
    number = np.argsort(order)
    valence = np.bincount(quads.ravel(), minlength=len(points))[order]
    sizes = [len(loop) for loop in loops]
    n = sum(sizes)
    starts = np.cumsum([0, *sizes])
    after = np.concatenate([np.roll(np.arange(a, b), -1) for a, b in pairwise(starts)])
    index = np.where(np.arange(len(points)) < n, valence, 4 - valence)
    loop = np.repeat(np.arange(len(sizes)), sizes)
    rotation = np.zeros((len(triangles), 3), np.int64)
    return Domain(points[order], number[triangles], corners, rotation, index, after, loop, np.zeros(n, bool))


def of_cells(cells: Cells) -> Domain:
    """Unit squares, given by their lower left corners, with the identity as the map."""
    corners = np.array([[(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)] for x, y in sorted(cells)])
    points, number = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return domain(points.astype(float), number.reshape(-1, 4), corners)


def ring(around: int, across: int) -> Domain:
    """Squares around a hole; the outer circle lies off the inner one's centre."""
    i, j = np.meshgrid(np.arange(around), np.arange(across + 1))
    angle, share = -2 * np.pi * i / around, j / across
    points = np.stack([(1 + share) * np.cos(angle) + 0.3 * share, (1 + share) * np.sin(angle)], -1)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(around), np.arange(across)))
    steps = [(0, 0), (1, 0), (1, 1), (0, 1)]
    quads = np.stack([(y + b) * around + (x + a) % around for a, b in steps], 1)
    uv = np.stack([np.stack([x + a, y + b], 1) for a, b in steps], 1)
    return domain(points.reshape(-1, 2), quads, uv)


@st.composite
def unions(draw: st.DrawFn) -> Cells:
    """Unions of rectangles of squares, of one piece and without pinched points."""
    part = st.tuples(st.integers(0, 8), st.integers(0, 8), st.integers(1, 5), st.integers(1, 5))
    parts = draw(st.lists(part, min_size=1, max_size=9))
    cells = frozenset((x + i, y + j) for x, y, w, h in parts for i in range(w) for j in range(h))
    for x, y in cells:
        for dx in (-1, 1):
            for dy in (-1, 1):
                beside = {(x + dx, y), (x, y + dy)} & cells
                assume(beside or (x + dx, y + dy) not in cells)
    assume(len(flood(cells, set())) == 1)
    return cells


def flood(cells: Cells, walls: set[tuple[float, float]]) -> list[Cells]:
    """Connected groups of squares; a wall is the midpoint of a side."""
    groups, left = [], set(cells)
    while left:
        todo = [left.pop()]
        group = set(todo)
        while todo:
            x, y = todo.pop()
            for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                other = (x + dx, y + dy)
                if other in left and (x + 0.5 + dx / 2, y + 0.5 + dy / 2) not in walls:
                    left.remove(other)
                    group.add(other)
                    todo.append(other)
        groups.append(frozenset(group))
    return groups


def walls_of(mesh: TMesh) -> set[tuple[float, float]]:
    """Midpoints of the sides of squares that arcs cover, both halves of each."""
    halves: set[tuple[float, float]] = set()
    for line in mesh.arc_points:
        for a, b in pairwise(line):
            steps = round(2 * np.abs(b - a).sum())
            halves.update(tuple(a + (b - a) * (k + 0.5) / steps) for k in range(steps))
    half = {(round(4 * x) / 4, round(4 * y) / 4) for x, y in halves}
    whole = {(x + dx, y + dy) for x, y in half for dx, dy in ((0.25, 0), (0, 0.25))}
    return {
        (x, y) for x, y in whole if {(x - 0.25, y), (x + 0.25, y)} <= half or {(x, y - 0.25), (x, y + 0.25)} <= half
    }


def size(group: Cells) -> tuple[int, int]:
    """Width and height of a group of squares, which must be a rectangle, the smaller one first."""
    low, high = np.min(list(group), axis=0), np.max(list(group), axis=0) + 1
    width, height = (int(x) for x in high - low)
    assert len(group) == width * height
    return min(width, height), max(width, height)


def sizes(mesh: TMesh) -> Counter[tuple[int, int]]:
    """The same of the faces, by their lengths in the map."""
    found: Counter[tuple[int, int]] = Counter()
    for face in mesh.faces:
        a, b, c, d = (float(mesh.arc_length[side // 2].sum()) for side in face)
        assert a == pytest.approx(c, abs=1e-9)
        assert b == pytest.approx(d, abs=1e-9)
        found[(round(min(a, b)), round(max(a, b)))] += 1
    return found


def origin(mesh: TMesh, half: np.ndarray) -> np.ndarray:
    return mesh.arc_nodes[half // 2, half % 2]


def check(mesh: TMesh, euler: int) -> None:
    """What holds for every T-mesh."""
    assert len(mesh.node_kind) - len(mesh.arc_nodes) + len(mesh.faces) == euler
    halves = np.concatenate([side for face in mesh.faces for side in face])
    outside = 2 * np.flatnonzero(mesh.arc_loop >= 0) + 1
    every = np.setdiff1d(np.arange(2 * len(mesh.arc_nodes)), outside)
    np.testing.assert_array_equal(np.sort(halves), every)
    for face in mesh.faces:
        around = np.concatenate(face)
        np.testing.assert_array_equal(origin(mesh, around ^ 1), np.roll(origin(mesh, around), -1))
    np.testing.assert_array_equal(origin(mesh, mesh.sector_next), origin(mesh, np.arange(2 * len(mesh.arc_nodes))))
    full = np.bincount(origin(mesh, np.arange(2 * len(mesh.arc_nodes))), mesh.sector_quarters)
    inside = mesh.node_loop < 0
    np.testing.assert_array_equal(full[inside], 4 - mesh.node_index[inside])
    corner = (mesh.node_kind == 0) & ~inside
    np.testing.assert_array_equal(full[corner], mesh.node_index[corner])
    assert set(full[mesh.node_kind == 2].tolist()) <= {2}
    for i, (line, places) in enumerate(zip(mesh.arc_points, mesh.arc_places, strict=True)):
        np.testing.assert_allclose(line[[0, -1]], mesh.node_point[mesh.arc_nodes[i]], atol=1e-12)
        assert len(line) == len(places)
        assert places[0] == 0
        assert (np.diff(places) >= 0).all()


@settings(max_examples=150, deadline=None)
@given(unions(), st.integers(0, 2**32 - 1))
def test_unions_of_squares_fall_into_the_rectangles_that_their_arcs_enclose(cells, seed):
    shape = of_cells(cells)
    mesh = shape.t_mesh()
    check(mesh, 2 - int(shape.outline_loop.max() + 1))
    assert Counter(size(group) for group in flood(cells, walls_of(mesh))) == sizes(mesh)
    turned = shape.with_turned_charts(np.random.default_rng(seed)).t_mesh()
    check(turned, 2 - int(shape.outline_loop.max() + 1))
    assert Counter(turned.node_kind.tolist()) == Counter(mesh.node_kind.tolist())
    assert sizes(turned) == sizes(mesh)


def test_an_l_is_cut_at_its_reflex_corner():
    mesh = of_cells(frozenset({(0, 0), (1, 0), (0, 1)})).t_mesh()
    assert Counter(mesh.node_kind.tolist()) == {0: 6, 2: 2}
    assert sizes(mesh) == {(1, 1): 3}
    assert mesh.node_critical.sum() == 6
    assert sorted(mesh.node_index.tolist()) == [0, 0, 1, 1, 1, 1, 1, 3]


def test_traces_of_a_plus_meet_half_way():
    mesh = of_cells(frozenset({(1, 1), (0, 1), (2, 1), (1, 0), (1, 2)})).t_mesh()
    joins = mesh.node_kind == 3
    expected = [[1, 1.5], [1.5, 1], [1.5, 2], [2, 1.5]]
    assert sorted(mesh.node_point[joins].tolist()) == expected
    assert sizes(mesh) == {(1, 1): 5}


def test_positions_on_the_outline_are_ranks_and_fractions():
    """A single notch: its corners send traces across, to vertices of the outline."""
    shape = of_cells(frozenset({(x, y) for x in range(3) for y in range(2)} - {(1, 1)}))
    mesh = shape.t_mesh()
    for node in np.flatnonzero(mesh.node_loop == 0):
        rank, fraction = divmod(mesh.node_position[node], 1)
        a = int(rank) % len(shape.outline_next)
        b = shape.outline_next[a]
        place = (1 - fraction) * shape.points[a] + fraction * shape.points[b]
        np.testing.assert_allclose(place, mesh.node_point[node], atol=1e-12)
    outline = mesh.arc_loop == 0
    span = np.diff(mesh.arc_interval[outline], axis=1)
    assert span.min() >= 0
    assert span.sum() == len(shape.outline_next)
    assert mesh.arc_size[outline].sum() == pytest.approx(mesh.arc_length[outline].sum())


@pytest.mark.parametrize("start", [0, 3, 7])
def test_a_ring_is_cut_once_where_the_outer_loop_is_farthest_from_the_centroid(start):
    """The outer circle is moved to the right and the centroid further: on the left, whichever vertex comes first."""
    shape = ring(8, 2)
    turned = np.roll(np.arange(16).reshape(2, 8), start, axis=1).ravel()
    order = np.concatenate([turned, np.arange(16, len(shape.points))])
    number = np.argsort(order)
    shape.points, shape.index, shape.triangles = shape.points[order], shape.index[order], number[shape.triangles]
    shape.outline_next = number[shape.outline_next[turned]]
    mesh = shape.t_mesh()
    check(mesh, 0)
    assert (len(mesh.node_kind), len(mesh.arc_nodes), len(mesh.faces)) == (2, 3, 1)
    assert not mesh.node_critical.any()
    np.testing.assert_allclose(mesh.node_point[mesh.node_kind == 0], [[-1.7, 0]], atol=1e-12)


def test_arrays_are_read_only():
    mesh = of_cells(frozenset({(0, 0)})).t_mesh()
    for array in (mesh.node_point, mesh.arc_points[0], mesh.faces[0][0], mesh.sector_next):
        assert not array.flags.writeable


def test_a_map_that_contradicts_its_indices_is_refused():
    shape = of_cells(frozenset({(0, 0), (1, 0), (0, 1), (1, 1)}))
    shape.index[8] = -1
    with pytest.raises(NoLayoutError, match=r"T-mesh: vertex 8 at \[1\.0, 1\.0\] sends 4 traces .* wants 5") as caught:
        shape.t_mesh()
    assert caught.value.stage == "T-mesh"


def test_arrays_of_different_sizes_are_refused():
    shape = of_cells(frozenset({(0, 0)}))
    shape.index = shape.index[:3]
    with pytest.raises(NoLayoutError, match="3 indices of vertices for 4"):
        shape.t_mesh()
