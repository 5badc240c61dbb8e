"""Integer arc lengths -> a conforming layout of quads, with a guess of where its vertices are."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ...numeric.arrays import FloatArray, IntArray
from .gluing import Gluing, RingPoint, boundary_rings, glue
from .places import arc_length_at, inner_points
from .reasons import NoLayoutError
from .sampling import SampledOutline
from .t_mesh import TMesh

__all__ = ["AbstractLayout", "assemble", "check_layout"]

STAGE = "assembly"


@dataclass(frozen=True, eq=False)
class AbstractLayout:
    """Conforming quads whose edges have no shape yet.

    Vertices on the outline come first, loop by loop in the order of the outline's polygons.

    Attributes
    ----------
    quads : (m, 4) array of int
        Vertices of every quad, counter-clockwise.
    boundary_vertices : (b,) array of int
        Vertices on the outline.
    boundary_loop : (b,) array of int
        Their loops.
    boundary_s : (b,) array
        Their arc lengths on the user's outline.
    corner : (b,) array of bool
        Whether each is a corner of the outline.
    points : (n, 2) array
        Where each vertex may start: exactly on the outline, roughly inside.
    valence : (n,) array of int
        Quads at every vertex.
    """

    quads: IntArray
    boundary_vertices: IntArray
    boundary_loop: IntArray
    boundary_s: FloatArray
    corner: NDArray[np.bool_]
    points: FloatArray
    valence: IntArray

    def __post_init__(self) -> None:
        for field in fields(self):
            getattr(self, field.name).flags.writeable = False


@dataclass(frozen=True)
class _Boundary:
    """Where the vertices on the outline are: label -> (loop, arc length, corner)."""

    label: list[int]
    loop: list[int]
    s: list[float]
    corner: list[bool]


def assemble(t_mesh: TMesh, outline: SampledOutline, lengths: Sequence[int] | IntArray) -> AbstractLayout:
    """The layout that integer arc lengths describe.

    Every face becomes a grid of quads; faces without area become lines. Points that divide an arc are at equal
    lengths of the map.

    Parameters
    ----------
    t_mesh : TMesh
    outline : SampledOutline
    lengths : (a,) array of int

    Raises
    ------
    NoLayoutError
        Where the lengths do not make a layout: quads with repeated vertices, a boundary that touches itself, ...
    """
    gluing = glue(t_mesh, [int(x) for x in lengths])
    if not gluing.grids:
        raise NoLayoutError(STAGE, "all faces are collapsed")
    boundary = _boundary(t_mesh, outline, gluing)
    quads = gluing.quads
    inner = np.setdiff1d(quads, boundary.label)
    number = {label: i for i, label in enumerate([*boundary.label, *inner.tolist()])}
    vertices = np.array([[number[label] for label in quad] for quad in quads.tolist()], dtype=np.int64)
    valence = np.bincount(vertices.ravel(), minlength=len(number)).astype(np.int64)
    layout = AbstractLayout(
        quads=vertices,
        boundary_vertices=np.arange(len(boundary.label), dtype=np.int64),
        boundary_loop=np.array(boundary.loop, dtype=np.int64),
        boundary_s=np.array(boundary.s),
        corner=np.array(boundary.corner),
        points=_points(t_mesh, outline, gluing, boundary, number),
        valence=valence,
    )
    check_layout(layout, len(outline.outlines))
    _check_valences(t_mesh, gluing, boundary, number, valence)
    return layout


def _boundary(t_mesh: TMesh, outline: SampledOutline, gluing: Gluing) -> _Boundary:
    label, loops, s, corner = [], [], [], []
    is_corner = [
        bool(critical and node_loop >= 0 and not np.isnan(outline.corner_angle[vertex]))
        for critical, node_loop, vertex in zip(t_mesh.node_critical, t_mesh.node_loop, t_mesh.node_vertex, strict=True)
    ]
    for loop, ring in enumerate(boundary_rings(t_mesh, gluing)):
        count = int((outline.loop == loop).sum())
        for run in _runs(ring, count):
            fixed = [point for point in run if point.point < len(is_corner) and t_mesh.node_critical[point.point]]
            # Where several points have become one, a corner has its place, all others are in the middle.
            places = [point.position for point in fixed or (run[0], run[-1])]
            position = (places[0] + places[-1]) / 2
            label.append(run[0].label)
            loops.append(loop)
            s.append(float(arc_length_at(outline, loop, np.array([position]))[0]))
            corner.append(any(is_corner[point.point] for point in fixed))
    if len(set(label)) < len(label):
        raise NoLayoutError(STAGE, "the boundary touches itself: two of its points are one vertex")
    return _Boundary(label, loops, s, corner)


def _runs(ring: list[RingPoint], count: int) -> list[list[RingPoint]]:
    """Stretches of a ring of one label each; positions go on rising over the loop's start."""
    starts = [i for i, point in enumerate(ring) if point.label != ring[i - 1].label] or [0]
    runs = []
    for start, end in zip(starts, [*starts[1:], starts[0] + len(ring)], strict=True):
        turn = [(i // len(ring), ring[i % len(ring)]) for i in range(start, end)]
        runs.append([RingPoint(p.position + shift * count, p.label, p.arc, p.point) for shift, p in turn])
    return runs


def _points(
    t_mesh: TMesh, outline: SampledOutline, gluing: Gluing, boundary: _Boundary, number: dict[int, int]
) -> FloatArray:
    """Places: of the outline; of nodes, critical ones first; along arcs; and in faces between their sides."""
    at: dict[int, FloatArray] = {}
    for label, loop, s in zip(boundary.label, boundary.loop, boundary.s, strict=True):
        at[label] = outline.outlines[loop].point(s)
    ranked: list[dict[int, list[FloatArray]]] = [defaultdict(list) for _ in range(3)]
    for node, point in enumerate(t_mesh.node_point):
        ranked[0 if t_mesh.node_critical[node] else 1][int(gluing.label[node])].append(point)
    for arc, edges in enumerate(gluing.lengths):
        if edges > 1:
            for j, point in enumerate(inner_points(t_mesh, arc, edges), start=gluing.first[arc]):
                ranked[2][int(gluing.label[j])].append(point)
    for found in ranked:
        for label, points in found.items():
            at.setdefault(label, np.mean(points, axis=0))
    out = np.empty((len(number), 2))
    for _, grid in gluing.grids:
        sides = np.array([[at.get(int(label), np.zeros(2)) for label in column] for column in grid])
        for (i, j), point in np.ndenumerate(grid):
            out[number[int(point)]] = at[int(point)] if int(point) in at else _between(sides, i, j)
    return out


def _between(sides: FloatArray, i: int, j: int) -> FloatArray:
    """Inner point of a grid: bilinearly blended between its four sides (Coons)."""
    u, v = i / (len(sides) - 1), j / (sides.shape[1] - 1)
    across = (1 - u) * sides[0, j] + u * sides[-1, j] + (1 - v) * sides[i, 0] + v * sides[i, -1]
    corners = (1 - v) * ((1 - u) * sides[0, 0] + u * sides[-1, 0]) + v * ((1 - u) * sides[0, -1] + u * sides[-1, -1])
    return np.asarray(across - corners)


def check_layout(layout: AbstractLayout, loops: int) -> None:
    """Raise unless the quads are a layout of a domain with so many boundary loops.

    Raises
    ------
    NoLayoutError
        On a quad with a repeated vertex, an edge that two quads have on one side, two quads that share three
        vertices, an interior vertex of two quads, a boundary other than the loops, or a wrong Euler number.
    """
    quads = layout.quads.tolist()
    for q, quad in enumerate(quads):
        if len(set(quad)) < 4:
            raise NoLayoutError(STAGE, f"quad {q} {quad} has a repeated vertex")
    edges = [(quad[i - 1], quad[i]) for quad in quads for i in range(4)]
    directed = set(edges)
    for (a, b), times in Counter(edges).items():
        if times > 1:
            raise NoLayoutError(STAGE, f"edge ({a}, {b}) belongs to {times} quads on one side")
    count = len(layout.points)
    on_boundary = set(layout.boundary_vertices.tolist())
    for v in range(count):
        if layout.valence[v] < (1 if v in on_boundary else 3):
            raise NoLayoutError(STAGE, f"vertex {v} has {layout.valence[v]} quads")
    _check_neighbours(quads)
    follows = {a: b for a, b in edges if (b, a) not in directed}
    free = sum((b, a) not in directed for a, b in edges)
    if len(follows) < free or set(follows) != on_boundary:
        raise NoLayoutError(STAGE, "the boundary of the quads touches itself or is not the outline")
    _check_loops(layout, follows)
    euler = count - (len(edges) + free) // 2 + len(quads)
    if euler != 2 - loops:
        raise NoLayoutError(STAGE, f"the Euler number is {euler}, not {2 - loops}")


def _check_neighbours(quads: list[list[int]]) -> None:
    at: dict[int, list[int]] = defaultdict(list)
    for q, quad in enumerate(quads):
        for v in quad:
            at[v].append(q)
    for q, quad in enumerate(quads):
        shared = Counter(other for v in quad for other in at[v] if other > q)
        for other, times in sorted(shared.items()):
            if times > 2:
                raise NoLayoutError(STAGE, f"quads {q} and {other} share {times} vertices")


def _check_loops(layout: AbstractLayout, follows: dict[int, int]) -> None:
    """The boundary edges run through the vertices of each loop in their order."""
    for loop in np.unique(layout.boundary_loop).tolist():
        vertices = layout.boundary_vertices[layout.boundary_loop == loop].tolist()
        for a, b in zip(vertices, [*vertices[1:], vertices[0]], strict=True):
            if follows[a] != b:
                raise NoLayoutError(STAGE, f"vertex {a} of loop {loop} is followed by {follows[a]}, not by {b}")


def _check_valences(
    t_mesh: TMesh, gluing: Gluing, boundary: _Boundary, number: dict[int, int], valence: IntArray
) -> None:
    """Every vertex has the quads that the critical points in it ask for."""
    wanted = {label: 2 if i < len(boundary.label) else 4 for label, i in number.items()}
    for node in np.flatnonzero(t_mesh.node_critical).tolist():
        label = int(gluing.label[node])
        if label in wanted:
            index = int(t_mesh.node_index[node])
            wanted[label] += index - 2 if t_mesh.node_loop[node] >= 0 else -index
    for label, quads in wanted.items():
        if valence[number[label]] != quads:
            raise NoLayoutError(STAGE, f"vertex {number[label]} has {valence[number[label]]} quads instead of {quads}")
