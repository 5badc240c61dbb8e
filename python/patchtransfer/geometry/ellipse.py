"""Ellipses that curves lie on, as affine images of the unit circle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from ..numeric.arrays import FloatArray
from ..numeric.dense import eigen, product, svd
from .basis import parts_of_spans
from .curve import BSplineCurve

__all__ = ["Ellipse", "turned"]

#: Points of a span by which an ellipse is found.
PER_SPAN = 8
#: Curves are on an ellipse if its equation, in units of its size, holds to this for all points.
SAME = 1e-11
#: An ellipse is at most so many times as long as wide: beyond, rounding decides.
LONGEST = 1e3


class Ellipse(NamedTuple):
    """The points ``centre + axes u`` for u on the unit circle."""

    centre: FloatArray
    axes: FloatArray

    @classmethod
    def through(cls, curves: Sequence[BSplineCurve]) -> Self | None:
        """The ellipse that curves lie on, to rounding; None if there is none."""
        points = np.concatenate([curve(parts_of_spans(curve.knots, PER_SPAN)[:-1]) for curve in curves])
        middle, size = points.mean(axis=0), float(np.abs(points - points.mean(axis=0)).max())
        x, y = ((points - middle) / size).T
        _, _, rows = svd(np.column_stack([x * x, x * y, y * y, x, y, np.ones_like(x)]))
        a, b, c, d, e, f = rows[-1]
        determinant = 4 * a * c - b * b
        if determinant <= 0:
            return None
        centre = np.array([b * e - 2 * c * d, b * d - 2 * a * e]) / determinant
        level = -(f + (d * centre[0] + e * centre[1]) / 2)
        values, vectors = eigen(np.array([[a, b / 2], [b / 2, c]]) / level)
        if values[0] <= 0 or values[-1] > LONGEST**2 * values[0]:
            return None
        axes = product(vectors / np.sqrt(values), np.ascontiguousarray(vectors.T))
        ellipse = cls(middle + size * centre, size * axes)
        off = abs(np.hypot(*ellipse.to_circle(points).T) - 1)
        return ellipse if bool((off < SAME).all()) else None

    def to_circle(self, points: FloatArray) -> FloatArray:
        """Points (n, 2) in coordinates in which the ellipse is the unit circle."""
        (a, b), (c, d) = self.axes
        x, y = (points - self.centre).T
        return np.asarray(np.column_stack([d * x - b * y, a * y - c * x]) / (a * d - b * c))

    def from_circle(self, points: FloatArray) -> FloatArray:
        """The inverse of `to_circle`."""
        return np.asarray(self.centre + product(np.ascontiguousarray(points), np.ascontiguousarray(self.axes.T)))

    def angles(self, points: FloatArray) -> FloatArray:
        """Angles on the circle (radians)."""
        x, y = self.to_circle(points).T
        return np.asarray(np.arctan2(y, x))


def turned(points: FloatArray, angle: float) -> FloatArray:
    """Points (n, 2) turned about the origin (radians)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = points.T
    return np.column_stack([c * x - s * y, s * x + c * y])
