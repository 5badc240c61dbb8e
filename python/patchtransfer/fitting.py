"""Stage 2b, boundary fit: one target curve per source boundary side, on the side's degree and knots.

Paper §3.2, Eq. 2–6: least squares with both ends interpolated. The paper takes uniform parameters;
``parameters="uniform"`` does that. The default departs from it in three ways:

- samples start with the source's own speed along the side and slide along the target to the foot of their
  perpendicular (orthogonal distance fit by Gauss–Newton; residuals along the tangent are damped, not penalised);
- where the target is smooth at a joint, the end tangents of both curves stay on one line, so no kink is added. The
  line itself is free: holding it at the target's tangent costs up to ten times in accuracy on few control points;
- if a side's error is not well below the tolerance, samples are reweighted (Lawson) to level the largest errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import spsolve

from . import _core
from .errors import InputError
from .outline import Outline, hausdorff
from .registration import LoopRegistration, Registration
from .splines import BSplineCurve, FloatArray, collocation_matrix, knot_spans

__all__ = ["FittedBoundary", "FittedSide", "fit_boundary"]

IntArray = NDArray[np.int64]

#: Samples per knot span and at least per side.
SAMPLES_PER_SPAN, MIN_SAMPLES = 14, 24
#: A joint is smooth when the target turns by less there.
SMOOTH = np.radians(2.0)
#: Sliding by this part of the side costs as much as an error of this part of the tolerance: where the shape leaves the
#: parameters free (straight or round sides) the source's speed is kept, and control points do not crowd.
SLIDE, SLIDE_ERROR = 0.1, 0.1
#: Steps before tangents are joined, and steps at most before levelling.
FREE_STEPS, STEPS = 3, 20
#: Part of the tolerance above which errors are levelled.
LEVEL_ABOVE = 0.4
#: Rounds of levelling at most, and how many without improvement end them.
LEVELLING, PATIENCE = 40, 10
#: What counts as an improvement of the error, before levelling and during it.
IMPROVEMENT = (0.1, 0.01)
#: Backing up costs this many times what an error of the same length costs.
BACKING_UP = 100.0
#: A tangent turns by at most this angle in one step.
MAX_TURN = 0.1
#: Up to so many smooth joints the system for their angles is solved as a dense one, which has less overhead.
DENSE = 200
#: At a corner a leg may stray from the target's tangent by this angle before it is put on it.
MAX_STRAY = np.radians(25.0)


@dataclass(frozen=True)
class FittedSide:
    """Fit of one boundary side, in the sense of the loop.

    Attributes
    ----------
    curve : BSplineCurve
    error : float
        Largest distance of the samples from the target, relative to the target's diameter.
    smooth : bool
        Whether the joint at the side's start is smooth.
    """

    curve: BSplineCurve
    error: float
    smooth: bool


@dataclass(frozen=True)
class FittedBoundary:
    """Fitted sides, loop by loop in the order of the source's loops.

    Attributes
    ----------
    loops : tuple of tuples of FittedSide
    error : float
        Two-sided Hausdorff distance to the target, relative to the target's diameter.
    warnings : tuple of str
    """

    loops: tuple[tuple[FittedSide, ...], ...]
    error: float
    warnings: tuple[str, ...]


def fit_boundary(registration: Registration, *, parameters: str = "speed", tolerance: float = 1e-3) -> FittedBoundary:
    """Fit every source boundary side to its part of the target.

    Parameters
    ----------
    registration : Registration
        Gives the sides (degree, knots, speed) and the corresponding part of the target.
    parameters : {"speed", "uniform"}, default "speed"
        Where the samples are in the parameter domain: with the source's speed and corrected, or uniform and
        fixed as in the paper (no tangents kept there).
    tolerance : float, default 1e-3
        Error relative to the target's diameter that a side should reach; larger ones are reported.

    Returns
    -------
    FittedBoundary
    """
    if parameters not in ("speed", "uniform"):
        raise InputError(f'parameters must be "speed" or "uniform", got {parameters!r}')
    uniform = parameters == "uniform"
    diameter = float(np.linalg.norm(np.ptp(registration.loops[0].target.polygon(512), axis=0)))
    sides, bases = _Sides(), _Bases()
    for loop in registration.loops:
        _add_sides(sides, bases, loop, uniform)
    fit = _core.BoundaryFit(
        [loop.target.core for loop in registration.loops],
        bases.values,
        sides.data,
        SLIDE_ERROR * tolerance * diameter / SLIDE,
    )
    smooth = [abs(loop.target.turn(loop.joints[:-1])) < SMOOTH for loop in registration.loops]
    if uniform:
        points, errors = fit.control_points(), fit.errors(True)
    else:
        points, errors = _iterate(fit, _smooth_joints(smooth, sides.inner), LEVEL_ABOVE * tolerance * diameter)
    return _collect(registration, points, errors / diameter, smooth, uniform, tolerance, diameter)


def _collect(
    registration: Registration,
    points: FloatArray,
    errors: FloatArray,
    smooth: Sequence[NDArray[np.bool_]],
    uniform: bool,
    tolerance: float,
    diameter: float,
) -> FittedBoundary:
    """Curves and their errors, loop by loop, with warnings on those above the tolerance."""
    loops, warnings, distances = [], [], []
    at, side = 0, 0
    for k, loop in enumerate(registration.loops):
        fitted = []
        for i, curve in enumerate(loop.source.curves):
            n, error = len(curve.control_points), float(errors[side])
            image = curve.with_control_points(points[at : at + n])
            fitted.append(FittedSide(image, error, bool(smooth[k][i] and not uniform)))
            at, side = at + n, side + 1
            if error > tolerance:
                warnings.append(
                    f"boundary loop {k}, side {i}: the source's knots miss the target by {error:.1e} of its diameter "
                    f"(tolerance {tolerance:.1e}); refine the source"
                )
        loops.append(tuple(fitted))
        distances.append(hausdorff(Outline([side.curve for side in fitted]), loop.target) / diameter)
        if distances[-1] > tolerance >= max(side.error for side in fitted):
            # Samples may all lie on the target while the curve cuts a part of it short.
            warnings.append(
                f"boundary loop {k}: the source's knots miss a part of the target by {distances[-1]:.1e} of its "
                f"diameter (tolerance {tolerance:.1e}); refine the source"
            )
    return FittedBoundary(tuple(loops), max(distances), tuple(warnings))


class _Bases:
    """Basis functions at the samples, once for all sides of the same degree and knots."""

    def __init__(self) -> None:
        self.values: list[FloatArray] = []
        self._known: dict[tuple[int, bytes], tuple[int, FloatArray]] = {}

    def of(self, curve: BSplineCurve) -> tuple[int, FloatArray]:
        """Index of the basis and the samples' parameters."""
        key = (curve.degree, curve.knots.tobytes())
        if key not in self._known:
            breaks = knot_spans(curve.knots)
            per_span = max(SAMPLES_PER_SPAN, -(-MIN_SAMPLES // (len(breaks) - 1)))
            t = np.interp(np.arange(per_span * (len(breaks) - 1) + 1) / per_span, np.arange(len(breaks)), breaks)
            self._known[key] = len(self.values), t
            self.values.append(collocation_matrix(curve.knots, curve.degree, t))
        return self._known[key]


class _Sides:
    """All sides, one after the other: what the core needs, and their numbers of inner control points."""

    def __init__(self) -> None:
        self.data: list[tuple[int, int, FloatArray, FloatArray, FloatArray, FloatArray]] = []
        self.inner: list[int] = []
        self.loops = 0


def _add_sides(sides: _Sides, bases: _Bases, loop: LoopRegistration, uniform: bool) -> None:
    """Samples of the target for the sides of a loop, their end points, tangents and legs."""
    joints, source, target = loop.joints, loop.source, loop.target
    # The joint's point is evaluated at one and the same arc length for both curves that meet there.
    points = target.point(joints[:-1])
    near = 1e-9 * target.length
    leaving, arriving = target.tangent(joints[:-1] + near), target.tangent(joints[1:] - near, True)
    scale = np.diff(joints) / np.diff(source.joints)
    known = [bases.of(curve) for curve in source.curves]
    images: list[FloatArray] = []
    if not uniform:
        on_source = [source.arc_length(i, t) for i, (_, t) in enumerate(known)]
        images = np.split(loop.to_target(np.concatenate(on_source)), np.cumsum([len(s) for s in on_source[:-1]]))
    for i, (curve, (basis, t)) in enumerate(zip(source.curves, known, strict=True)):
        lengths = np.linspace(joints[i], joints[i + 1], len(t)) if uniform else images[i]
        ends = points[[i, (i + 1) % len(points)]]
        c = curve.control_points
        legs = scale[i] * np.linalg.norm(c[[1, -2]] - c[[0, -1]], axis=1)
        sides.data.append((basis, sides.loops, lengths, ends, np.stack([leaving[i], arriving[i]]), legs))
        sides.inner.append(len(c) - 2)
    sides.loops += 1


def _smooth_joints(smooth: Sequence[NDArray[np.bool_]], inner: Sequence[int]) -> IntArray:
    """Sides (before, after) at every smooth joint, (m, 2), whose legs shall lie on one line."""
    pairs, first = [], 0
    for flags in smooth:
        n = len(flags)
        pairs += [(first + (j - 1) % n, first + j) for j in np.flatnonzero(flags).tolist()]
        first += n
    # A curve of one inner control point has no leg of its own at either end.
    return np.array([(a, b) for a, b in pairs if min(inner[a], inner[b]) > 1], dtype=np.int64).reshape(-1, 2)


def _iterate(fit: _core.BoundaryFit, joints: IntArray, level_above: float) -> tuple[FloatArray, FloatArray]:
    """Gauss–Newton steps on control points, feet and tangents together, then levelling of the largest errors.

    Returns the control points of all sides and their errors.
    """
    best, best_step, found = np.inf, 0, (fit.control_points(), fit.errors(True))
    levelling, error = False, found[1]
    for step in range(STEPS + LEVELLING):
        fit.linearise(levelling)
        if step == FREE_STEPS and len(joints):
            _align(fit, joints)
        elif step > FREE_STEPS and len(joints):
            _turn(fit, joints, error)
        fit.solve()
        if step < FREE_STEPS:
            continue
        fit.hold_ends(float(np.cos(MAX_STRAY)))
        error = fit.errors(False)
        worst = float(error.max())
        # Tangents are shared, so the best is one of all sides together: the largest error, then the others. Loops are
        # worse than any error: they rule out an injective map.
        score = worst + 0.1 * float(error.mean()) + BACKING_UP * fit.backwards()
        if score < (1 - IMPROVEMENT[levelling]) * best:
            best_step = step
        if score < best:
            best, found = score, (fit.control_points(), error)
        settled = levelling or step >= STEPS or step - best_step >= 2
        if settled and (worst <= level_above or (levelling and step - best_step > PATIENCE)):
            break
        levelling = settled
    return found


def _align(fit: _core.BoundaryFit, joints: IntArray) -> None:
    """Put both legs of every smooth joint on the mean of their directions."""
    before, after = joints.T
    # Turning a leg by an angle moves its control point by length * angle: weigh by the squared length.
    legs = fit.legs()
    a, b = legs[before, 1], legs[after, 0]
    mean = np.linalg.norm(a, axis=1)[:, None] * a + np.linalg.norm(b, axis=1)[:, None] * b
    size = np.linalg.norm(mean, axis=1)[:, None]
    _set_lines(fit, joints, np.where(size > 0, mean / np.maximum(size, 1e-300), fit.lines()[after, 0]))


def _turn(fit: _core.BoundaryFit, joints: IntArray, error: FloatArray) -> None:
    """Turn the lines at smooth joints by the minimiser of the sides' quadratic models (a cyclic tridiagonal system)."""
    before, after = joints.T
    stiffness, gradient = fit.turning()
    share = (0.1 + error / max(float(error.max()), 1e-300)) ** 2
    stiffness, gradient = stiffness * share[:, None, None], gradient * share[:, None]
    m = len(joints)
    # Joint at the (start, end) of every side; the last row and column are for ends without one.
    joint = np.full((len(share), 2), m)
    joint[after, 0] = joint[before, 1] = np.arange(m)
    rows, columns = (x.ravel() for x in np.broadcast_arrays(joint[:, :, None], joint[:, None]))
    right = np.bincount(joint.ravel(), gradient.ravel(), m + 1)[:m]
    lift = 1e-9 * np.abs(stiffness).sum() / m + 1e-300
    if m <= DENSE:
        dense = np.bincount(rows * (m + 1) + columns, stiffness.ravel(), (m + 1) ** 2).reshape(m + 1, m + 1)[:m, :m]
        angle = np.linalg.solve(dense + lift * np.eye(m), right)
    else:
        matrix = coo_array((stiffness.ravel(), (rows, columns)), shape=(m + 1, m + 1)).tocsc()[:m, :m]
        angle = spsolve(matrix + lift * eye_array(m, format="csc"), right)
    angle = np.clip(angle, -MAX_TURN, MAX_TURN)[:, None]
    line = fit.lines()[after, 0]
    turned = np.cos(angle) * line + np.sin(angle) * np.stack([-line[:, 1], line[:, 0]], axis=1)
    _set_lines(fit, joints, turned / np.linalg.norm(turned, axis=1)[:, None])


def _set_lines(fit: _core.BoundaryFit, joints: IntArray, directions: FloatArray) -> None:
    before, after = np.ascontiguousarray(joints.T)
    directions = np.ascontiguousarray(directions)
    fit.set_lines(before, 1, directions)
    fit.set_lines(after, 0, directions)
