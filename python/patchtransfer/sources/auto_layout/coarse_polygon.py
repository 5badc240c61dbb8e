"""A coarse polygon of the outline: few nodes, and the topology of the domain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...geometry.outline import Outline
from ...numeric.arrays import FloatArray, IntArray
from .directed_loop import DirectedLoop, directed_loops
from .reasons import NoLayoutError

__all__ = ["CoarsePolygon", "angle_between", "coarse_polygon"]

#: A chord's arc turns by no more (radians): a cubic with three spans follows a quarter of a circle within 1e-4.
MOST_TURN = np.pi / 2
#: Part of the turning in the measure that spaces nodes; the rest is arc length, which straight pieces have too.
BY_TURNING = 0.7
#: Samples of a smooth piece, and of an arc.
PIECE_SAMPLES, ARC_SAMPLES = 256, 16
#: Other nodes keep this part of an arc's height away from its chord: nearer ones make slivers of triangles.
CLEARANCE = 0.5
#: Chords at a node differ from the curve's tangents by less (radians), so that polygon and curve turn alike.
MOST_DEVIATION = np.radians(80.0)
#: Area of a triangle beside its sides' product below which its sign is rounding.
FLAT = 1e-13
#: Nodes of a polygon that could still be laid out; walls that need more are told apart by none.
MOST_NODES = 1000
#: Halvings of arcs: walls a millionth of the diameter apart are still told apart.
ROUNDS = 24


@dataclass(frozen=True, eq=False)
class CoarsePolygon:
    """Nodes on the outline, loop by loop in the user's order, the domain on the left of each.

    Attributes
    ----------
    loops : tuple of DirectedLoop
    loop : (n,) array of int
    t : (n,) array
        Arc length of every node on its directed loop.
    next : (n,) array of int
        The node that follows.
    points : (n, 2) array
    arriving, leaving : (n, 2) arrays
        The curve's unit tangents.
    angle : (n,) array
        Interior angle of the curve in radians, pi where it is smooth.
    corner : (n,) array of bool
    """

    loops: tuple[DirectedLoop, ...]
    loop: IntArray
    t: FloatArray
    next: IntArray
    points: FloatArray
    arriving: FloatArray
    leaving: FloatArray
    angle: FloatArray
    corner: NDArray[np.bool_]

    @property
    def polygons(self) -> list[IntArray]:
        """Nodes loop by loop."""
        return [np.flatnonzero(self.loop == k) for k in range(len(self.loops))]

    @property
    def arc_lengths(self) -> FloatArray:
        """Of the arc from every node to the next."""
        length = np.array([loop.length for loop in self.loops])[self.loop]
        return np.asarray(length - np.mod(self.t - self.t[self.next], length))

    def on_arc(self, node: IntArray, fraction: float) -> tuple[FloatArray, FloatArray]:
        """Arc lengths on directed loops, and points, at a fraction of the arcs that leave nodes."""
        t = self.t[node] + fraction * self.arc_lengths[node]
        points = np.empty((len(node), 2))
        for k, loop in enumerate(self.loops):
            of = self.loop[node] == k
            points[of] = loop.point(t[of])
        return t, points


def coarse_polygon(outlines: Sequence[Outline]) -> CoarsePolygon:
    """Corners, points so that arcs turn by little, and more of them until the polygon is like the outline.

    That is: it is simple, its loops are nested as the outline's, and no node lies between an arc and its chord.

    Parameters
    ----------
    outlines : sequence of Outline
        Loops of a valid outline.

    Raises
    ------
    NoLayoutError
        When halving arcs does not end, as on loops that cross or touch.
    """
    loops = directed_loops(outlines)
    nodes = [_first_nodes(loop) for loop in loops]
    for _ in range(ROUNDS):
        polygon = _polygon(loops, nodes)
        bad = _bad_arcs(polygon)
        if not bad.any():
            return polygon
        if len(bad) > MOST_NODES:
            break
        middle = polygon.t + polygon.arc_lengths / 2
        nodes = [
            np.sort(np.concatenate([t, np.mod(middle[bad & (polygon.loop == k)], loop.length)]))
            for k, (t, loop) in enumerate(zip(nodes, loops, strict=True))
        ]
    x, y = polygon.points[np.flatnonzero(bad)[0]]
    raise NoLayoutError(
        "coarse polygon",
        f"near ({x:.6g}, {y:.6g}) walls are too close to tell apart; the outline may touch itself there",
    )


def _first_nodes(loop: DirectedLoop) -> FloatArray:
    """Corners, and points between them so that no arc turns by more than the limit; at least three."""
    corners = loop.corners
    breaks = corners if len(corners) else np.zeros(1)
    nodes = []
    for a, b in zip(breaks, np.append(breaks[1:], breaks[0] + loop.length), strict=True):
        t = np.linspace(a, b, PIECE_SAMPLES)
        # Tangents of the middles: ends may be corners.
        tangent = loop.tangents((t[1:] + t[:-1]) / 2)[1]
        turning = np.abs(angle_between(tangent[:-1], tangent[1:])).cumsum()
        turned = np.concatenate([[0.0], turning, turning[-1:]])
        # The sampled turning misses half a step at either end.
        count = max(int(np.ceil(turned[-1] / MOST_TURN * (1 - 1 / PIECE_SAMPLES) - 1e-6)), 3 if not len(corners) else 1)
        even = np.linspace(0.0, 1.0, len(t))
        measure = even if turned[-1] < 1e-6 else BY_TURNING * turned / turned[-1] + (1 - BY_TURNING) * even
        nodes.append(np.interp(np.arange(count) / count, measure, t))
    found = np.concatenate(nodes)
    while len(found) < 3:
        gaps = np.append(found[1:], found[0] + loop.length) - found
        found = np.sort(np.append(found, found[gaps.argmax()] + gaps.max() / 2))
    return np.unique(np.mod(found, loop.length))


def _polygon(loops: Sequence[DirectedLoop], nodes: Sequence[FloatArray]) -> CoarsePolygon:
    sizes = [len(t) for t in nodes]
    starts = np.cumsum([0, *sizes[:-1]])
    following = np.concatenate([start + np.roll(np.arange(n), -1) for start, n in zip(starts, sizes, strict=True)])
    arriving, leaving = (
        np.concatenate(side) for side in zip(*(x.tangents(t) for x, t in zip(loops, nodes, strict=True)), strict=True)
    )
    is_corner = [np.isin(t, loop.corners) for loop, t in zip(loops, nodes, strict=True)]
    corner = np.concatenate(is_corner)
    angle = np.where(corner, np.pi - angle_between(arriving, leaving), np.pi)
    return CoarsePolygon(
        tuple(loops),
        np.repeat(np.arange(len(loops)), sizes),
        np.concatenate(nodes),
        following,
        np.concatenate([loop.point(t) for loop, t in zip(loops, nodes, strict=True)]),
        arriving,
        leaving,
        angle,
        corner,
    )


def _bad_arcs(polygon: CoarsePolygon) -> NDArray[np.bool_]:
    """Arcs whose chords cross others, turn away from the curve, or have a node between them and the arc."""
    a, b = polygon.points, polygon.points[polygon.next]
    n = len(a)
    chord = b - a
    off_start = np.abs(angle_between(chord, polygon.leaving))
    off_end = np.abs(angle_between(chord, polygon.arriving[polygon.next]))
    bad = np.maximum(off_start, off_end) > MOST_DEVIATION
    node = np.arange(n)
    arc = np.stack([polygon.on_arc(node, f)[1] for f in np.arange(1, ARC_SAMPLES) / ARC_SAMPLES], axis=1)
    rings = np.concatenate([a[:, None], arc, b[:, None]], axis=1)
    length = np.linalg.norm(chord, axis=1)
    height = np.abs(_cross(chord[:, None], arc - a[:, None])).max(axis=1) / length
    for i in range(n):
        others = np.ones(n, bool)
        others[[i, polygon.next[i]]] = False
        points = a[others]
        along = np.clip((points - a[i]) @ chord[i] / length[i] ** 2, 0, 1)
        distance = np.linalg.norm(points - a[i] - along[:, None] * chord[i], axis=1)
        # Straight arcs have rounding for height.
        near = distance < max(CLEARANCE * height[i], 1e-9 * length[i])
        bad[i] |= bool(near.any() or (_winding(rings[i], points) != 0).any())
        apart = others & others[polygon.next]
        bad[i] |= bool((_crosses(a[i], b[i], a, b) & apart).any())
    # Halving a straight arc changes nothing: its neighbours have to give way.
    straight = height < 1e-9 * length
    return np.asarray(bad & ~straight if (bad & ~straight).any() else bad)


def angle_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Signed angles from vectors (..., 2) to others, in radians."""
    return np.asarray(np.arctan2(_cross(a, b), (a * b).sum(axis=-1)))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _crosses(p: FloatArray, q: FloatArray, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    """Whether the segment p q crosses segments a b, (n,), which more than touch or lie on its line."""
    least = FLAT * np.abs(q - p).max() * np.abs(np.concatenate([a - p, b - p])).max()
    first, second = _cross(q - p, a - p), _cross(q - p, b - p)
    third, fourth = _cross(b - a, p - a), _cross(b - a, q - a)
    across = (np.minimum(first, second) < -least) & (np.maximum(first, second) > least)
    return np.asarray(across & (third * fourth < 0))


def _winding(ring: FloatArray, points: FloatArray) -> IntArray:
    """How often a closed ring (m, 2) runs round points (n, 2)."""
    out = ring[None] - points[:, None]
    turns = angle_between(out, np.roll(out, -1, axis=1)).sum(axis=1) / (2 * np.pi)
    return np.asarray(np.rint(turns), np.int64)
