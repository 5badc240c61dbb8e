"""A closed boundary loop as one curve parameterized by arc length."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import comb

from . import _core
from .splines import BSplineCurve, FloatArray
from .topology import polygon_area

__all__ = ["Outline", "hausdorff"]

IntArray = NDArray[np.int64]

#: Aim for this many entries in the arc-length table, 4 to 16 a Bézier piece (3-point Gauss on each interval).
TABLE = 1024


class Outline:
    """Closed loop of curves, evaluated piece by piece, parameterized by arc length.

    The arc length is integrated numerically (relative error about 1e-8 on smooth pieces) and inverted by linear
    interpolation between 4 to 16 values a Bézier piece: points are exactly on the curves, their arc length is
    approximate to that accuracy.

    Parameters
    ----------
    curves : sequence of BSplineCurve
        Each ends where the next starts. NURBS are evaluated as such.

    Attributes
    ----------
    length : float
        Total length.
    joints : (n_curves + 1,) array
        Arc length where every curve starts; the last entry is the total length.
    """

    def __init__(self, curves: Sequence[BSplineCurve]) -> None:
        self.curves = tuple(curves)
        extracted = [curve.bezier() for curve in self.curves]
        degree = max(curve.degree for curve in self.curves)
        self._pieces = np.concatenate([_raise_bezier(points, degree) for _, points in extracted])
        count = [len(points) for _, points in extracted]
        self._first = np.concatenate([[0], np.cumsum(count)])
        self._breaks = [breaks for breaks, _ in extracted]
        t, w = leggauss(3)
        m = len(self._pieces)
        self._n = n = max(4, min(16, TABLE // m))
        nodes = (np.arange(n)[:, None] / n + (t + 1) / (2 * n)).ravel()
        speed = np.linalg.norm(_derivatives(self._pieces, nodes), axis=2)
        steps = speed.reshape(m, n, 3) @ (w / (2 * n))
        self._table = np.concatenate([[0.0], np.cumsum(steps)])
        self.length = float(self._table[-1])
        self.joints = self._table[self._first * n]

    def evaluate(self, s: FloatArray, from_left: bool = False) -> FloatArray:
        """Points and unit tangents (..., 4) at the arc lengths `s`, taken modulo the length.

        At a corner the tangent is the outgoing one, or the incoming one with `from_left`.
        """
        flat = np.ascontiguousarray(s, dtype=np.float64).ravel()
        return _core.evaluate_outline(self._pieces, self._table, flat, from_left).reshape(*np.shape(s), 4)

    def point(self, s: FloatArray | float) -> FloatArray:
        """Points at the arc lengths `s`, shape (..., 2)."""
        return np.asarray(self.evaluate(np.asarray(s))[..., :2])

    def tangent(self, s: FloatArray | float, from_left: bool = False) -> FloatArray:
        """Unit tangents at the arc lengths `s`, shape (..., 2)."""
        return np.asarray(self.evaluate(np.asarray(s), from_left)[..., 2:])

    def turn(self, s: FloatArray | float) -> FloatArray:
        """Signed turning angle of the tangent at `s` in radians, non-zero at corners only."""
        # A position computed by arithmetic may miss the corner by rounding.
        near = 1e-9 * self.length
        before, after = self.tangent(np.asarray(s) - near, from_left=True), self.tangent(np.asarray(s) + near)
        cross = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
        return np.asarray(np.arctan2(cross, (before * after).sum(axis=-1)))

    def arc_length(self, curve: int, t: FloatArray) -> FloatArray:
        """Arc length at the parameters `t` of one of the curves (linear interpolation in the table)."""
        breaks, n = self._breaks[curve], self._n
        knots = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.arange(n) / n).ravel()
        rows = slice(self._first[curve] * n, self._first[curve + 1] * n + 1)
        return np.asarray(np.interp(t, np.append(knots, breaks[-1]), self._table[rows]))

    @cached_property
    def piece_breaks(self) -> FloatArray:
        """Arc lengths of all Bézier piece ends, where corners can be; without the closing one."""
        return self._table[: -1 : self._n]

    @cached_property
    def _samples(self) -> tuple[FloatArray, FloatArray, cKDTree]:
        s = self._table[:-1]
        points = self.point(s)
        return s, points, cKDTree(points)

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Arc length of the nearest point of the loop and its distance, for points (n, 2).

        Starts from the nearest chord of the arc-length table; Newton steps (projection onto the tangent) refine it.
        """
        s_all, samples, tree = self._samples
        count = len(s_all)
        _, near = tree.query(points, k=min(4, count))
        # Chords on either side of the nearest samples: the nearest sample may be on another branch of a corner.
        chord = np.concatenate([near, (near - 1) % count], axis=1)
        a, d = samples[chord], samples[(chord + 1) % count] - samples[chord]
        fraction = ((points[:, None] - a) * d).sum(axis=2) / np.maximum((d * d).sum(axis=2), 1e-300)
        fraction = np.clip(fraction, 0, 1)
        pick = np.linalg.norm(points[:, None] - a - fraction[..., None] * d, axis=2).argmin(axis=1)
        rows = np.arange(len(points))
        k = chord[rows, pick]
        step = np.diff(self._table)[k]
        s = s_all[k] + fraction[rows, pick] * step
        feet = _core.outline_feet(self._pieces, self._table, np.ascontiguousarray(points), s, step)
        return np.mod(feet[:, 0], self.length), feet[:, 1]

    def polygon(self, n: int) -> FloatArray:
        """`n` points at equal arc-length distances."""
        return self.point(np.arange(n, dtype=np.float64) * (self.length / n))

    @cached_property
    def area(self) -> float:
        """Signed area, positive when the loop runs counter-clockwise (from 4 to 16 samples a Bézier piece)."""
        return polygon_area(self._samples[1])


def _derivatives(pieces: FloatArray, t: FloatArray) -> FloatArray:
    """Derivatives (m, len(t), 2) of rational Bézier pieces (m, p + 1, 3) at the local parameters `t`."""
    p = pieces.shape[1] - 1
    k = np.arange(p + 1)
    basis = comb(p, k) * t[:, None] ** k * (1 - t[:, None]) ** (p - k)
    lower = comb(p - 1, k[:-1]) * t[:, None] ** k[:-1] * (1 - t[:, None]) ** (p - 1 - k[:-1])
    value, slope = basis @ pieces, lower @ (p * np.diff(pieces, axis=1))
    point = value[..., :2] / value[..., 2:]
    return np.asarray((slope[..., :2] - slope[..., 2:] * point) / value[..., 2:])


def _raise_bezier(points: FloatArray, degree: int) -> FloatArray:
    """Bézier points (m, p + 1, d) raised to a common degree."""
    while points.shape[1] <= degree:
        p = points.shape[1]
        a = (np.arange(1, p) / p)[:, None]
        middle = a * points[:, :-1] + (1 - a) * points[:, 1:]
        points = np.concatenate([points[:, :1], middle, points[:, -1:]], axis=1)
    return points


def hausdorff(a: Outline, b: Outline) -> float:
    """Two-sided Hausdorff distance of two loops.

    From points of either loop projected onto the other one: 4 to 16 a Bézier piece, every n-th of them where that
    would be more than 2048.
    """

    def some(outline: Outline) -> FloatArray:
        points = outline._samples[1]
        return np.asarray(points[:: -(-len(points) // 2048)])

    return float(max(b.nearest(some(a))[1].max(), a.nearest(some(b))[1].max()))
