"""A rational curve as a polynomial spline: its shape is fitted, not its parameters.

A B-spline may run along the curve at a speed of its own, which is worth some orders: a quarter circle on one span of
degree 4 is missed by 7e-7 of its radius, at the speed of its NURBS by 5e-4. Ends are kept to the bit and so are the
tangents there, so that smooth joints stay smooth and straight corners straight: that costs a factor of two.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..geometry.basis import collocation_matrix, knot_spans
from ..geometry.curve import BSplineCurve
from ..numeric.arrays import FloatArray
from ..numeric.dense import least_squares, product, solve

__all__ = ["ArcFit", "direction", "distances", "fit_arc", "projected", "sampled"]

#: Samples of a span for the fit, and for the distance that is reported. A difference of two curves of degree 4 has
#: some ten extremes on a span; six samples from one to the next leave 2 % between them, which is added.
FITTED, MEASURED = 16, 64
#: Steps at most; they end when the largest distance changes by less than a part of itself.
STEPS, SETTLED = 60, 0.01
#: Tries, until one is near enough: whether samples start evenly along the curve or at its own speed, what moving along
#: it costs in a step beside the same error across it, and the factor of that from one step to the next. The first is
#: fast and mostly the best; where weights differ much its steps may leap into another valley.
TRIES = ((False, 1e-2, 1e-2), (True, 1e-2, 1e-2), (False, 1.0, 0.3))
#: What it costs at last: with more, fits stop digits short of the best, for along the curve little holds them.
LEAST_DAMPING = 1e-16
#: A fit this much below the limit is near enough: the more steps, the farther it leaves the curve's own speed.
ENOUGH = 0.9
#: Steps of Newton's method to the foot of a perpendicular.
FOOT_STEPS = 4
#: Singular values below this part of the largest are rounding.
ROUNDING = 1e-15
#: A control point nearer to the end than this part of the curve's extent gives no direction.
COINCIDING = 1e-9


class ArcFit(NamedTuple):
    """A spline beside a curve: control points (n, 2), and how far they are apart at most, span by span."""

    points: FloatArray
    distances: FloatArray


def sampled(knots: FloatArray, per_span: int) -> FloatArray:
    """Parameters (spans * per_span + 1,), the breaks among them."""
    breaks = knot_spans(knots)
    parts = np.arange(per_span * (len(breaks) - 1) + 1) / per_span
    return np.interp(parts, np.arange(len(breaks)), breaks)


def projected(values: FloatArray, at: FloatArray, knots: FloatArray, degree: int) -> FloatArray:
    """Coefficients (n, ...) of the spline nearest to values (m, ...) at parameters (m,): equal at first and last."""
    basis = collocation_matrix(knots, degree, at)
    wanted = values.reshape(len(at), -1)
    ends, inner = wanted[[0, -1]], basis[:, 1:-1]
    if not inner.shape[1]:
        return values[[0, -1]]
    rest = wanted - product(basis[:, [0, -1]], ends)
    solved = solve(product(inner.T, inner), product(inner.T, rest))
    return np.concatenate([ends[:1], solved, ends[1:]]).reshape(-1, *values.shape[1:])


def direction(points: FloatArray) -> FloatArray | None:
    """Unit vector (2,) in which a curve leaves its first control point; None if it stays there."""
    ways = points[1:] - points[0]
    lengths = np.hypot(*ways.T)
    far = np.flatnonzero(lengths > COINCIDING * lengths.max(initial=0.0))
    return np.asarray(ways[far[0]] / lengths[far[0]]) if len(far) else None


def fit_arc(curve: BSplineCurve, knots: FloatArray, degree: int, limit: float) -> ArcFit:
    """The spline on these knots that comes nearest to a curve, in the sense of Gauss and Newton on the distance.

    Samples slide along the curve to the feet of their perpendiculars; residuals along it are damped, not penalised.

    Parameters
    ----------
    curve : BSplineCurve
        Without corners inside.
    knots : (n + degree + 1,) array
        On the curve's domain.
    degree : int
        At least 3: ends and tangents are kept.
    limit : float
        Distance at which to stop.
    """
    t = sampled(knots, FITTED)
    ends = direction(curve.control_points), direction(curve.control_points[::-1])
    if ends[0] is None or ends[1] is None:
        return _measured(curve, knots, degree, projected(curve(t), t, knots, degree))
    system = _System(curve, collocation_matrix(knots, degree, t), ends[0], ends[1])
    points, error = np.empty(0), np.inf
    for even, *schedule in TRIES:
        s = _evenly(curve, t) if even else t
        start = system.held(projected(curve(s), t, knots, degree))
        found, off = _nearest(system, start, s, limit, *schedule)
        if off < error or not len(points):
            points, error = found, off
        if error <= ENOUGH * limit:
            break
    return _measured(curve, knots, degree, points)


def _nearest(
    system: _System, points: FloatArray, s: FloatArray, limit: float, damping: float, eased: float
) -> tuple[FloatArray, float]:
    """The best of the steps from control points and parameters of their samples, and the samples' largest distance."""
    curve = system.curve
    best, error, last = points, np.inf, np.inf
    for _ in range(STEPS):
        here = system.at(points)
        s = _feet(curve, here, s, 1)
        now = float(np.hypot(*(here - curve(s)).T).max())
        if now < error and system.forwards(points, here, s):
            best, error = points, now
        if error <= ENOUGH * limit or (damping == LEAST_DAMPING and abs(now - last) <= SETTLED * now):
            break
        last = now
        points = system.step(points, s, damping)
        damping = max(eased * damping, LEAST_DAMPING)
    return best, error


def _evenly(curve: BSplineCurve, t: FloatArray) -> FloatArray:
    """Parameters whose points have the distances along the curve that the parameters `t` have from each other."""
    fine = np.linspace(t[0], t[-1], 8 * len(t) + 1)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(curve(fine), axis=0).T))])
    return np.asarray(np.interp((t - t[0]) * (length[-1] / (t[-1] - t[0])), length, fine))


class _System:
    """Linear least squares for control points whose legs keep their directions: unknowns are two lengths and points."""

    def __init__(self, curve: BSplineCurve, basis: FloatArray, first: FloatArray, last: FloatArray) -> None:
        self.curve, self.basis, self.ends = curve, basis, (first, last)
        self.count = basis.shape[1]

    def held(self, points: FloatArray) -> FloatArray:
        """Control points with their legs turned into the ends' directions."""
        legs = [max(float((points[i] - points[j]) @ e), 0.0) for (i, j), e in zip(_LEGS, self.ends, strict=True)]
        return self._points(np.concatenate([legs, points[2:-2].ravel()]))

    def at(self, points: FloatArray) -> FloatArray:
        """The spline at the samples."""
        return product(self.basis, points)

    def forwards(self, points: FloatArray, samples: FloatArray, s: FloatArray) -> bool:
        """Whether the spline leaves its ends, and goes from sample to sample, as the curve at parameters `s`."""
        slope = self.curve(s, 1)
        steps = (np.diff(samples, axis=0) * (slope[1:] + slope[:-1])).sum(axis=1)
        legs = [float((points[i] - points[j]) @ e) for (i, j), e in zip(_LEGS, self.ends, strict=True)]
        return min(float(steps.min()), *legs) > 0.0

    def step(self, points: FloatArray, s: FloatArray, damping: float) -> FloatArray:
        """Control points nearer to the tangents at the parameters `s` of the curve."""
        slope = self.curve(s, 1)
        tangent = slope / np.hypot(*slope.T)[:, None]
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
        fixed = product(self.basis, self._points(np.zeros(2 * self.count - 6)))
        rows, right = [], []
        for across, wanted, factor in ((normal, self.curve(s), 1.0), (tangent, self.at(points), damping**0.5)):
            rows.append(factor * self._rows(across))
            right.append(factor * ((wanted - fixed) * across).sum(axis=1))
        # Of the normal equations half of the digits would be left.
        return self._points(least_squares(np.concatenate(rows), np.concatenate(right), ROUNDING))

    def _rows(self, across: FloatArray) -> FloatArray:
        """Derivatives (m, 2 n - 6) of the samples' components along unit vectors (m, 2)."""
        legs = [self.basis[:, i] * (across @ e) for (i, _), e in zip(_LEGS, self.ends, strict=True)]
        inner = self.basis[:, 2:-2, None] * across[:, None]
        return np.column_stack([*legs, inner.reshape(len(across), -1)])

    def _points(self, unknowns: FloatArray) -> FloatArray:
        control = self.curve.control_points
        points = np.concatenate([control[[0, 0]], unknowns[2:].reshape(-1, 2), control[[-1, -1]]])
        points[1] += unknowns[0] * self.ends[0]
        points[-2] += unknowns[1] * self.ends[1]
        return points


#: Control points whose differences are the legs, at the first and at the last end.
_LEGS = ((1, 0), (-2, -1))


def _feet(curve: BSplineCurve, points: FloatArray, near: FloatArray, steps: int) -> FloatArray:
    """Parameters of the feet of perpendiculars, from ones near by; in order, the ends kept."""
    a, b = curve.domain
    s = near
    for _ in range(steps):
        slope = curve(s, 1)
        size = np.maximum((slope**2).sum(axis=1), np.finfo(float).tiny)
        s = s + ((points - curve(s)) * slope).sum(axis=1) / size
        s[0], s[-1] = a, b
        s = np.maximum.accumulate(s.clip(a, b))
    return s


def _measured(curve: BSplineCurve, knots: FloatArray, degree: int, points: FloatArray) -> ArcFit:
    return ArcFit(points, distances(curve, lambda t: product(collocation_matrix(knots, degree, t), points), knots))


def distances(curve: BSplineCurve, other: Callable[[FloatArray], FloatArray], knots: FloatArray) -> FloatArray:
    """How far two curves with common ends are apart, span by span (n,): bounds their Hausdorff distance both ways.

    Points are paired with feet of perpendiculars, in order along both curves, so that no part of either is left out.
    Between samples the distance of a pair exceeds the larger one at its ends by an eighth of the second difference.
    """
    t = sampled(knots, MEASURED)
    points = other(t)
    apart = points - curve(_feet(curve, points, t, FOOT_STEPS))
    at, bend = np.hypot(*apart.T), np.hypot(*np.diff(apart, 2, axis=0).T)
    spans = (len(t) - 1) // MEASURED
    return np.array(
        [
            at[k * MEASURED : (k + 1) * MEASURED + 1].max() + bend[k * MEASURED : (k + 1) * MEASURED - 1].max() / 8
            for k in range(spans)
        ]
    )
