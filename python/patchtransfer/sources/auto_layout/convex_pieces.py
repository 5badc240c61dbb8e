"""A coarse polygon cut into nearly convex pieces: triangulated, then merged (Hertel, Mehlhorn 1983).

Angles at the outline are those of the curve, to its tangents; at a smooth node, and at every corner too wide for one
patch, several pieces are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..._core import TriangulationError, triangulate
from ...numeric.arrays import FloatArray, IntArray
from .coarse_polygon import CoarsePolygon, angle_between
from .reasons import NoLayoutError

__all__ = ["Pieces", "convex_pieces", "quads_needed"]

#: Widest angle that one quad fills on the outline (radians): its scaled Jacobian there is at most the sine.
WIDEST = np.radians(145.0)
#: Widest angle of a merged piece.
WIDEST_MERGED = np.radians(165.0)
#: Most corners of a piece: it becomes so many quads round a vertex.
MOST_CORNERS = 6
#: What two quads less are worth beside squared deviations of angles, in units of right angles.
FEWER_QUADS = 0.5
#: Nodes of a polygon with a smaller interior angle than this get a partner inside with their neighbours.
CONVEX = np.radians(175.0)
#: Depth of a partner, as part of the shorter chord at its node, ...
DEPTH = 0.35
#: ... and how it is reduced until no other point is as near and no chord within the second factor of it.
SHRINK, CHORD_CLEARANCE = 0.7, 0.4
#: Rounds of adding partners, and reductions of one.
ROUNDS, REDUCTIONS = 8, 60


@dataclass(frozen=True, eq=False)
class Pieces:
    """Cycles of points that tile the polygon.

    Attributes
    ----------
    points : (n, 2) array
        The polygon's nodes first, then points inside.
    cycles : list of lists of int
        Counter-clockwise.
    """

    points: FloatArray
    cycles: list[list[int]]


def quads_needed(angle: FloatArray) -> IntArray:
    """Least number of quads that fill interior angles (radians) of the outline."""
    return np.maximum(np.ceil(angle / WIDEST - 1e-9), 1).astype(np.int64)


def convex_pieces(polygon: CoarsePolygon) -> Pieces:
    """Pieces of which enough meet at every node.

    Raises
    ------
    NoLayoutError
        When the polygon has no triangulation, or a node does not get its pieces.
    """
    points, triangles = _triangles_enough(polygon)
    merging = _Merging(polygon, points, triangles)
    merging.run()
    return Pieces(points, [cycle for cycle in merging.cycles if cycle])


def _triangles_enough(polygon: CoarsePolygon) -> tuple[FloatArray, list[list[int]]]:
    """Triangulate; where a node has too few triangles it gets a partner inside, which is joined to it."""
    n = len(polygon.points)
    needed = quads_needed(polygon.angle)
    points, partnered = polygon.points, np.zeros(n, bool)
    for _ in range(ROUNDS):
        try:
            _, triangles = triangulate(points, polygon.polygons)
        except TriangulationError as error:
            raise NoLayoutError("triangulation of the coarse polygon", str(error.args[0])) from error
        count = np.bincount(triangles.ravel(), minlength=len(points))[:n]
        poor = (count < needed) & ~partnered
        if not poor.any():
            break
        chosen = _runs(polygon, poor) & ~partnered
        points = np.concatenate([points, _partners(polygon, points, np.flatnonzero(chosen))])
        partnered |= chosen
    short = np.flatnonzero(count < needed)
    if len(short):
        x, y = polygon.points[short[0]]
        raise NoLayoutError(
            "convex pieces",
            f"the outline turns by {np.degrees(np.pi - polygon.angle[short[0]]):.0f} degrees at "
            f"({x:.6g}, {y:.6g}) and {count[short[0]]} pieces meet there; {needed[short[0]]} are needed",
        )
    return points, triangles.tolist()


def _runs(polygon: CoarsePolygon, poor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The nodes, and neighbours of smooth ones as far as the outline stays smooth and the polygon convex."""
    n = len(poor)
    before = np.empty(n, np.int64)
    before[polygon.next] = np.arange(n)
    out = polygon.points[polygon.next] - polygon.points
    back = polygon.points[before] - polygon.points
    wedge = np.mod(angle_between(out, back), 2 * np.pi)
    alike = ~polygon.corner & (wedge < CONVEX)
    chosen = poor.copy()
    for start in np.flatnonzero(poor & alike):
        for following in (polygon.next, before):
            v = following[start]
            while alike[v] and not chosen[v]:
                chosen[v] = True
                v = following[v]
    return chosen


def _partners(polygon: CoarsePolygon, points: FloatArray, nodes: IntArray) -> FloatArray:
    """A point inside for each of some nodes, on the bisector of its angle, nearer to it than to anything else.

    Its edge to the node is in every constrained Delaunay triangulation then.
    """
    a, b = polygon.points, polygon.points[polygon.next]
    length = np.linalg.norm(b - a, axis=1)
    before = np.empty(len(a), np.int64)
    before[polygon.next] = np.arange(len(a))
    made: list[FloatArray] = []
    for v in nodes:
        half = polygon.angle[v] / 2
        cosine, sine = np.cos(half), np.sin(half)
        x, y = polygon.leaving[v]
        inwards = np.array([cosine * x - sine * y, sine * x + cosine * y])
        others = np.delete(np.concatenate([points, *(p[None] for p in made)]), v, axis=0)
        apart = np.ones(len(a), bool)
        apart[[v, before[v]]] = False
        depth = DEPTH * min(length[v], length[before[v]])
        for _ in range(REDUCTIONS):
            place = a[v] + depth * inwards
            near = np.linalg.norm(others - place, axis=1).min()
            if (
                near > depth / SHRINK
                and _distance(place, a[apart], b[apart]).min(initial=np.inf) > CHORD_CLEARANCE * depth
            ):
                break
            depth *= SHRINK
        made.append(place)
    return np.array(made)


def _distance(point: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances of a point to segments a b."""
    way = b - a
    along = np.clip(((point - a) * way).sum(axis=1) / (way**2).sum(axis=1), 0, 1)
    return np.asarray(np.linalg.norm(a + along[:, None] * way - point, axis=1))


class _Merging:
    """Triangles that are merged over their common edges, the best first, while pieces stay good."""

    def __init__(self, polygon: CoarsePolygon, points: FloatArray, triangles: Sequence[list[int]]) -> None:
        self.polygon, self.points = polygon, points
        self.cycles = [list(t) for t in triangles]
        self.owner = {(c[i], c[(i + 1) % 3]): k for k, c in enumerate(self.cycles) for i in range(3)}
        self.count = np.bincount(np.concatenate([np.array(c) for c in self.cycles]), minlength=len(points))
        n = len(polygon.points)
        # A vertex inside needs three pieces for angles below 180 degrees.
        self.needed = np.concatenate([quads_needed(polygon.angle), np.full(len(points) - n, 3)])
        self.outgoing = dict(zip(range(n), polygon.next.tolist(), strict=True))
        # How far the curve's tangents turn away from the chords.
        chord = polygon.points[polygon.next] - polygon.points
        self.out_turn = angle_between(chord, polygon.leaving)
        self.back_turn = np.empty(n)
        self.back_turn[polygon.next] = angle_between(chord, polygon.arriving[polygon.next])
        self.cost = [self._cost(c) for c in self.cycles]

    def run(self) -> None:
        """Merge until nothing is gained."""
        gains = {edge: self._gain(edge) for edge in self.owner if edge[0] < edge[1]}
        while True:
            edge, gain = max(gains.items(), key=lambda item: (item[1], item[0]), default=((0, 0), 0.0))
            if gain <= 0:
                return
            kept = self._merge(edge)
            del gains[edge]
            changed = {self.owner[e] for e in self._edges(kept)} | {
                self.owner[b, a] for a, b in self._edges(kept) if (b, a) in self.owner
            }
            # The counts at the ends have changed for all pieces around them.
            for a, b in list(gains):
                if self.owner[a, b] in changed or edge[0] in (a, b) or edge[1] in (a, b):
                    gains[a, b] = self._gain((a, b))

    def _edges(self, k: int) -> list[tuple[int, int]]:
        cycle = self.cycles[k]
        return [(cycle[i - 1], cycle[i]) for i in range(len(cycle))]

    def _union(self, edge: tuple[int, int]) -> list[int]:
        a, b = edge
        first, second = self.cycles[self.owner[a, b]], self.cycles[self.owner[b, a]]
        i, j = first.index(b), second.index(a)
        # From b round the first to a, then round the second back to b.
        rest = second[j:] + second[:j]
        return first[i:] + first[:i] + rest[1:-1]

    def _gain(self, edge: tuple[int, int]) -> float:
        """What merging over an edge improves; -inf where it must not be."""
        a, b = edge
        if (b, a) not in self.owner or self.owner[a, b] == self.owner[b, a]:
            return -np.inf
        if self.count[a] <= self.needed[a] or self.count[b] <= self.needed[b]:
            return -np.inf
        union = self._union(edge)
        if len(union) > MOST_CORNERS or len(set(union)) < len(union):
            return -np.inf
        if self._angles(union).max() > WIDEST_MERGED:
            return -np.inf
        k, other = self.owner[a, b], self.owner[b, a]
        return self.cost[k] + self.cost[other] + FEWER_QUADS - self._cost(union)

    def _merge(self, edge: tuple[int, int]) -> int:
        a, b = edge
        k, other = self.owner[a, b], self.owner[b, a]
        union = self._union(edge)
        for way in (edge, (b, a)):
            del self.owner[way]
        self.cycles[k], self.cycles[other] = union, []
        self.count[[a, b]] -= 1
        self.cost[k] = self._cost(union)
        for e in self._edges(k):
            self.owner[e] = k
        return k

    def _angles(self, cycle: list[int]) -> FloatArray:
        """Angles at the corners of a piece, to the curve's tangents where its edges are chords."""
        n = len(self.out_turn)
        x = self.points[cycle]
        out, back = np.roll(x, -1, axis=0) - x, np.roll(x, 1, axis=0) - x
        angle = np.mod(angle_between(out, back), 2 * np.pi)
        for i, v in enumerate(cycle):
            if v < n:
                if self.outgoing[v] == cycle[(i + 1) % len(cycle)]:
                    angle[i] -= self.out_turn[v]
                if self.outgoing.get(cycle[i - 1]) == v:
                    angle[i] += self.back_turn[v]
        return angle

    def _cost(self, cycle: list[int]) -> float:
        """Squared deviations of angles from right ones, of the corners and round the middle."""
        n = len(cycle)
        right = np.pi / 2
        middle = 0.0 if n == 4 else n * (4 / n - 1) ** 2
        return float((((self._angles(cycle) - right) / right) ** 2).sum()) + middle
