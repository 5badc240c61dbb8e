"""B-spline and NURBS curves and tensor-product patches of the plane: immutable values.

Control points are indexed ``[i]`` on curves and ``[i, j]`` = (u, v) on patches (C order). Knot vectors are
clamped; interior knots have at most the degree as multiplicity, so everything is continuous.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, NdBSpline

from . import _core, dense
from .errors import InputError

__all__ = [
    "BSplineCurve",
    "FloatArray",
    "IntArray",
    "Patch",
    "collocation_matrix",
    "elevate",
    "greville",
    "insert_knots",
    "knot_spans",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def frozen_array(values: ArrayLike, what: str) -> FloatArray:
    """Return a read-only float64 copy of `values`; `InputError` if it has NaN, infinity or no numbers."""
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: not an array of numbers ({error})") from None
    if not np.isfinite(array).all():
        raise InputError(f"{what}: contains NaN or infinity")
    array.flags.writeable = False
    return array


def check_knots(knots: FloatArray, degree: int, count: int, what: str) -> None:
    """Raise `InputError` unless `knots` is a clamped knot vector of `degree` for `count` control points."""
    if degree < 1:
        raise InputError(f"{what}: degree {degree} is not supported, it must be at least 1")
    if knots.ndim != 1 or len(knots) != count + degree + 1:
        raise InputError(
            f"{what}: a knot vector of degree {degree} for {count} control points has {count + degree + 1} "
            f"knots, got {knots.size}"
        )
    if count < degree + 1:
        raise InputError(f"{what}: degree {degree} needs at least {degree + 1} control points, got {count}")
    if (np.diff(knots) < 0).any():
        raise InputError(f"{what}: knot vector decreases at knot {int(np.argmax(np.diff(knots) < 0)) + 1}")
    if knots[degree] != knots[0] or knots[-degree - 1] != knots[-1]:
        raise InputError(f"{what}: knot vector is not clamped (end knots must be repeated {degree + 1} times)")
    if knots[0] == knots[-1]:
        raise InputError(f"{what}: knot vector spans nothing")
    inner = knots[1:-1]
    if (inner[degree:] == inner[:-degree]).any():
        raise InputError(f"{what}: an interior knot has a multiplicity above the degree {degree} (a jump)")


def check_weights(weights: ArrayLike | None, shape: tuple[int, ...], what: str) -> FloatArray | None:
    """Return the read-only weights of a rational object, None for a polynomial one."""
    if weights is None:
        return None
    array = frozen_array(weights, f"{what}: weights")
    if array.shape != shape:
        raise InputError(f"{what}: weights have shape {array.shape}, the control points {shape}")
    if (array <= 0).any():
        raise InputError(f"{what}: weight {array.min():g} is not positive")
    return array


def knot_spans(knots: ArrayLike) -> FloatArray:
    """Distinct knots, the breaks between spans."""
    return np.unique(np.asarray(knots, dtype=np.float64))


def greville(knots: FloatArray, degree: int) -> FloatArray:
    """Greville abscissae (n,), the coefficients of the identity."""
    return np.array([knots[i + 1 : i + degree + 1].mean() for i in range(len(knots) - degree - 1)])


def collocation_matrix(knots: ArrayLike, degree: int, t: ArrayLike, order: int = 0) -> FloatArray:
    """Values of all basis functions' derivatives of `order` at the points `t`, shape (len(t), n)."""
    knots = np.asarray(knots, dtype=np.float64)
    basis = BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    return np.asarray(basis(np.asarray(t, dtype=np.float64), nu=order))


def insert_knots(
    knots: FloatArray, degree: int, coefficients: FloatArray, new: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Insert knots without changing the spline (Boehm).

    Parameters
    ----------
    knots : (n + degree + 1,) array
    degree : int
    coefficients : (n, ...) array
        The spline's coefficients along the first axis.
    new : array
        Knots to insert, repeated as often as wanted.

    Returns
    -------
    knots, coefficients
        The refined knot vector and the coefficients, (n + len(new), ...).
    """
    for x in np.sort(np.atleast_1d(np.asarray(new, dtype=np.float64))):
        if not knots[0] < x < knots[-1]:
            raise InputError(f"knot {x:g} to insert is not inside the domain ({knots[0]:g}, {knots[-1]:g})")
        k = int(np.searchsorted(knots, x, side="right")) - 1
        i = np.arange(k - degree + 1, k + 1)
        alpha = ((x - knots[i]) / (knots[i + degree] - knots[i])).reshape(-1, *[1] * (coefficients.ndim - 1))
        middle = (1 - alpha) * coefficients[i - 1] + alpha * coefficients[i]
        coefficients = np.concatenate([coefficients[: k - degree + 1], middle, coefficients[k:]])
        knots = np.insert(knots, k + 1, x)
    return knots, coefficients


def elevate(
    knots: FloatArray, degree: int, coefficients: FloatArray, by: int = 1
) -> tuple[FloatArray, int, FloatArray]:
    """Raise the degree without changing the spline: every knot gains `by` in multiplicity.

    Done by interpolation in the elevated space at its Greville abscissae, which is exact up to rounding.
    """
    breaks, multiplicity = np.unique(knots, return_counts=True)
    fine, degree_up = np.repeat(breaks, multiplicity + by), degree + by
    # A mean of equal end knots may round out of the domain.
    at = np.clip(greville(fine, degree_up), knots[0], knots[-1])
    flat = coefficients.reshape(len(coefficients), -1)
    values = dense.product(collocation_matrix(knots, degree, at), flat)
    raised = dense.solve(collocation_matrix(fine, degree_up, at), values)
    raised[0], raised[-1] = flat[0], flat[-1]
    return fine, degree_up, np.asarray(raised.reshape(-1, *coefficients.shape[1:]), dtype=np.float64)


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
        Positive weights; None for a polynomial curve.

    Raises
    ------
    InputError
        On a knot vector that is not clamped or decreases, on NaN, on shapes that do not fit.

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
        return isinstance(other, BSplineCurve) and _same(self, other, ("knots", "control_points", "weights"))

    __hash__ = None  # type: ignore[assignment]

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
        """Point (or derivative of `order` 0, 1 or 2) at the parameters `t`, shape (..., 2)."""
        t = np.asarray(t, dtype=np.float64)
        if self.weights is None:
            return np.asarray(BSpline(self.knots, self.control_points, self.degree)(t, nu=order))
        spline = BSpline(self.knots, self.homogeneous(), self.degree)
        h = [spline(t, nu=k) for k in range(order + 1)]
        weight = h[0][..., 2:]
        point = h[0][..., :2] / weight
        if order == 0:
            return np.asarray(point)
        first = (h[1][..., :2] - h[1][..., 2:] * point) / weight
        if order == 1:
            return np.asarray(first)
        if order > 2:
            raise InputError("derivatives above the second are not available for rational curves")
        return np.asarray((h[2][..., :2] - 2 * h[1][..., 2:] * first - h[2][..., 2:] * point) / weight)

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
        pieces = _core.bezier_extract(self.knots, self.degree, self.homogeneous())
        return knot_spans(self.knots), pieces

    def to_scipy(self) -> BSpline:
        """`scipy.interpolate.BSpline` of a polynomial curve."""
        if self.weights is not None:
            raise InputError("SciPy has no rational splines; use homogeneous() instead")
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


@dataclass(frozen=True, eq=False)
class Patch:
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
        Positive weights; None for a polynomial patch.

    Raises
    ------
    InputError
        On knot vectors that are not clamped or decrease, on NaN, on shapes that do not fit.

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

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Patch) and _same(self, other, ("knots", "control_points", "weights"))

    __hash__ = None  # type: ignore[assignment]

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
        """Derivative of order (du, dv), each 0 or 1, on the grid `u` x `v`, shape (len(u), len(v), 2)."""
        (p, q), (knots_u, knots_v) = self.degrees, self.knots

        def tensor(coefficients: FloatArray, a: int, b: int) -> FloatArray:
            flat = coefficients.reshape(len(coefficients), -1)
            along_u = dense.product(collocation_matrix(knots_u, p, np.atleast_1d(u), a), flat)
            along_v = collocation_matrix(knots_v, q, np.atleast_1d(v), b)
            return dense.product(along_v, along_u.reshape(-1, *coefficients.shape[1:]))

        if self.weights is None:
            return tensor(self.control_points, du, dv)
        if du + dv > 1:
            raise InputError("mixed derivatives are not available for rational patches")
        w = self.weights[..., None]
        h = np.concatenate([self.control_points * w, w], axis=2)
        value = tensor(h, 0, 0)
        point = value[..., :2] / value[..., 2:]
        if du + dv == 0:
            return np.asarray(point)
        slope = tensor(h, du, dv)
        return np.asarray((slope[..., :2] - slope[..., 2:] * point) / value[..., 2:])

    def __call__(self, u: float, v: float) -> FloatArray:
        """Point at the parameters (u, v), shape (2,)."""
        return np.asarray(self.grid([u], [v])[0, 0])

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
        c = self.control_points
        if self.weights is not None:
            c = np.concatenate([c * self.weights[..., None], self.weights[..., None]], axis=2)
        knots, moved, degree = operation(self.knots[axis], self.degrees[axis], np.moveaxis(c, axis, 0))
        c = np.moveaxis(moved, 0, axis)
        all_knots, all_degrees = list(self.knots), list(self.degrees)
        all_knots[axis], all_degrees[axis] = knots, degree
        if self.weights is None:
            return Patch(all_knots, all_degrees, c)
        return Patch(all_knots, all_degrees, c[..., :2] / c[..., 2:], c[..., 2])

    def to_core(self) -> _core.PatchTuple:
        """As the compiled core takes it."""
        return (*self.knots, *self.degrees, self.control_points, self.weights)

    def to_scipy(self) -> NdBSpline:
        """`scipy.interpolate.NdBSpline` of a polynomial patch."""
        if self.weights is not None:
            raise InputError("SciPy has no rational splines")
        return NdBSpline(self.knots, self.control_points, self.degrees)

    @classmethod
    def from_scipy(cls, spline: NdBSpline) -> Self:
        """Take over a clamped bivariate `scipy.interpolate.NdBSpline` with values in the plane."""
        return cls(spline.t, spline.k, spline.c)


def reverse_knots(knots: FloatArray) -> FloatArray:
    """Knot vector of the reversed curve, on the same domain."""
    return np.asarray((knots[0] + knots[-1]) - knots[::-1])


def _same(a: Any, b: Any, names: tuple[str, ...]) -> bool:
    """Bit-equality of the named array attributes."""

    def flat(x: Any) -> list[FloatArray | None]:
        return list(x) if isinstance(x, tuple) else [x]

    for name in names:
        for x, y in zip(flat(getattr(a, name)), flat(getattr(b, name)), strict=True):
            if x is None or y is None:
                if x is not y:
                    return False
            elif not np.array_equal(x, y):
                return False
    degrees = ("degree", "degrees")
    return all(a.__dict__.get(name) == b.__dict__.get(name) for name in degrees)
