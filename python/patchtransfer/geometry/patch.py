"""`Patch`: tensor-product B-spline and NURBS patches of the plane, immutable values.

Control points are indexed ``[i, j]`` = (u, v), in C order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from .._core import evaluate_tensor
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
)
from .display import Shown
from .rational import quotient_derivative, weighted

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline

    from .._core import PatchTuple

__all__ = ["Patch"]


@dataclass(frozen=True, eq=False)
class Patch(Shown):
    """A planar tensor-product B-spline or NURBS patch.

    Parameters
    ----------
    knots : pair of arrays
        Clamped knot vectors (U, V).
    degrees : pair of int
        Degrees (p, q), each at least 1.
    control_points : (n_u, n_v, 2) array
        ``[i, j]`` belongs to basis functions i in u and j in v.
    weights : (n_u, n_v) array, optional
        Positive weights, the largest at most 1e16 times the smallest; None for a polynomial patch.

    Raises
    ------
    InputError
        On knot vectors that are not clamped or decrease, on knots nearer than 1e-30 of the domain, on weights beyond
        their bounds, on NaN, on shapes that do not fit.

    Examples
    --------
    >>> square = Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])
    >>> square(0.25, 0.5)
    array([0.25, 0.5 ])
    """

    knots: tuple[FloatArray, FloatArray]
    degrees: tuple[int, int]
    control_points: FloatArray
    weights: FloatArray | None = None

    def __init__(
        self,
        knots: Sequence[ArrayLike],
        degrees: Sequence[int],
        control_points: ArrayLike,
        weights: ArrayLike | None = None,
    ) -> None:
        set_ = object.__setattr__
        if len(knots) != 2 or len(degrees) != 2:
            raise InputError("a patch has two knot vectors and two degrees")
        set_(self, "knots", (frozen_array(knots[0], "patch knots u"), frozen_array(knots[1], "patch knots v")))
        set_(self, "degrees", (int(degrees[0]), int(degrees[1])))
        set_(self, "control_points", frozen_array(control_points, "patch control points"))
        points = self.control_points
        if points.ndim != 3 or points.shape[2] != 2:
            raise InputError(f"patch control points must have shape (n_u, n_v, 2), got {points.shape}")
        for axis, name in enumerate("uv"):
            check_knots(self.knots[axis], self.degrees[axis], points.shape[axis], f"patch direction {name}")
        set_(self, "weights", check_weights(weights, points.shape[:2], "patch"))

    @classmethod
    def _trusted(
        cls,
        knots: tuple[FloatArray, FloatArray],
        degrees: tuple[int, int],
        control_points: FloatArray,
        weights: FloatArray | None,
    ) -> Patch:
        """A patch from read-only parts of a valid patch, without checking them again."""
        patch = object.__new__(cls)
        patch.__dict__.update(knots=knots, degrees=degrees, control_points=control_points, weights=weights)
        return patch

    def _without_equal_weights(self) -> Patch:
        """The same map, polynomial if all weights are one number."""
        w = self.weights
        if w is None or (w != w[0, 0]).any():
            return self
        return self._trusted(self.knots, self.degrees, self.control_points, None)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Patch) and same_bits(self, other, ("knots", "control_points", "weights"))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        (p, q), (m, n) = self.degrees, self.shape
        kind = "B-spline" if self.weights is None else "NURBS"
        return f"<Patch: degrees {p} x {q}, {m} x {n} control points, {kind}>"

    @property
    def domain(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """First and last knot in u, and in v."""
        u, v = self.knots
        return (float(u[0]), float(u[-1])), (float(v[0]), float(v[-1]))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of control points along u and v."""
        return self.control_points.shape[0], self.control_points.shape[1]

    def with_control_points(self, control_points: ArrayLike) -> Patch:
        """The patch with the same degrees, knots and weights and other control points."""
        points = frozen_array(control_points, "patch control points")
        if points.shape != self.control_points.shape:
            shape = self.control_points.shape
            raise InputError(f"patch control points must keep their shape {shape}, got {points.shape}")
        return self._moved(points)

    def _moved(self, control_points: FloatArray) -> Patch:
        """The patch with control points that are read-only and checked already, as knots and weights are."""
        return self._trusted(self.knots, self.degrees, control_points, self.weights)

    def grid(self, u: ArrayLike, v: ArrayLike, du: int = 0, dv: int = 0) -> FloatArray:
        """Derivative of order (du, dv) on the grid `u` x `v`, shape (len(u), len(v), 2)."""
        return self.derivative(np.atleast_1d(u)[:, None], np.atleast_1d(v), du, dv)

    def __call__(self, u: ArrayLike, v: ArrayLike) -> FloatArray:
        """Points at the parameters (u, v), arrays of any shapes that broadcast: their common shape + (2,).

        Raises
        ------
        InputError
            When a parameter is outside the domain; it may be its first or last one, to the bit.

        Examples
        --------
        >>> square = Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])
        >>> square(0.25, [0.0, 0.5, 1.0])
        array([[0.25, 0.  ],
               [0.25, 0.5 ],
               [0.25, 1.  ]])
        """
        return self.derivative(u, v)

    def derivative(self, u: ArrayLike, v: ArrayLike, du: int = 0, dv: int = 0) -> FloatArray:
        """Partial derivative of order `du` in u and `dv` in v at the parameters (u, v), of patches with weights too.

        Parameters
        ----------
        u, v : array_like
            Of any shapes that broadcast.
        du, dv : int, default 0
            Orders, 0 or more.

        Returns
        -------
        array
            The common shape of `u` and `v` + (2,). At a knot where the derivative jumps it is that of the span
            after it, at the end of the domain that of the last span.

        Raises
        ------
        InputError
            When a parameter is outside the domain, an order negative, or the shapes do not broadcast.
        """
        try:
            at_u, at_v = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
        except ValueError as error:
            raise InputError(f"parameters u and v: {error}") from None
        for t, along, order, name in zip((at_u, at_v), self.knots, (du, dv), "uv", strict=True):
            check_inside(t, along, f"patch: parameter {name}")
            check_order(order, f"d{name}")
        flat_u, flat_v = np.ascontiguousarray(at_u).ravel(), np.ascontiguousarray(at_v).ravel()
        knots = (np.ascontiguousarray(self.knots[0]), np.ascontiguousarray(self.knots[1]))

        def values(coefficients: FloatArray, a: int, b: int) -> FloatArray:
            coefficients = np.ascontiguousarray(coefficients)
            return evaluate_tensor(knots, self.degrees, coefficients, flat_u, flat_v, a, b)

        if self.weights is None:
            found = values(self.control_points, du, dv)
        else:
            h = weighted(self.control_points, self.weights)
            found = quotient_derivative(lambda i, j: values(h, i, j), du, dv)
        return found.reshape(*at_u.shape, 2)

    def jacobian(self, u: ArrayLike, v: ArrayLike) -> FloatArray:
        """Jacobian matrices at the parameters (u, v), their common shape + (2, 2), with the columns B_u and B_v."""
        return np.stack([self.derivative(u, v, 1, 0), self.derivative(u, v, 0, 1)], axis=-1)

    def _homogeneous(self) -> FloatArray:
        """Weighted control points and weights (n_u, n_v, 3) of a rational patch."""
        if self.weights is None:
            raise InputError("a polynomial patch has no weights")
        w = self.weights[..., None]
        return np.concatenate([self.control_points * w, w], axis=2)

    def insert_knots(self, axis: int, new: ArrayLike) -> Patch:
        """The same patch with the knots `new` added in direction `axis` (0 for u, 1 for v)."""
        return self._along(axis, lambda k, p, c: (*insert_knots(k, p, c, new), p))

    def split_spans(self, parts: int = 2) -> Patch:
        """The same patch with every knot span cut into `parts` equal ones."""
        patch = self
        for axis in (0, 1):
            breaks = knot_spans(self.knots[axis])
            inner = breaks[:-1, None] + np.diff(breaks)[:, None] * (np.arange(1, parts) / parts)
            patch = patch.insert_knots(axis, inner.ravel())
        return patch

    def reduce_continuity(self, smoothness: int) -> Patch:
        """The same patch with inner knots repeated until splines are only C^smoothness there."""
        if smoothness < 0:
            raise InputError(f"patches are continuous inside: smoothness must be 0 or more, got {smoothness}")
        patch = self
        for axis in (0, 1):
            breaks, multiplicity = np.unique(self.knots[axis], return_counts=True)
            missing = np.maximum(self.degrees[axis] - smoothness - multiplicity, 0)
            patch = patch.insert_knots(axis, np.repeat(breaks[1:-1], missing[1:-1]))
        return patch

    def elevate(self, by: int = 1) -> Patch:
        """The same patch with both degrees raised."""

        def raise_degree(k: FloatArray, p: int, c: FloatArray) -> tuple[FloatArray, FloatArray, int]:
            knots, degree, coefficients = elevate(k, p, c, by)
            return knots, coefficients, degree

        return self._along(0, raise_degree)._along(1, raise_degree)

    def _along(self, axis: int, operation: Any) -> Patch:
        """Apply a univariate operation on coefficients along one axis."""
        c = self.control_points if self.weights is None else self._homogeneous()
        knots, moved, degree = operation(self.knots[axis], self.degrees[axis], np.moveaxis(c, axis, 0))
        c = np.moveaxis(moved, 0, axis)
        all_knots, all_degrees = list(self.knots), list(self.degrees)
        all_knots[axis], all_degrees[axis] = knots, degree
        if self.weights is None:
            return Patch(all_knots, all_degrees, c)
        return Patch(all_knots, all_degrees, c[..., :2] / c[..., 2:], c[..., 2])

    def to_core(self) -> PatchTuple:
        """As the compiled core takes it."""
        return (*self.knots, *self.degrees, self.control_points, self.weights)

    def to_scipy(self) -> NdBSpline:
        """`scipy.interpolate.NdBSpline` of a polynomial patch."""
        if self.weights is not None:
            raise InputError("SciPy has no rational splines")
        from scipy.interpolate import NdBSpline

        return NdBSpline(self.knots, self.control_points, self.degrees)

    @classmethod
    def from_scipy(cls, spline: NdBSpline) -> Self:
        """Take over a clamped bivariate `scipy.interpolate.NdBSpline` with values in the plane."""
        return cls(spline.t, spline.k, spline.c)
