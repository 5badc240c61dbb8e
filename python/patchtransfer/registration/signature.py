"""A domain in a few numbers that tell which domains may be alike, without a correspondence.

Inner distances between points of the boundary (`inner_distances`) do not change under motions, and bends and turned
limbs change them little. Every point has quantiles of its distances to the others: small ones tell whether it lies at
a neck, large ones whether it is at an end. Quantiles of these over all points need no order of the points, and so no
correspondence (shape distributions: Osada, Funkhouser, Chazelle, Dobkin, ACM TOG 21(4), 2002).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._core import inner_distances
from ..geometry.outline import Outline
from ..numeric.arrays import FloatArray

__all__ = ["SHAPE", "VERSION", "Signature", "signature"]

#: To be raised whenever signatures change: kept ones are of one version.
VERSION = 1
#: Points of all loops together about, and of a loop at least: with twice as many the order of candidates stays.
POINTS, FEWEST = 120, 8
#: Quantiles of a point's distances, and of those over all points.
OF_POINT, OVER_POINTS = np.linspace(0.1, 1.0, 10), np.linspace(0.0, 1.0, 11)
SHAPE = len(OF_POINT), len(OVER_POINTS)


class Signature(NamedTuple):
    """Of a domain.

    Attributes
    ----------
    loops : int
        Of its boundary.
    values : (10, 11) array
        Quantiles over the points of the quantiles of their inner distances, in units of the root of the area.
    """

    loops: int
    values: FloatArray

    def distance(self, other: Signature) -> float:
        """Mean difference of the quantiles; infinite where the numbers of loops differ."""
        return float(abs(self.values - other.values).mean()) if self.loops == other.loops else np.inf


def signature(outlines: Sequence[Outline]) -> Signature:
    """The signature of a domain.

    Parameters
    ----------
    outlines : sequence of Outline
        Outer loop first, the domain on their left.
    """
    total = sum(outline.length for outline in outlines)
    sizes = [max(FEWEST, round(POINTS * outline.length / total)) for outline in outlines]
    points = np.concatenate([outline.polygon(n) for outline, n in zip(outlines, sizes, strict=True)])
    distances = inner_distances(points, sizes)
    blocked = np.isinf(distances)
    if blocked.any():
        # Loops that cross leave no path: the distance in the plane stands in.
        distances = np.where(blocked, np.linalg.norm(points[:, None] - points, axis=2), distances)
    area = sum(outline.area for outline in outlines)
    of_points = _quantiles(distances / np.sqrt(abs(area)), OF_POINT)
    return Signature(len(outlines), _quantiles(of_points.T, OVER_POINTS))


def _quantiles(rows: FloatArray, parts: FloatArray) -> FloatArray:
    """Quantiles (rows, parts) of every row, linear between ordered values; `numpy.quantile` loads masked arrays."""
    ordered = np.sort(rows, axis=1)
    place = parts * (ordered.shape[1] - 1)
    below = np.minimum(place.astype(int), ordered.shape[1] - 2)
    part = place - below
    # In one order of memory whatever was given, so that sums of kept ones round alike.
    return np.ascontiguousarray(ordered[:, below] * (1 - part) + ordered[:, below + 1] * part)
