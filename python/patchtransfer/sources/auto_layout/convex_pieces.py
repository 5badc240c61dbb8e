"""A coarse polygon cut into nearly convex pieces: triangulated, triangles united.

Angles at the outline are those of the curve, to its tangents; at a smooth node, and at every corner too wide for one
patch, several pieces are kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

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
#: What a quad costs beside squared deviations of angles in units of right angles: of equal pieces the fewer.
QUAD = 0.05
#: End of the search for the best pieces: branches, not seconds, so that the result is the same everywhere.
NODE_LIMIT = 2000
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
    return np.asarray(np.maximum(np.ceil(angle / WIDEST - 1e-9), 1), np.int64)


def convex_pieces(polygon: CoarsePolygon) -> Pieces:
    """Pieces of which enough meet at every node.

    Raises
    ------
    NoLayoutError
        When the polygon has no triangulation, or a node does not get its pieces.
    """
    points, triangles = _triangles_enough(polygon)
    return Pieces(points, _best_partition(polygon, points, triangles))


def _triangles_enough(polygon: CoarsePolygon) -> tuple[FloatArray, IntArray]:
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
    return points, triangles


def _runs(polygon: CoarsePolygon, poor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The nodes, and neighbours of smooth ones as far as the outline stays smooth and the polygon convex."""
    before, wedge = _wedges(polygon)
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
    """Points inside for some nodes, nearer to them than to anything else, one fewer than a node needs pieces.

    They share out the angle between its chords. Every constrained Delaunay triangulation has their edges to it.
    """
    a, b = polygon.points, polygon.points[polygon.next]
    length = np.linalg.norm(b - a, axis=1)
    before, wedge = _wedges(polygon)
    needed = quads_needed(polygon.angle)
    made: list[FloatArray] = []
    for v in nodes:
        x, y = (b[v] - a[v]) / length[v]
        turns = wedge[v] * np.arange(1, needed[v]) / needed[v]
        cosine, sine = np.cos(turns), np.sin(turns)
        inwards = np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
        others = np.delete(np.concatenate([points, *made]), v, axis=0)
        apart = np.ones(len(a), bool)
        apart[[v, before[v]]] = False
        depth = DEPTH * min(length[v], length[before[v]])
        for _ in range(REDUCTIONS):
            places = a[v] + depth * inwards
            near = np.linalg.norm(others[:, None] - places, axis=2).min()
            walls = min(_distance(place, a[apart], b[apart]).min(initial=np.inf) for place in places)
            if near > depth / SHRINK and walls > CHORD_CLEARANCE * depth:
                break
            depth *= SHRINK
        made.append(places)
    return np.concatenate(made)


def _wedges(polygon: CoarsePolygon) -> tuple[IntArray, FloatArray]:
    """The node before every node, and the angle between its chords in radians."""
    before = np.empty(len(polygon.points), np.int64)
    before[polygon.next] = np.arange(len(before))
    out, back = polygon.points[polygon.next] - polygon.points, polygon.points[before] - polygon.points
    return before, np.mod(angle_between(out, back), 2 * np.pi)


def _distance(point: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances of a point to segments a b."""
    way = b - a
    along = np.clip(((point - a) * way).sum(axis=1) / (way**2).sum(axis=1), 0, 1)
    return np.asarray(np.linalg.norm(a + along[:, None] * way - point, axis=1))


def _best_partition(polygon: CoarsePolygon, points: FloatArray, triangles: IntArray) -> list[list[int]]:
    """Unions of few triangles that contain each triangle once, enough at every point, at the least cost.

    Single triangles are among them, so that there always is one.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    unions = _unions(triangles)
    angles = _Angles(polygon, points)
    candidates = [
        (members, cycle, angle)
        for members, cycle in unions
        if (angle := angles.of(cycle)).max() <= WIDEST_MERGED or len(members) == 1
    ]
    cost = np.array([_cost(angle) for _, _, angle in candidates])
    triangle = np.concatenate([members for members, _, _ in candidates])
    corner = np.concatenate([cycle for _, cycle, _ in candidates])
    of_triangle = np.repeat(np.arange(len(candidates)), [len(members) for members, _, _ in candidates])
    of_corner = np.repeat(np.arange(len(candidates)), [len(cycle) for _, cycle, _ in candidates])
    once = coo_array((np.ones(len(triangle)), (triangle, of_triangle)), shape=(len(triangles), len(candidates)))
    around = coo_array((np.ones(len(corner)), (corner, of_corner)), shape=(len(points), len(candidates)))
    # A vertex inside needs three pieces for angles below 180 degrees.
    inside = np.full(len(points) - len(polygon.points), 3)
    needed = np.concatenate([quads_needed(polygon.angle), inside])
    found = milp(
        cost,
        integrality=np.ones(len(cost)),
        bounds=Bounds(0, 1),
        constraints=[LinearConstraint(once.tocsc(), 1, 1), LinearConstraint(around.tocsc(), needed, np.inf)],
        options={"node_limit": NODE_LIMIT, "mip_rel_gap": 0.0},
    )
    if found.x is None:
        return [list(t) for t in triangles.tolist()]
    return [candidates[k][1] for k in np.flatnonzero(found.x > 0.5)]


def _unions(triangles: IntArray) -> list[tuple[list[int], list[int]]]:
    """Members and boundary cycle of every union of triangles, joined by edges, that has few corners."""
    owner = {(int(t[i - 1]), int(t[i])): k for k, t in enumerate(triangles) for i in range(3)}
    latest = {frozenset([k]): t for k, t in enumerate(triangles.tolist())}
    found = dict(latest)
    for _ in range(MOST_CORNERS - 3):
        larger = {}
        for members, cycle in latest.items():
            for i, b in enumerate(cycle):
                a = cycle[i - 1]
                k = owner.get((b, a))
                if k is None or k in members or (union := members | {k}) in larger:
                    continue
                (apex,) = set(triangles[k].tolist()) - {a, b}
                # A corner that is there already would be touched twice, or lie inside.
                if apex not in cycle:
                    larger[union] = [*cycle[:i], apex, *cycle[i:]]
        found |= larger
        latest = larger
    return [(sorted(members), cycle) for members, cycle in found.items()]


class _Angles:
    """Angles at the corners of pieces, to the curve's tangents where edges are chords."""

    def __init__(self, polygon: CoarsePolygon, points: FloatArray) -> None:
        self.points, n = points, len(polygon.points)
        self.following = dict(zip(range(n), polygon.next.tolist(), strict=True))
        # How far the tangents turn away from the chords.
        chord = polygon.points[polygon.next] - polygon.points
        self.out_turn = angle_between(chord, polygon.leaving)
        self.back_turn = np.empty(n)
        self.back_turn[polygon.next] = angle_between(chord, polygon.arriving[polygon.next])

    def of(self, cycle: list[int]) -> FloatArray:
        """Angles in radians at the corners of a piece, in their order."""
        x = self.points[cycle]
        out, back = np.roll(x, -1, axis=0) - x, np.roll(x, 1, axis=0) - x
        angle = np.mod(angle_between(out, back), 2 * np.pi)
        for i, v in enumerate(cycle):
            if self.following.get(v) == cycle[(i + 1) % len(cycle)]:
                angle[i] -= self.out_turn[v]
            if self.following.get(cycle[i - 1]) == v:
                angle[i] += self.back_turn[v]
        return angle


def _cost(angles: FloatArray) -> float:
    """What a piece costs: angles that are not right ones, at its corners and round its middle, and quads."""
    n = len(angles)
    off = ((angles - np.pi / 2) / (np.pi / 2)) ** 2
    corners = float((off + off**3).sum())
    return corners + (QUAD if n == 4 else n * (4 / n - 1) ** 2 + n * QUAD)
