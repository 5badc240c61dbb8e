"""A closed boundary loop as one curve parameterized by arc length."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.spatial import cKDTree

from .splines import BSplineCurve, FloatArray

__all__ = ["Outline", "hausdorff"]

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
        speed = np.linalg.norm(
            self._derivative(np.repeat(np.arange(m), len(nodes)), np.tile(nodes, m)), axis=1
        )
        steps = speed.reshape(m, n, 3) @ (w / (2 * n))
        self._table = np.concatenate([[0.0], np.cumsum(steps)])
        self.length = float(self._table[-1])
        self.joints = self._table[self._first * n]

    def _locate(self, s: FloatArray, from_left: bool = False) -> tuple[FloatArray, FloatArray]:
        """Piece and local parameter at the (unwrapped) arc lengths `s`; at breaks the later or earlier piece."""
        s = np.mod(s, self.length)
        if from_left:
            s = np.where(s == 0, self.length, s)
        side = "left" if from_left else "right"
        k = np.clip(np.searchsorted(self._table, s, side=side) - 1, 0, len(self._table) - 2)
        fraction = (s - self._table[k]) / np.maximum(self._table[k + 1] - self._table[k], 1e-300)
        return k // self._n, (k % self._n + np.clip(fraction, 0, 1)) / self._n

    def _casteljau(self, piece: FloatArray, t: FloatArray, stop: int) -> FloatArray:
        """Homogeneous Bézier points after de Casteljau steps until `stop` points are left."""
        b = self._pieces[piece]
        u = t[:, None, None]
        while b.shape[1] > stop:
            b = b[:, :-1] + u * (b[:, 1:] - b[:, :-1])
        return b

    def _derivative(self, piece: FloatArray, t: FloatArray) -> FloatArray:
        b = self._casteljau(piece, t, 2)
        slope = (self._pieces.shape[1] - 1) * (b[:, 1] - b[:, 0])
        value = b[:, 0] + t[:, None] * (b[:, 1] - b[:, 0])
        point = value[:, :2] / value[:, 2:]
        return np.asarray((slope[:, :2] - slope[:, 2:] * point) / value[:, 2:])

    def point(self, s: FloatArray | float) -> FloatArray:
        """Points at the arc lengths `s` (taken modulo the length), shape (..., 2)."""
        s = np.asarray(s, dtype=np.float64)
        value = self._casteljau(*self._locate(s.ravel()), 1)[:, 0]
        return np.asarray(value[:, :2] / value[:, 2:]).reshape(*s.shape, 2)

    def tangent(self, s: FloatArray | float, from_left: bool = False) -> FloatArray:
        """Unit tangents at `s`; at a corner the outgoing one, or the incoming one with `from_left`."""
        s = np.asarray(s, dtype=np.float64)
        piece, t = self._locate(s.ravel(), from_left)
        d = self._derivative(piece, t)
        norm = np.linalg.norm(d, axis=1)
        # Coinciding end control points: the direction is the limit from inside.
        flat = norm <= 1e-9 * self.length
        if flat.any():
            inward = np.where(t[flat] > 0.5, t[flat] - 1e-3, t[flat] + 1e-3)
            d[flat] = self._derivative(piece[flat], inward)
            norm = np.linalg.norm(d, axis=1)
        return np.asarray(d / np.maximum(norm, 1e-300)[:, None]).reshape(*s.shape, 2)

    def turn(self, s: FloatArray | float) -> FloatArray:
        """Signed turning angle of the tangent at `s` in radians, non-zero at corners only."""
        # A position computed by arithmetic may miss the corner by rounding.
        near = 1e-9 * self.length
        before, after = self.tangent(np.asarray(s) - near, from_left=True), self.tangent(np.asarray(s) + near)
        cross = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
        return np.arctan2(cross, (before * after).sum(axis=-1))

    def arc_length(self, curve: int, t: FloatArray) -> FloatArray:
        """Arc length at the parameters `t` of one of the curves (linear interpolation in the table)."""
        breaks, n = self._breaks[curve], self._n
        knots = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.arange(n) / n).ravel()
        rows = slice(self._first[curve] * n, self._first[curve + 1] * n + 1)
        return np.interp(t, np.append(knots, breaks[-1]), self._table[rows])

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
        best_s, best = s.copy(), np.full(len(points), np.inf)
        active = rows
        for _ in range(8):
            offset = points[active] - self.point(s[active])
            distance = np.linalg.norm(offset, axis=1)
            better = distance < best[active]
            best_s[active[better]], best[active[better]] = s[active[better]], distance[better]
            move = np.clip((offset * self.tangent(s[active])).sum(axis=1), -step[active], step[active])
            s[active] += move
            active = active[better & (abs(move) > 1e-9 * self.length)]
            if len(active) == 0:
                break
        return np.mod(best_s, self.length), best

    def polygon(self, n: int) -> FloatArray:
        """`n` points at equal arc-length distances."""
        return self.point(np.arange(n) * (self.length / n))

    @cached_property
    def area(self) -> float:
        """Signed area, positive when the loop runs counter-clockwise (from 4 to 16 samples a Bézier piece)."""
        x, y = self._samples[1].T
        return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


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

    From 4 to 16 points a Bézier piece of either loop, projected onto the other one.
    """
    return float(max(b.nearest(a._samples[1])[1].max(), a.nearest(b._samples[1])[1].max()))
