"""How far from similar a correspondence of two boundaries is: what can be known of a map before there is one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._core import inner_distances
from ..geometry.outline import Outline
from ..numeric.arrays import FloatArray
from .sampled_boundary import image_of

__all__ = ["Matched", "Mismatch", "mismatch"]

#: Points on the outer loop, and on a hole at least; inner distances are between every second of them, for their time
#: grows with the square.
POINTS, FEWEST, EVERY = 160, 16, 2

#: A loop of the source, its partner, and arc lengths (m + 1, 2) of corresponding points.
Matched = tuple[Outline, Outline, FloatArray]


class Mismatch(NamedTuple):
    """Of a correspondence; all 0 for similar shapes.

    Attributes
    ----------
    turned : float
        By how much a piece of the boundary is turned at most, against all of it (radians).
    jump : float
        Largest jump, from one piece of the boundary to the next, of the logarithm of the stretch along it.
    distances : float
        Standard deviation of the logarithm of how much inner distances stretch.
    """

    turned: float
    jump: float
    distances: float


def mismatch(loops: Sequence[Matched]) -> Mismatch:
    """Mismatch of a correspondence of all loops, the outer one first."""
    length = loops[0][0].length
    pairs = []
    for source, target, anchors in loops:
        n = max(FEWEST, round(POINTS * source.length / length))
        s = np.arange(n, dtype=np.float64) * (source.length / n)
        pairs.append((source.point(s), target.point(image_of(anchors, s))))
    turned, stretch = zip(*(_chords(*pair) for pair in pairs), strict=True)
    angles = np.concatenate(turned)
    middle = np.angle(np.exp(1j * angles).sum())
    source_distances, target_distances = (_distances([pair[k][::EVERY] for pair in pairs]) for k in (0, 1))
    return Mismatch(
        float(abs(np.mod(angles - middle + np.pi, 2 * np.pi) - np.pi).max()),
        float(max(abs(np.diff(log, append=log[:1])).max() for log in stretch)),
        float(np.log(target_distances / source_distances).std()),
    )


def _chords(p: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """By how much the chords between points are turned (radians), and the logarithm of their stretch."""
    a, b = ((np.roll(x, -1, axis=0) - x) @ np.array([1.0, 1j]) for x in (p, q))
    tiny = np.finfo(float).tiny
    return np.angle(b * a.conj()), np.log((abs(b) + tiny) / (abs(a) + tiny))


def _distances(loops: Sequence[FloatArray]) -> FloatArray:
    """Inner distances of all pairs of points; in the plane where loops that cross leave no path."""
    points = np.concatenate(loops)
    above = np.triu_indices(len(points), 1)
    found = inner_distances(points, [len(loop) for loop in loops])[above]
    if np.isinf(found).any():
        found = np.where(np.isinf(found), np.hypot(*(points[above[0]] - points[above[1]]).T), found)
    return np.maximum(found, np.finfo(float).tiny)
