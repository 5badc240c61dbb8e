"""`BSplineCurve`: B-spline and NURBS curves of the plane, immutable values. Control points are indexed ``[i]``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from .._core import bezier_extract
from ..errors import InputError
from ..numeric.arrays import FloatArray, frozen_array, same_bits
from .basis import (
    check_inside,
    check_knots,
    check_order,
    check_weights,
    elevate,
    insert_knots,
    knot_spans,
    reverse_knots,
    spline_values,
)
from .rational import quotient_derivative, weighted

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

__all__ = ["BSplineCurve"]


@dataclass(frozen=True, eq=False)
class BSplineCurve:
    """A planar B-spline or NURBS curve.

    Parameters
    ----------
    knots : (n + degree + 1,) array
        Clamped, non-decreasing knot vector.
    degree : int
        At least 1.
    control_points : (n, 2) array
    weights : (n,) array, optional
        Positive weights, the largest at most 1e16 times the smallest; None for a polynomial curve.

    Raises
    ------
    InputError
        On a knot vector that is not clamped or decreases, on knots nearer than 1e-30 of the domain, on weights beyond
        their bounds, on NaN, on shapes that do not fit.

    Examples
    --------
    >>> line = BSplineCurve([0, 0, 1, 1], 1, [[0, 0], [2, 1]])
    >>> line(0.5)
    array([1. , 0.5])
    """

    knots: FloatArray
    degree: int
    control_points: FloatArray
    weights: FloatArray | None = None

    def __init__(
        self, knots: ArrayLike, degree: int, control_points: ArrayLike, weights: ArrayLike | None = None
    ) -> None:
        set_ = object.__setattr__
        set_(self, "knots", frozen_array(knots, "curve knots"))
        set_(self, "degree", int(degree))
        set_(self, "control_points", frozen_array(control_points, "curve control points"))
        if self.control_points.ndim != 2 or self.control_points.shape[1] != 2:
            raise InputError(f"curve control points must have shape (n, 2), got {self.control_points.shape}")
        check_knots(self.knots, self.degree, len(self.control_points), "curve")
        set_(self, "weights", check_weights(weights, self.control_points.shape[:1], "curve"))

    @classmethod
    def _trusted(
        cls, knots: FloatArray, degree: int, control_points: FloatArray, weights: FloatArray | None
    ) -> BSplineCurve:
        """A curve from read-only parts of a valid curve or patch, without checking them again."""
        curve = object.__new__(cls)
        curve.__dict__.update(knots=knots, degree=degree, control_points=control_points, weights=weights)
        return curve

    def with_control_points(self, control_points: ArrayLike) -> BSplineCurve:
        """The curve with the same degree, knots and weights and other control points."""
        points = frozen_array(control_points, "curve control points")
        if points.shape != self.control_points.shape:
            raise InputError(f"curve control points must have shape {self.control_points.shape}, got {points.shape}")
        return self._trusted(self.knots, self.degree, points, self.weights)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, BSplineCurve) and same_bits(self, other, ("knots", "control_points", "weights"))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        kind = "B-spline" if self.weights is None else "NURBS"
        return f"<BSplineCurve: degree {self.degree}, {len(self.control_points)} control points, {kind}>"

    @property
    def domain(self) -> tuple[float, float]:
        """First and last knot."""
        return float(self.knots[0]), float(self.knots[-1])

    @property
    def start(self) -> FloatArray:
        """First control point, where the curve starts."""
        return np.asarray(self.control_points[0])

    @property
    def end(self) -> FloatArray:
        """Last control point, where the curve ends."""
        return np.asarray(self.control_points[-1])

    def homogeneous(self) -> FloatArray:
        """Coefficients (n, 3): weighted control points and weights (ones for a polynomial curve)."""
        w = np.ones(len(self.control_points)) if self.weights is None else self.weights
        return np.column_stack([self.control_points * w[:, None], w])

    def __call__(self, t: ArrayLike, order: int = 0) -> FloatArray:
        """Points, or derivatives of `order`, at the parameters `t` of any shape: (..., 2).

        Raises
        ------
        InputError
            When a parameter is outside the domain; it may be its first or last one, to the bit.
        """
        t = np.asarray(t, dtype=np.float64)
        check_inside(t, self.knots, "curve: parameter t")
        check_order(order, "order")
        if self.weights is None:
            return spline_values(self.knots, self.degree, self.control_points, t, order)
        h = weighted(self.control_points, self.weights)
        return quotient_derivative(lambda k, _: spline_values(self.knots, self.degree, h, t, k), order)

    def derivative(self, t: ArrayLike, order: int = 1) -> FloatArray:
        """Derivative of any order at the parameters `t` of any shape, (..., 2); after the knot where it jumps."""
        return self(t, order)

    def reversed(self) -> BSplineCurve:
        """The same curve traversed backwards on the same domain."""
        weights = None if self.weights is None else self.weights[::-1]
        knots = reverse_knots(self.knots)
        knots.flags.writeable = False
        return self._trusted(knots, self.degree, self.control_points[::-1], weights)

    def insert_knots(self, new: ArrayLike) -> BSplineCurve:
        """The same curve with the knots `new` added."""
        knots, h = insert_knots(self.knots, self.degree, self._coefficients(), new)
        return self._from_coefficients(knots, self.degree, h)

    def elevate(self, by: int = 1) -> BSplineCurve:
        """The same curve with its degree raised."""
        return self._from_coefficients(*elevate(self.knots, self.degree, self._coefficients(), by))

    def restrict(self, a: float, b: float) -> BSplineCurve:
        """The part of the curve over the parameters [a, b]."""
        if not self.knots[0] <= a < b <= self.knots[-1]:
            raise InputError(f"[{a:g}, {b:g}] is not an interval of the curve's domain {self.domain}")
        missing = [
            np.repeat(x, self.degree - np.count_nonzero(self.knots == x))
            for x in (a, b)
            if self.knots[0] < x < self.knots[-1]
        ]
        knots, h = insert_knots(self.knots, self.degree, self._coefficients(), np.concatenate([[], *missing]))
        first = int(np.searchsorted(knots, a, side="right")) - self.degree - 1 if a > knots[0] else 0
        last = int(np.searchsorted(knots, b, side="left")) if b < knots[-1] else len(h)
        inner = knots[(knots > a) & (knots < b)]
        p = self.degree
        clamped = np.concatenate([np.full(p + 1, a), inner, np.full(p + 1, b)])
        return self._from_coefficients(clamped, p, h[first : first + len(clamped) - p - 1] if last else h)

    def bezier(self) -> tuple[FloatArray, FloatArray]:
        """Breaks (m + 1,) and homogeneous Bézier points (m, degree + 1, 3) of the m spans."""
        pieces = bezier_extract(self.knots, self.degree, self.homogeneous())
        return knot_spans(self.knots), pieces

    def to_scipy(self) -> BSpline:
        """`scipy.interpolate.BSpline` of a polynomial curve."""
        if self.weights is not None:
            raise InputError("SciPy has no rational splines; use homogeneous() instead")
        from scipy.interpolate import BSpline

        return BSpline(self.knots, self.control_points, self.degree)

    @classmethod
    def from_scipy(cls, spline: BSpline) -> Self:
        """Take over a clamped `scipy.interpolate.BSpline` with values in the plane."""
        return cls(spline.t, spline.k, spline.c)

    def _coefficients(self) -> FloatArray:
        return self.control_points if self.weights is None else self.homogeneous()

    def _from_coefficients(self, knots: FloatArray, degree: int, h: FloatArray) -> BSplineCurve:
        if self.weights is None:
            return BSplineCurve(knots, degree, h)
        return BSplineCurve(knots, degree, h[:, :2] / h[:, 2:], h[:, 2])
