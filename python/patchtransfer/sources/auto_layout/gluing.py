"""Integer arc lengths make points: of arcs, of faces, and glued into one where something has length zero."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ...numeric.arrays import IntArray
from ...numeric.components import components
from .places import inner_positions
from .t_mesh import TMesh

__all__ = ["Gluing", "Link", "RingPoint", "boundary_rings", "glue"]


@dataclass(frozen=True)
class Link:
    """Two points glued by one face without area or one arc of length zero.

    Attributes
    ----------
    point : int
        The other point.
    path : tuple of int
        Half-arcs from the node of the one to the node of the other, along the face's outline. A point inside an arc
        stands at the arc's first node.
    """

    point: int
    path: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Gluing:
    """Points of a T-mesh with integer arc lengths, and which of them are one.

    Points are numbered: nodes, then inner points of arcs, then inner points of faces.

    Attributes
    ----------
    lengths : list of int
        Edges of every arc.
    first : list of int
        First inner point of every arc, and the first inner point of a face.
    label : (n,) array of int
        Smallest point of the class of every point.
    grids : list of (face, (w + 1, h + 1) array of int)
        Labels of the points of every face that is left, along its first and its second side.
    links : dict of point to list of Link
        What glues the points.
    """

    lengths: list[int]
    first: list[int]
    label: IntArray
    grids: list[tuple[int, IntArray]]
    links: dict[int, list[Link]]

    @property
    def quads(self) -> IntArray:
        """Labels of the corners of every quad (m, 4), counter-clockwise."""
        corners = [
            np.stack([g[:-1, :-1], g[1:, :-1], g[1:, 1:], g[:-1, 1:]], axis=2).reshape(-1, 4) for _, g in self.grids
        ]
        return np.concatenate(corners) if corners else np.zeros((0, 4), dtype=np.int64)

    @property
    def quad_face(self) -> IntArray:
        """Face of every quad."""
        sizes = [(points.shape[0] - 1) * (points.shape[1] - 1) for _, points in self.grids]
        return np.repeat(np.array([face for face, _ in self.grids], dtype=np.int64), sizes)

    def arc_of(self, point: int) -> int:
        """The arc that a point lies inside, or -1 for a node."""
        if point < self.first[0]:
            return -1
        # Arcs of at most one edge have no inner points: the last of those that start here is meant.
        return bisect_right(self.first, point) - 1

    def path(self, start: int, end: int, avoid: Collection[int] = ()) -> list[int] | None:
        """Half-arcs between the nodes of two glued points, through what glues them, over the fewest links.

        An arc that the path crosses at an inner point is passed there and back, so that the path leaves the arc's
        node on the side where it came.

        Parameters
        ----------
        start, end : int
        avoid : collection of int
            Points that the path must not go through.
        """
        came: dict[int, tuple[int, Link]] = {}
        queue = deque([start])
        while queue:
            point = queue.popleft()
            if point == end:
                return self._unwound(came, start, end)
            for link in self.links.get(point, ()) if point == start or point not in avoid else ():
                if link.point != start and link.point not in came:
                    came[link.point] = (point, link)
                    queue.append(link.point)
        return None

    def _unwound(self, came: dict[int, tuple[int, Link]], start: int, end: int) -> list[int]:
        pieces: list[tuple[int, ...]] = []
        point = end
        while point != start:
            before, link = came[point]
            pieces.append(link.path)
            arc = self.arc_of(before)
            if arc >= 0:
                pieces.append((2 * arc, 2 * arc + 1))
            point = before
        ends = [(2 * arc, 2 * arc + 1) if (arc := self.arc_of(end)) >= 0 else ()]
        return [half for piece in [*reversed(pieces), *ends] for half in piece]


class _FaceOutline:
    """Points around a face.

    Attributes
    ----------
    halves : list of int
        Its half-arcs, side by side.
    sides : 4 lists of (point, rank)
        Points of each side with its ends, and the rank in `halves` at whose origin each stands.
    """

    def __init__(self, face: tuple[IntArray, ...], nodes: list[list[int]], first: list[int], x: list[int]) -> None:
        self.halves: list[int] = []
        self.sides: list[list[tuple[int, int]]] = []
        for side in face:
            points: list[tuple[int, int]] = []
            for half in side.tolist():
                rank, (arc, back) = len(self.halves), divmod(half, 2)
                inner = range(first[arc], first[arc] + x[arc] - 1)
                points = (
                    [*points[: -1 if x[arc] else None], (nodes[arc][back], rank)] if x[arc] or not points else points
                )
                if x[arc]:
                    points += [(point, rank + back) for point in (reversed(inner) if back else inner)]
                    points.append((nodes[arc][1 - back], rank + 1))
                self.halves.append(half)
            self.sides.append(points)

    def path(self, start: int, end: int) -> tuple[int, ...]:
        """Half-arcs around the face between two ranks."""
        if start <= end:
            return tuple(self.halves[start:end])
        return tuple(half ^ 1 for half in reversed(self.halves[end:start]))


def glue(t_mesh: TMesh, lengths: Sequence[int]) -> Gluing:
    """Points of all arcs and faces; opposite points of faces without area are glued.

    Parameters
    ----------
    t_mesh : TMesh
    lengths : sequence of int
        Edges of every arc; opposite sides of a face have equal sums.
    """
    x = [int(value) for value in lengths]
    nodes = t_mesh.arc_nodes.tolist()
    count = len(t_mesh.node_kind)
    first = []
    for value in x:
        first.append(count)
        count += max(value - 1, 0)
    first.append(count)
    outlines = [_FaceOutline(face, nodes, first, x) for face in t_mesh.faces]
    links: dict[int, list[Link]] = {}

    def link(p: int, q: int, path: tuple[int, ...]) -> None:
        if p != q or path:
            links.setdefault(p, []).append(Link(q, path))
            links.setdefault(q, []).append(Link(p, tuple(half ^ 1 for half in reversed(path))))

    for arc, value in enumerate(x):
        if value == 0:
            link(nodes[arc][0], nodes[arc][1], (2 * arc,))
    for around in outlines:
        for near, far in ((0, 2), (1, 3)):
            if len(around.sides[1 - near]) == 1:
                for (p, i), (q, j) in zip(around.sides[near], around.sides[far][::-1], strict=True):
                    link(p, q, around.path(i, j))
    grids = []
    for face, around in enumerate(outlines):
        width, height = len(around.sides[0]), len(around.sides[1])
        if width > 1 and height > 1:
            inner = (width - 2) * (height - 2)
            grids.append((face, _grid(around, count)))
            count += inner
    pairs = np.array([(p, other.point) for p, others in links.items() for other in others], np.int64).reshape(-1, 2)
    number = components(count, *pairs.T)
    # The smallest member names all: components are numbered by it.
    label = np.unique(number, return_index=True)[1][number]
    return Gluing(x, first, label, [(face, label[points]) for face, points in grids], links)


def _grid(around: _FaceOutline, start: int) -> IntArray:
    sides = [[point for point, _ in side] for side in around.sides]
    width, height = len(sides[0]), len(sides[1])
    points = np.empty((width, height), dtype=np.int64)
    points[1:-1, 1:-1] = start + np.arange((width - 2) * (height - 2)).reshape(width - 2, height - 2)
    points[:, 0], points[:, -1] = sides[0], sides[2][::-1]
    points[0, :], points[-1, :] = sides[3][::-1], sides[1]
    return points


@dataclass(frozen=True)
class RingPoint:
    """A point of the outline.

    Attributes
    ----------
    position : float
        Place along its loop, as in `TMesh`.
    label : int
    arc : int
        The arc that starts at the point or contains it.
    point : int
        As numbered in `Gluing`.
    """

    position: float
    label: int
    arc: int
    point: int


def boundary_rings(t_mesh: TMesh, gluing: Gluing) -> list[list[RingPoint]]:
    """Points of every loop, in the order of their positions."""
    order = np.lexsort((t_mesh.arc_interval[:, 0], t_mesh.arc_loop))
    rings: list[list[RingPoint]] = [[] for _ in range(int(t_mesh.arc_loop.max(initial=-1)) + 1)]
    label = gluing.label
    for arc in order.tolist():
        loop = int(t_mesh.arc_loop[arc])
        if loop < 0:
            continue
        start = float(t_mesh.arc_interval[arc, 0])
        node = int(t_mesh.arc_nodes[arc, 0])
        rings[loop].append(RingPoint(start, int(label[node]), arc, node))
        x = gluing.lengths[arc]
        positions = inner_positions(t_mesh, arc, x)
        rings[loop] += [
            RingPoint(position, int(label[point]), arc, point)
            for point, position in enumerate(positions, start=gluing.first[arc])
        ]
    return rings
