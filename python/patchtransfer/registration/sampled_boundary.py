"""Boundaries sampled for matching: nodes, corners, inner distances, and maps between nodes and arc length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .._core import inner_distances
from .._core import turning as core_turning
from ..geometry.outline import CORNER, Outline
from ..geometry.slivers import drawn_corners
from ..numeric.arrays import FloatArray, IntArray

__all__ = ["WINDOWS", "BoundaryShape", "NearDistances", "cyclic_gap", "image_of"]

#: Nodes of the outer loop, of a hole at most and at least, of all holes together about.
SAMPLES, HOLE_SAMPLES, FEWEST_SAMPLES, ALL_HOLES = 160, 32, 8, 320
#: Corners of a loop that become nodes at most, the sharpest ones.
MAX_CORNERS = 96
#: Corners nearer to a landmark, and regular nodes nearer to others, than these parts of a step are left out.
SAME_NODE, CROWDED = 0.1, 0.4
#: Windows of the turning descriptor, in parts of the loop's length.
WINDOWS = [1 / 48, 1 / 24, 1 / 12, 1 / 6]
#: Squared distance (relative to the root mean square) that softens the weight 1/d² of near distances.
SOFT = 0.02
#: Arc lengths that differ by less than this part of the loop are one.
SAME_PLACE = 1e-9
#: Quantiles of the distance descriptor.
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)


class NearDistances(NamedTuple):
    """Distances of all nodes to those of the outer loop, and their weights: near ones count more.

    Attributes
    ----------
    weight : (n, n_0) array
        Its rows add up to 1.
    weighted : (n, n_0) array
        Weight times distance.
    square : (n,) array
        Weighted mean square of every node's distances.
    """

    weight: FloatArray
    weighted: FloatArray
    square: FloatArray


@dataclass(frozen=True)
class BoundaryShape:
    """Sampled boundary of a domain, outer loop first.

    Attributes
    ----------
    outlines : tuple of Outline
        The domain on their left.
    s : tuple of (n_k,) arrays
        Increasing arc lengths of the nodes of every loop, less than a turn; corners are among them.
    turn : tuple of (n_k,) arrays
        Turning angles there (radians), zero off the corners.
    distances : (n, n) array
        Inner distances of all nodes, loop after loop, relative to their root mean square on the outer loop. Where the
        loops leave no path, because they cross, the distance in the plane stands in.
    """

    outlines: tuple[Outline, ...]
    s: tuple[FloatArray, ...]
    turn: tuple[FloatArray, ...]
    distances: FloatArray

    @classmethod
    def sample(cls, outlines: Sequence[Outline], extra: Sequence[FloatArray] | None = None) -> BoundaryShape:
        """Sample loops; `extra` are arc lengths on every loop that become nodes, the first of them node 0."""
        extra = [np.empty(0)] * len(outlines) if extra is None else extra
        few = max(FEWEST_SAMPLES, min(HOLE_SAMPLES, ALL_HOLES // max(len(outlines) - 1, 1)))
        s = [_nodes(outline, few if k else SAMPLES, extra[k]) for k, outline in enumerate(outlines)]
        turn = [_turn(outline, x) for outline, x in zip(outlines, s, strict=True)]
        points = np.concatenate([outline.point(x) for outline, x in zip(outlines, s, strict=True)])
        distances = inner_distances(points, [len(x) for x in s])
        blocked = np.isinf(distances)
        if blocked.any():
            distances = np.where(blocked, np.linalg.norm(points[:, None] - points, axis=2), distances)
        n = len(s[0])
        scale = float(np.sqrt((distances[:n, :n] ** 2).mean()))
        return cls(tuple(outlines), tuple(s), tuple(turn), distances / scale)

    def rows(self, k: int) -> slice:
        """Rows of loop `k` in `distances`."""
        first = sum(len(x) for x in self.s[:k])
        return slice(first, first + len(self.s[k]))

    @cached_property
    def turning(self) -> tuple[FloatArray, ...]:
        """Angles (n_k, windows) between the chords that arrive at and leave the nodes of every loop, in half turns."""
        pairs = zip(self.outlines, self.s, strict=True)
        return tuple(core_turning(outline.core, s, WINDOWS) for outline, s in pairs)

    @cached_property
    def quantiles(self) -> FloatArray:
        """Quantiles (n_0, 5) of the distances of every node of the outer loop to the others on it."""
        # As `numpy.quantile`, which loads NumPy's masked arrays.
        ordered = np.sort(self.distances[self.rows(0), self.rows(0)], axis=1)
        last = ordered.shape[1] - 1
        whole, part = np.divmod(np.multiply(QUANTILES, last), 1.0)
        below = whole.astype(int)
        a, b = ordered[:, below], ordered[:, np.minimum(below + 1, last)]
        return np.asarray(np.where(part < 0.5, a + (b - a) * part, b - (b - a) * (1 - part)))

    @cached_property
    def near(self) -> NearDistances:
        """Distances to the outer loop as weighted by profiles."""
        x = self.distances[:, self.rows(0)]
        w = self.shares(0) / (x**2 + SOFT)
        w /= w.sum(axis=1, keepdims=True)
        return NearDistances(w, w * x, (w * x * x).sum(axis=1))

    def positions(self, k: int) -> FloatArray:
        """Arc lengths of the nodes of loop `k` from the first one, in parts of its length, and the closing 1."""
        return np.append((self.s[k] - self.s[k][0]) / self.outlines[k].length, 1.0)

    def shares(self, k: int) -> FloatArray:
        """Part of the loop's length that belongs to every node."""
        gaps = np.diff(self.positions(k))
        return np.asarray((gaps + np.roll(gaps, 1)) / 2)

    def locate(self, k: int, s: FloatArray) -> tuple[IntArray, FloatArray]:
        """Node of loop `k` before the arc lengths `s`, and the fraction of the way to the next one."""
        nodes, length = self.s[k], self.outlines[k].length
        s = nodes[0] + np.mod(s - nodes[0], length)
        index = np.clip(np.searchsorted(nodes, s, side="right") - 1, 0, len(nodes) - 1)
        gap = np.diff(nodes, append=nodes[0] + length)[index]
        return index, np.clip((s - nodes[index]) / gap, 0, 1)

    def nearest_node(self, k: int, s: FloatArray) -> IntArray:
        """Node of loop `k` nearest to the arc lengths `s`."""
        index, fraction = self.locate(k, s)
        return np.asarray((index + (fraction > 0.5)) % len(self.s[k]))

    def arc_length(self, k: int, nodes: IntArray) -> FloatArray:
        """Arc lengths of nodes of loop `k`, numbered on past a turn."""
        turns, nodes = np.divmod(nodes, len(self.s[k]))
        return np.asarray(self.s[k][nodes] + turns * self.outlines[k].length)


def cyclic_gap(a: FloatArray, b: FloatArray, length: float) -> FloatArray:
    """Distance from every `a` to the nearest `b` on a loop; infinite without any `b`."""
    gap = np.mod(a[:, None] - b, length)
    return np.asarray(np.minimum(gap, length - gap).min(axis=1, initial=np.inf))


def image_of(anchors: FloatArray, s: FloatArray) -> FloatArray:
    """Target arc lengths, counted on past a turn, of source arc lengths: linear between anchors (m + 1, 2)."""
    a, b = anchors.T
    turns = np.floor((s - a[0]) / (a[-1] - a[0]))
    return np.asarray(np.interp(s - turns * (a[-1] - a[0]), a, b) + turns * (b[-1] - b[0]))


def _turn(outline: Outline, s: FloatArray) -> FloatArray:
    """Turning angles (radians) at arc lengths that are corners, else 0; that of a sliver at the corner that it is."""
    angle = outline.turn(s)
    angle = np.where(abs(angle) > CORNER, angle, 0.0)
    at, turn = drawn_corners(outline)
    if len(at) == len(outline.corners[0]):
        return angle
    apart = abs(np.mod(s[:, None] - at + outline.length / 2, outline.length) - outline.length / 2)
    drawn = apart.min(axis=1, initial=np.inf) < SAME_PLACE * outline.length
    return np.where(drawn & (angle != 0), turn[apart.argmin(axis=1)] if len(at) else 0.0, 0.0)


def _nodes(outline: Outline, n: int, extra: FloatArray) -> FloatArray:
    """About `n` arc lengths at equal distances, with the sharpest corners and the `extra` ones among them."""
    at, turn = drawn_corners(outline)
    at = at[np.argsort(-abs(turn), kind="stable")[:MAX_CORNERS]]
    step = outline.length / n
    # A corner at a landmark is the same node.
    fixed = np.concatenate([extra, at[cyclic_gap(at, extra, outline.length) > SAME_NODE * step]])
    regular = np.arange(n, dtype=np.float64) * step
    nodes = np.concatenate([fixed, regular[cyclic_gap(regular, fixed, outline.length) > CROWDED * step]])
    start = extra[0] if len(extra) else 0.0
    return np.asarray(start + np.sort(np.mod(nodes - start, outline.length)))
