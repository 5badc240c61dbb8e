"""A closed boundary loop as one curve parameterized by arc length."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from .._core import Outline as CoreOutline
from ..numeric.arrays import FloatArray
from .curve import BSplineCurve
from .packing import PackedCurves, pack_curves, unpack_curves

__all__ = ["CORNER", "Outline", "hausdorff"]

#: A joint that turns by more is a corner (radians).
CORNER = np.radians(15.0)


class Outline:
    """Closed loop of curves, evaluated piece by piece, parameterized by arc length.

    The arc length is integrated numerically (relative error about 1e-8 on smooth pieces) and inverted by linear
    interpolation between 4 to 16 values a Bézier piece: points are exactly on the curves, their arc length is
    approximate to that accuracy.

    Parameters
    ----------
    curves : sequence of BSplineCurve
        Each ends where the next starts. NURBS are evaluated as such.
    """

    # All of it is made when asked for: results bring their outlines from other processes, and few are ever used there.
    def __init__(self, curves: Sequence[BSplineCurve]) -> None:
        self.curves = tuple(curves)

    @cached_property
    def curves(self) -> tuple[BSplineCurve, ...]:
        """The curves."""
        return unpack_curves(self._packed)

    @cached_property
    def core(self) -> CoreOutline:
        """The curves in the core, with their arc-length table."""
        return CoreOutline([(c.knots, c.degree, c.control_points, c.weights) for c in self.curves])

    @cached_property
    def length(self) -> float:
        """Total length."""
        return self.core.length

    @cached_property
    def joints(self) -> FloatArray:
        """Arc length where every curve starts, (n_curves + 1,); the last entry is the total length."""
        return self.core.joints

    @cached_property
    def diameter(self) -> float:
        """Diagonal of the bounding box (of 4 to 16 samples a Bézier piece)."""
        return self.core.diameter

    @cached_property
    def _packed(self) -> PackedCurves:
        return pack_curves(self.curves)

    def __reduce__(self) -> tuple[Callable[[PackedCurves], Outline], tuple[PackedCurves]]:
        return _unpacked, (self._packed,)

    def evaluate(self, s: FloatArray, from_left: bool = False) -> FloatArray:
        """Points and unit tangents (..., 4) at the arc lengths `s`, taken modulo the length.

        At a corner the tangent is the outgoing one, or the incoming one with `from_left`.
        """
        flat = np.ascontiguousarray(s, dtype=np.float64).ravel()
        return self.core.evaluate(flat, from_left).reshape(*np.shape(s), 4)

    def point(self, s: FloatArray | float) -> FloatArray:
        """Points at the arc lengths `s`, shape (..., 2)."""
        return np.asarray(self.evaluate(np.asarray(s))[..., :2])

    def tangent(self, s: FloatArray | float, from_left: bool = False) -> FloatArray:
        """Unit tangents at the arc lengths `s`, shape (..., 2)."""
        return np.asarray(self.evaluate(np.asarray(s), from_left)[..., 2:])

    def turn(self, s: FloatArray | float) -> FloatArray:
        """Signed turning angle of the tangent at `s` in radians, non-zero at corners only."""
        flat = np.ascontiguousarray(s, dtype=np.float64).ravel()
        return self.core.turn(flat).reshape(np.shape(s))

    def arc_length(self, curve: int, t: FloatArray) -> FloatArray:
        """Arc length at the parameters `t` (n,) of one of the curves (linear interpolation in the table)."""
        return self.core.arc_length(curve, np.ascontiguousarray(t, dtype=np.float64))

    @cached_property
    def piece_breaks(self) -> FloatArray:
        """Arc lengths of all Bézier piece ends, where corners can be; without the closing one."""
        return self.core.piece_starts

    @cached_property
    def corners(self) -> tuple[FloatArray, FloatArray]:
        """Arc lengths and signed turning angles (radians) of the corners."""
        turn = self.turn(self.piece_breaks)
        sharp = abs(turn) > CORNER
        return self.piece_breaks[sharp], turn[sharp]

    @cached_property
    def samples(self) -> tuple[FloatArray, FloatArray]:
        """Arc lengths (n,) and points (n, 2), 4 to 16 a Bézier piece."""
        return self.core.samples()

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Arc length of the nearest point of the loop and its distance, for points (n, 2).

        Starts from the nearest chord of the arc-length table; Newton steps (projection onto the tangent) refine it.
        """
        feet = self.core.nearest(np.asarray(points, dtype=np.float64))
        return feet[:, 0], feet[:, 1]

    def polygon(self, n: int) -> FloatArray:
        """`n` points at equal arc-length distances."""
        return self.point(np.arange(n, dtype=np.float64) * (self.length / n))

    @cached_property
    def area(self) -> float:
        """Signed area, positive when the loop runs counter-clockwise (from 4 to 16 samples a Bézier piece)."""
        return self.core.area


def _unpacked(curves: PackedCurves) -> Outline:
    outline = Outline.__new__(Outline)
    outline.__dict__["_packed"] = curves
    return outline


def hausdorff(a: Outline, b: Outline) -> float:
    """Two-sided Hausdorff distance of two loops.

    From points of either loop projected onto the other one: 4 to 16 a Bézier piece, every n-th of them where that
    would be more than 2048.
    """
    return a.core.hausdorff(b.core)
