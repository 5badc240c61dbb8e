"""Corners where one patch fills a straight angle, put exactly on the right side of straight.

There det J is a positive multiple of the area of a triangle: the corner's control point and its two neighbours. In
exact arithmetic the area of three rounded points in line is negative as often as not, and a negative one is a fold,
however small. Moving a neighbour by an ulp or a few mends it; the sign is that of exact rationals.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from .._core import DATA_ULPS
from ..numeric.arrays import FloatArray, IntArray
from .sides import CORNERS, around_corner
from .topology import Topology

__all__ = ["Triangles", "corner_triangles", "straighten"]

#: Corners share neighbours where patches are coarse, so that mending one may spoil another.
MENDING_ROUNDS = 8


class Triangles(NamedTuple):
    """Patch corners: `rows` (corner, neighbour, neighbour) of point numbers, counter-clockwise where `sense` is 1.

    The first neighbour lies along u, the second along v.
    """

    rows: IntArray
    sense: IntArray


def corner_triangles(topology: Topology, corners: Iterable[tuple[int, int]]) -> Triangles:
    """Triangles of shared control points at patch corners (patch, corner)."""
    rows, sense = [], []
    for k, corner in corners:
        rows.append(around_corner(topology.points[k], corner))
        i, j = CORNERS[corner]
        sense.append(topology.orientation[k] * (1 if i == j else -1))
    return Triangles(np.array(rows, np.int64).reshape(-1, 3), np.array(sense, np.int64))


def straighten(points: FloatArray, triangles: Triangles) -> tuple[FloatArray, float]:
    """Points of which no triangle is negative that was so by rounding, and how far the farthest has moved.

    Parameters
    ----------
    points : (n, 2) array
        Of all triangles.
    triangles : Triangles
        Those with more than rounding below zero are left as they are.

    Returns
    -------
    points : (n, 2) array
        The same array if nothing has moved.
    moved : float
    """
    if not len(triangles.rows):
        return points, 0.0
    (cx, cy), (ax, ay), (bx, by) = (points[triangles.rows[:, i]].T for i in range(3))
    # What is farther above zero than this differs from it by more than the rounding of the area in floating point.
    size = np.abs(np.stack([ax - cx, ay - cy, bx - cx, by - cy])).max(axis=0)
    doubtful = ((ax - cx) * (by - cy) - (ay - cy) * (bx - cx)) * triangles.sense <= 1e-14 * size**2
    if not doubtful.any():
        return points, 0.0
    # What the certificate calls rounding.
    limit = DATA_ULPS * float(np.spacing(np.abs(points).max()))
    found = points.copy()
    chosen = np.flatnonzero(doubtful)
    for _ in range(MENDING_ROUNDS):
        mended = [_mend(found, triangles.rows[t], int(triangles.sense[t]), points, limit) for t in chosen]
        if not any(mended):
            break
    moved = float(np.abs(found - points).max())
    return (found, moved) if moved else (points, 0.0)


def _mend(found: FloatArray, row: Sequence[int], sense: int, given: FloatArray, limit: float) -> bool:
    """Move a neighbour until the triangle is not negative; False if it is not, or by too much."""
    c, a, b = (int(i) for i in row)

    def area() -> Fraction:
        (cx, cy), (ax, ay), (bx, by) = ([Fraction(x) for x in found[i].tolist()] for i in (c, a, b))
        return sense * ((ax - cx) * (by - cy) - (ay - cy) * (bx - cx))

    missing = -area()
    if missing <= 0:
        return False
    # Along the gradient of the area: where two corners share a neighbour, mending one then spoils the other least.
    to_a, to_b = found[a] - found[c], found[b] - found[c]
    point, gradient = max(
        (a, sense * np.array([to_b[1], -to_b[0]])),
        (b, sense * np.array([-to_a[1], to_a[0]])),
        key=lambda entry: float(np.abs(entry[1]).max()),
    )
    size = float(np.abs(gradient).max())
    if size == 0.0:
        return False
    before = found[point].copy()
    direction = gradient / size
    trial = before + float(missing / Fraction(size)) / float(direction @ direction) * direction
    outwards = np.where(gradient > 0, np.inf, np.where(gradient < 0, -np.inf, before))
    while float(np.abs(trial - given[point]).max()) <= limit:
        found[point] = trial
        if area() >= 0:
            return True
        trial = np.nextafter(trial, outwards)
    found[point] = before
    return False
