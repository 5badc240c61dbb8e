"""Univariate B-spline bases: knot vectors, basis functions, knot insertion, degree elevation.

Knot vectors are clamped; interior knots have at most the degree as multiplicity, so everything is continuous.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from .._core import evaluate_spline
from ..errors import InputError
from ..limits import LARGEST, MAX_KNOT_RATIO, MAX_WEIGHT_RATIO
from ..numeric.arrays import FloatArray, IntArray, distinct, frozen_array

__all__ = [
    "check_inside",
    "check_knots",
    "check_order",
    "check_samples",
    "check_weights",
    "collocation_matrix",
    "elevate",
    "end_rate",
    "greville",
    "in_range",
    "insert_knots",
    "knot_spans",
    "parts_of_spans",
    "reverse_knots",
    "span_basis",
    "spline_values",
    "weights_agree",
]

#: Weights of a polynomial that was refined or elevated as a rational spline differ by some units of roundoff.
WEIGHT_ULPS = 8.0


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
    with np.errstate(over="ignore"):
        steps = np.diff(knots)
    if (steps < 0).any():
        raise InputError(f"{what}: knot vector decreases at knot {int(np.argmax(steps < 0)) + 1}")
    if knots[degree] != knots[0] or knots[-degree - 1] != knots[-1]:
        raise InputError(f"{what}: knot vector is not clamped (end knots must be repeated {degree + 1} times)")
    if knots[0] == knots[-1]:
        raise InputError(f"{what}: knot vector spans nothing")
    inner = knots[1:-1]
    if (inner[degree:] == inner[:-degree]).any():
        raise InputError(f"{what}: an interior knot has a multiplicity above the degree {degree} (a jump)")
    shortest = int(np.argmin(np.where(steps > 0, steps, np.inf)))
    # Of Python's floats, for a domain may be longer than all numbers.
    if not float(knots[-1]) - float(knots[0]) <= MAX_KNOT_RATIO * float(steps[shortest]):
        a, b = float(knots[shortest]), float(knots[shortest + 1])
        raise InputError(
            f"{what}: the knots {a!r} and {b!r} are nearer than {1 / MAX_KNOT_RATIO:g} of the domain's length; "
            "make them equal"
        )


def check_weights(weights: ArrayLike | None, shape: tuple[int, ...], what: str) -> FloatArray | None:
    """Return the read-only weights of a rational object, None for a polynomial one."""
    if weights is None:
        return None
    array = frozen_array(weights, f"{what}: weights")
    if array.shape != shape:
        raise InputError(f"{what}: weights have shape {array.shape}, the control points {shape}")
    if (array <= 0).any():
        raise InputError(f"{what}: weight {array.min():g} is not positive")
    if not in_range(array):
        raise InputError(
            f"{what}: weights from {array.min():g} to {array.max():g}; they may differ by a factor of "
            f"{MAX_WEIGHT_RATIO:g}, and be from {1 / LARGEST:g} to {LARGEST:g}: correct or scale them"
        )
    return array


def in_range(weights: FloatArray) -> bool:
    """Whether positive weights are within `LARGEST` of one and `MAX_WEIGHT_RATIO` of each other."""
    least, largest = float(weights.min()), float(weights.max())
    return 1 / LARGEST <= least <= largest <= min(LARGEST, least * MAX_WEIGHT_RATIO)


def weights_agree(weights: FloatArray) -> bool:
    """Whether weights differ by no more than rounding, so that files mean a polynomial by them.

    The polynomial is off the rational spline by the same part of the control points' extent, which is less than the
    rounding of points that a program computed.
    """
    return bool(np.ptp(weights) <= WEIGHT_ULPS * np.finfo(float).eps * np.abs(weights).max())


def check_inside(t: FloatArray, knots: FloatArray, what: str) -> None:
    """Raise `InputError` unless all parameters `t` lie in the domain, limits included; NaN does not."""
    outside = ~((t >= knots[0]) & (t <= knots[-1]))
    if outside.any():
        value = float(t[outside].flat[0])
        raise InputError(f"{what} = {value!r} is outside the domain [{float(knots[0])!r}, {float(knots[-1])!r}]")


def check_order(order: int, what: str) -> None:
    """Raise `InputError` unless a derivative's order is a whole number from 0 on."""
    if order != int(order) or order < 0:
        raise InputError(f"{what} = {order}: the order of a derivative is a whole number from 0 on")


def knot_spans(knots: ArrayLike) -> FloatArray:
    """Distinct knots, the breaks between spans."""
    return distinct(np.asarray(knots, dtype=np.float64))


def parts_of_spans(knots: ArrayLike, parts: int) -> FloatArray:
    """Parameters that cut every knot span into equal parts, the spans' ends included."""
    breaks = knot_spans(knots)
    return np.interp(np.arange(parts * (len(breaks) - 1) + 1) / parts, np.arange(len(breaks)), breaks)


def reverse_knots(knots: FloatArray) -> FloatArray:
    """Knot vector of the reversed curve, on the same domain."""
    return np.asarray((knots[0] + knots[-1]) - knots[::-1])


def end_rate(knots: FloatArray, degree: int, at_end: bool) -> float:
    """Degree by length of the first (or last) span: what a step to the next coefficient counts for in the derivative.

    For parameters mapped to [0, 1], so that the speeds of patches with other domains are comparable.
    """
    span = knots[-1] - knots[-degree - 2] if at_end else knots[degree + 1] - knots[0]
    return degree * float((knots[-1] - knots[0]) / span)


def greville(knots: FloatArray, degree: int) -> FloatArray:
    """Greville abscissae (n,), the coefficients of the identity."""
    return np.array([knots[i + 1 : i + degree + 1].mean() for i in range(len(knots) - degree - 1)])


def collocation_matrix(knots: ArrayLike, degree: int, t: ArrayLike, order: int = 0) -> FloatArray:
    """Values of all basis functions' derivatives of `order` at the points `t`, shape (len(t), n)."""
    knots = np.asarray(knots, dtype=np.float64)
    return spline_values(knots, degree, np.eye(len(knots) - degree - 1), np.asarray(t, dtype=np.float64), order)


def spline_values(
    knots: FloatArray, degree: int, coefficients: FloatArray, t: FloatArray, order: int = 0
) -> FloatArray:
    """Values, or derivatives of `order`, of a spline with coefficients (n, d) at parameters of any shape: (..., d).

    As SciPy's `BSpline`, to the bit, without its import, which takes longer than to check a model.
    """
    return evaluate_spline(knots, degree, coefficients, t.ravel(), order).reshape(*t.shape, -1)


def check_samples(samples: int) -> None:
    """Raise `InputError` unless there are two samples a knot span, for its ends."""
    if samples < 2:
        raise InputError(f"samples = {samples}: at least 2 per knot span are needed, its two ends")


def span_basis(knots: ArrayLike, degree: int, samples: int) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    """Basis functions and their derivatives at uniform parameters of every span, one-sided at its ends.

    Parameters
    ----------
    knots : (n + degree + 1,) array
        Clamped knot vector.
    degree : int
    samples : int
        Parameters per span, both ends included, at least 2.

    Returns
    -------
    t : (m,) array
        The parameters, m = spans · samples; the breaks occur twice, seen from either span.
    basis : tuple of three (m, n) arrays
        Values, first and second derivatives. All arrays are read-only and shared between calls.
    """
    check_samples(samples)
    return _span_basis(np.ascontiguousarray(knots, dtype=np.float64).tobytes(), degree, samples)


@lru_cache(maxsize=256)
def _span_basis(knot_bytes: bytes, degree: int, samples: int) -> tuple[FloatArray, tuple[FloatArray, ...]]:
    knots = np.frombuffer(knot_bytes)
    breaks = knot_spans(knots)
    n, m = len(knots) - degree - 1, len(breaks) - 1
    t = np.linspace(breaks[:-1], breaks[1:], samples, axis=1)
    basis = np.zeros((3, m, samples, n))
    for span in range(m):
        last = int(np.searchsorted(knots, breaks[span], side="right")) - 1
        # The 2p + 2 knots around one span hold no other span: evaluation cannot look beyond its ends.
        local, unit = knots[last - degree : last + degree + 2], np.eye(degree + 1)
        for order in range(min(degree, 2) + 1):
            basis[order, span, :, last - degree : last + 1] = spline_values(local, degree, unit, t[span], order)
    t, out = t.ravel(), basis.reshape(3, -1, n)
    t.flags.writeable = out.flags.writeable = False
    return t, tuple(out)


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

    All coefficients are means of given ones, so that knots may be near and weights differ by magnitudes.
    """
    for _ in range(by):
        knots, first, parts = _raising(np.ascontiguousarray(knots).tobytes(), degree)
        taken = coefficients[first[:, None] + np.arange(parts.shape[1])]
        raised = (parts.reshape(*parts.shape, *[1] * (coefficients.ndim - 1)) * taken).sum(axis=1)
        # Sums of parts of one may round beyond it.
        coefficients = np.clip(raised, coefficients.min(axis=0), coefficients.max(axis=0))
        degree += 1
    return knots, degree, coefficients


@lru_cache(maxsize=256)
def _raising(knot_bytes: bytes, degree: int) -> tuple[FloatArray, IntArray, FloatArray]:
    """Knots of one degree more, and what each coefficient is the mean of: the first (n,) and their parts (n, width).

    The polar form of the higher degree is the mean of the lower one's over all ways to leave out an argument (Ramshaw,
    Blossoms are polar forms, 1989, section 9), and a coefficient is its value at the knots inside its support.
    """
    knots = np.frombuffer(knot_bytes)
    breaks, multiplicity = np.unique(knots, return_counts=True)
    fine = np.repeat(breaks, multiplicity + 1)
    rows = np.zeros((len(fine) - degree - 2, len(knots) - degree - 1))
    for i in range(len(rows)):
        at = fine[i + 1 : i + degree + 2]
        first = np.flatnonzero(np.append(True, at[1:] > at[:-1]))
        for k, count in zip(first, np.diff(np.append(first, len(at))), strict=True):
            start, parts = _polar_form(knots, degree, np.delete(at, k))
            rows[i, start : start + len(parts)] += count / (degree + 1) * parts
    begin = np.minimum((rows != 0).argmax(axis=1), rows.shape[1] - degree - 1)
    return fine, begin, np.take_along_axis(rows, begin[:, None] + np.arange(degree + 1), axis=1)


def _polar_form(knots: FloatArray, degree: int, at: FloatArray) -> tuple[int, FloatArray]:
    """Polar form of a spline at `degree` successive knots, of which inner ones may be once more there than in `knots`.

    The number of the first coefficient and the parts of it and those after it.
    """
    start = max(int(np.searchsorted(knots, at[0])) - degree - 1, 0)
    local = knots[start : int(np.searchsorted(knots, at[-1], side="right")) + degree + 1]
    values = distinct(at)
    there, wanted = (np.searchsorted(t, values, "right") - np.searchsorted(t, values) for t in (local, at))
    local, parts = insert_knots(local, degree, np.eye(len(local) - degree - 1), values[wanted > there])
    last = int(np.searchsorted(local, at[0], side="right")) - 1
    return start, parts[min(last - int(wanted[0]), len(parts) - 1)]
