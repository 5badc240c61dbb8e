"""Stage 2b, boundary fit: one target curve per source boundary side, on the side's degree and knots.

Paper §3.2, Eq. 2–6: least squares with both ends interpolated. The paper takes uniform parameters;
``parameters="uniform"`` does that. The default departs from it in three ways:

- samples start with the source's own speed along the side and slide along the target to the foot of their
  perpendicular (orthogonal distance fit by Gauss–Newton; residuals along the tangent are damped, not penalised);
- where the target is smooth at a joint, the end tangents of both curves stay on one line, so no kink is added. The
  line itself is free: holding it at the target's tangent costs up to ten times in accuracy on few control points;
- sides that miss a tenth of the tolerance are reweighted (Lawson) to level their largest errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .errors import InputError
from .outline import Outline, hausdorff
from .registration import LoopRegistration, Registration
from .splines import BSplineCurve, FloatArray, collocation_matrix, knot_spans

__all__ = ["FittedBoundary", "FittedSide", "fit_boundary"]

#: Samples per knot span and at least per side.
SAMPLES_PER_SPAN, MIN_SAMPLES = 14, 24
#: A joint is smooth when the target turns by less there.
SMOOTH = np.radians(2.0)
#: Weight of the residual along the tangent in the Gauss–Newton steps; the sliding makes it vanish at the end.
DAMPING = 0.03
#: Gauss–Newton steps at most before levelling, and the relative change at which they stop.
STEPS, CHANGE = 20, 1e-3
#: Rounds of reweighting.
LEVELLING = 15
#: A tangent turns by at most this angle in one step, and never gets shorter than this part of the mean leg.
MAX_TURN, SHORTEST_LEG = 0.1, 0.05


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


def fit_boundary(
    registration: Registration, *, parameters: str = "speed", tolerance: float = 1e-3
) -> FittedBoundary:
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
    groups: dict[tuple[object, ...], _Group] = {}
    sides: list[list[tuple[_Group, int]]] = []
    for loop in registration.loops:
        sides.append([_add_side(groups, loop, i, uniform) for i in range(len(loop.source.curves))])
    for group in groups.values():
        group.prepare()
    smooth = [abs(loop.target.turn(loop.joints[:-1])) < SMOOTH for loop in registration.loops]
    joints = (
        []
        if uniform
        else [
            _Joint(sides[k][j - 1], sides[k][j])
            for k, flags in enumerate(smooth)
            for j in np.flatnonzero(flags)
        ]
    )
    if not uniform:
        _iterate(list(groups.values()), joints, 0.1 * tolerance * diameter)
    loops, warnings = [], []
    for k, loop in enumerate(registration.loops):
        fitted = []
        for i, (curve, (group, row)) in enumerate(zip(loop.source.curves, sides[k], strict=True)):
            error = float(group.best_error[row]) / diameter
            side = BSplineCurve(curve.knots, curve.degree, group.best[row])
            fitted.append(FittedSide(side, error, bool(smooth[k][i] and not uniform)))
            if error > tolerance:
                warnings.append(
                    f"boundary loop {k}, side {i}: the source's knots miss the target by {error:.1e} of its diameter "
                    f"(tolerance {tolerance:.1e}); refine the source"
                )
        loops.append(tuple(fitted))
    distance = max(
        hausdorff(Outline([side.curve for side in fitted]), loop.target)
        for fitted, loop in zip(loops, registration.loops, strict=True)
    )
    return FittedBoundary(tuple(loops), distance / diameter, tuple(warnings))


def _add_side(
    groups: dict[tuple[object, ...], _Group], loop: LoopRegistration, i: int, uniform: bool
) -> tuple[_Group, int]:
    """Sample the target for side `i` and put the side to those with the same degree and knots."""
    curve, joints = loop.source.curves[i], loop.joints
    breaks = knot_spans(curve.knots)
    per_span = max(SAMPLES_PER_SPAN, -(-MIN_SAMPLES // (len(breaks) - 1)))
    t = np.interp(np.arange(per_span * (len(breaks) - 1) + 1) / per_span, np.arange(len(breaks)), breaks)
    key = (curve.degree, curve.knots.tobytes())
    group = groups.setdefault(key, _Group(collocation_matrix(curve.knots, curve.degree, t)))
    if uniform:
        lengths = np.linspace(joints[i], joints[i + 1], len(t))
    else:
        lengths = loop.to_target(loop.source.arc_length(i, t))
    # The joint's point is evaluated at one and the same arc length for both curves that meet there.
    ends = loop.target.point(np.array([joints[i], joints[(i + 1) % len(loop.source.curves)]]))
    group.rows.append((loop.target, lengths, ends))
    return group, len(group.rows) - 1


@dataclass
class _Joint:
    """A smooth joint: the end leg of one side and the start leg of the next lie on one line."""

    before: tuple[_Group, int]
    after: tuple[_Group, int]


@dataclass
class _Group:
    """Sides with the same degree and knots, fitted together; arrays have one row a side."""

    basis: FloatArray
    rows: list[tuple[Outline, FloatArray, FloatArray]] = field(default_factory=list)

    def prepare(self) -> None:
        """Sample the target and fit once, with the starting parameters (Eq. 6)."""
        g, n = len(self.rows), self.basis.shape[1]
        self.outlines = [row[0] for row in self.rows]
        self.lengths = np.array([row[1] for row in self.rows])
        self.ends = np.array([row[2] for row in self.rows])
        self.target = self._sample(self.lengths)
        self.target[:, [0, -1]] = self.ends
        self.weights = np.ones((g, len(self.basis) - 2))
        m = n - 2
        self.axes = np.broadcast_to(np.eye(2), (g, m, 2, 2)).copy()
        #: Whether the (start, end) leg keeps to the line through its end point along axis 0.
        self.on_line = np.zeros((g, 2), bool)
        self.linearise(np.broadcast_to(np.eye(2), (g, len(self.basis) - 2, 2, 2)))
        self.solve()
        self.error = self._errors()
        self.best, self.best_error = self.control, self.error

    def _sample(self, lengths: FloatArray, tangent: bool = False) -> FloatArray:
        out = np.empty((*lengths.shape, 2))
        for outline in {id(o): o for o in self.outlines}.values():
            rows = [i for i, o in enumerate(self.outlines) if o is outline]
            out[rows] = outline.tangent(lengths[rows]) if tangent else outline.point(lengths[rows])
        return out

    def _errors(self) -> FloatArray:
        return np.asarray(np.linalg.norm(self.basis @ self.control - self.target, axis=2).max(axis=1))

    def slide(self) -> None:
        """Move the inner samples along the target towards the feet of the perpendiculars from the curve."""
        tangent = self._sample(self.lengths, tangent=True)
        move = ((self.basis @ self.control - self.target) * tangent).sum(axis=2)
        move[:, [0, -1]] = 0.0
        self.lengths = np.clip(self.lengths + move, self.lengths[:, :1], self.lengths[:, -1:])
        self.target = self._sample(self.lengths)
        self.target[:, [0, -1]] = self.ends
        tangent = self._sample(self.lengths, tangent=True)[:, 1:-1]
        self.across = np.eye(2) - (1 - DAMPING) * tangent[..., :, None] * tangent[..., None, :]

    def linearise(self, metric: FloatArray) -> None:
        """Normal equations for the inner control points, the residual measured in `metric` (g, samples, 2, 2)."""
        inner = self.basis[1:-1, 1:-1]
        known = self.basis[1:-1, :1] * self.ends[:, None, 0] + self.basis[1:-1, -1:] * self.ends[:, None, 1]
        metric = metric * self.weights[..., None, None]
        g, m = len(metric), inner.shape[1]
        outer = np.einsum("ki,kj->kij", inner, inner).reshape(len(inner), m * m)
        self.normal = np.einsum("gkab,kp->gpab", metric, outer).reshape(g, m, m, 2, 2)
        rest = np.einsum("gkab,gkb->gka", metric, self.target[:, 1:-1] - known)
        self.right = np.einsum("ki,gka->gia", inner, rest)

    def _local(self) -> tuple[FloatArray, FloatArray]:
        """Normal matrix (g, 2m, 2m) and right-hand side (g, 2m) in the local axes."""
        g, m = self.axes.shape[:2]
        normal = np.einsum("gica,gijab,gjdb->gicjd", self.axes, self.normal, self.axes, optimize=True)
        return normal.reshape(g, 2 * m, 2 * m), np.einsum("gica,gia->gic", self.axes, self.right).reshape(
            g, 2 * m
        )

    @property
    def _across_index(self) -> list[int]:
        """Index of the across coordinates of the start and the end leg."""
        return [1, 2 * self.axes.shape[1] - 1]

    def legs(self) -> FloatArray:
        """Signed lengths (g, 2) of the legs along their axes; the end leg's is negative."""
        tip = self.control[:, [1, -2]] - self.ends
        return np.asarray((tip * self.axes[:, [0, -1], 0]).sum(axis=2))

    def turning(self) -> tuple[FloatArray, FloatArray]:
        """Quadratic model of the squared error in the angles of the legs: matrices (g, 2, 2), gradients (g, 2)."""
        a, b = self._local()
        inverse = np.linalg.inv(a)
        free = (inverse @ b[..., None])[..., 0][:, self._across_index]
        held = (self.axes[:, [0, -1], 1] * self.ends).sum(axis=2)
        # Everything else eliminated, the across coordinates of the legs on lines have the matrix (A^-1)^-1.
        both = self.on_line[:, :, None] & self.on_line[:, None]
        compliance = np.where(both, inverse[:, self._across_index][:, :, self._across_index], np.eye(2))
        stiffness = np.where(both, np.linalg.inv(compliance), 0.0)
        legs = self.legs()
        gradient = (stiffness @ (free - held)[..., None])[..., 0] * legs
        return stiffness * legs[:, :, None] * legs[:, None], gradient

    def solve(self) -> None:
        """Control points of the least-squares fit, legs on their lines and pointing forwards."""
        g, m = self.axes.shape[:2]
        if m == 0:
            self.control = self.ends.copy()
            return
        a, b = self._local()
        fixed = np.zeros((g, 2 * m), bool)
        value = np.zeros((g, 2 * m))
        fixed[:, self._across_index] |= self.on_line
        value[:, self._across_index] = np.where(
            self.on_line, (self.axes[:, [0, -1], 1] * self.ends).sum(axis=2), 0
        )
        x = _constrained(a, b, fixed, value)
        along = [0, 2 * m - 2]
        base = (self.axes[:, [0, -1], 0] * self.ends).sum(axis=2)
        forward = np.array([1.0, -1.0])
        shortest = SHORTEST_LEG * np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1)[:, None] / (m + 1)
        short = self.on_line & (forward * (x[:, along] - base) < shortest)
        if short.any():
            fixed[:, along] |= short
            value[:, along] = np.where(short, base + 2 * forward * shortest, value[:, along])
            x = _constrained(a, b, fixed, value)
        points = np.einsum("gica,gic->gia", self.axes, x.reshape(g, m, 2))
        self.control = np.concatenate([self.ends[:, :1], points, self.ends[:, 1:]], axis=1)
        # Rebuilt from the end points, so that collinearity holds to rounding of the leg, not of the coordinates.
        for end, inner in ((0, 1), (1, -2)):
            leg = (x[:, along[end]] - base[:, end])[:, None] * self.axes[:, 0 if end == 0 else -1, 0]
            rebuilt = self.ends[:, end] + leg
            self.control[:, inner] = np.where(self.on_line[:, end, None], rebuilt, self.control[:, inner])

    def keep_best(self) -> None:
        """Remember the sides that got better."""
        self.error = self._errors()
        better = self.error < self.best_error
        self.best = np.where(better[:, None, None], self.control, self.best)
        self.best_error = np.where(better, self.error, self.best_error)


def _constrained(a: FloatArray, b: FloatArray, fixed: FloatArray, value: FloatArray) -> FloatArray:
    """Solve with some unknowns fixed, one system a row."""
    known = np.where(fixed, value, 0.0)
    right = np.where(fixed, known, b - np.einsum("gij,gj->gi", a, known))
    matrix = np.where(fixed[:, :, None] | fixed[:, None], 0.0, a)
    matrix[:, np.arange(a.shape[1]), np.arange(a.shape[1])] += fixed
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


def _iterate(groups: list[_Group], joints: list[_Joint], level_above: float) -> None:
    """Gauss–Newton steps on control points, feet and tangents together, then levelling of the largest errors."""
    active = [group for group in groups if group.axes.shape[1] > 0]
    if not active:
        return
    total = sum(len(group.rows) for group in active)
    free_steps = 3 if joints else 0
    best = np.inf
    for step in range(STEPS + LEVELLING):
        before = [group.control for group in active]
        levelling = step >= STEPS
        for group in active:
            if levelling:
                residual = np.linalg.norm(group.basis[1:-1] @ group.control - group.target[:, 1:-1], axis=2)
                group.weights *= 0.05 + residual / np.maximum(residual.max(axis=1, keepdims=True), 1e-300)
                group.weights /= group.weights.mean(axis=1, keepdims=True)
            group.slide()
            group.linearise(group.across)
        if joints and step == free_steps:
            # Only lines that exist can turn: start from the mean direction of the free fits.
            joints = [joint for joint in joints if _align(joint)]
        elif joints and step > free_steps:
            _turn(active, joints)
        for group in active:
            group.solve()
            group.slide()
        if step < free_steps:
            continue
        worst = 0.0
        for group in active:
            if step == free_steps:
                group.error = group._errors()
                group.best, group.best_error = group.control, group.error
            if not joints:
                group.keep_best()
            group.error = group._errors()
            worst = max(worst, float(group.error.max()))
        if joints:
            # Tangents are shared, so the best is one of all sides together.
            score = float(np.sqrt(sum((group.error**2).sum() for group in active) / total)) + worst
            if score < best:
                best = score
                for group in active:
                    group.best, group.best_error = group.control, group.error
        if not levelling and step > free_steps + 1:
            change = max(float(np.abs(g.control - b).max()) for g, b in zip(active, before, strict=True))
            if change < CHANGE * max(worst, 1e-12) and worst <= level_above:
                return
        if levelling and worst <= level_above:
            return


def _align(joint: _Joint) -> bool:
    """Put both legs of a joint on the mean of their directions; False if one of the sides has no leg to turn."""
    (group_a, row_a), (group_b, row_b) = joint.before, joint.after
    if group_a.axes.shape[1] < 2 or group_b.axes.shape[1] < 2:
        return False
    # Turning a leg by an angle moves its control point by length * angle: weigh by the squared length.
    legs = (
        group_a.ends[row_a, 1] - group_a.control[row_a, -2],
        group_b.control[row_b, 1] - group_b.ends[row_b, 0],
    )
    mean = sum(np.linalg.norm(leg) * leg for leg in legs)
    size = float(np.linalg.norm(mean))
    if size == 0.0:
        return False
    _set_axis(joint, mean / size)
    return True


def _set_axis(joint: _Joint, tau: FloatArray) -> None:
    for (group, row), point, end in ((joint.before, -1, 1), (joint.after, 0, 0)):
        group.axes[row, point] = [tau, [-tau[1], tau[0]]]
        group.on_line[row, end] = True


def _turn(groups: Sequence[_Group], joints: Sequence[_Joint]) -> None:
    """Turn the lines of all joints by the minimiser of the quadratic model; sides with large errors count more."""
    index: dict[tuple[int, int, int], int] = {}
    for j, joint in enumerate(joints):
        index[id(joint.before[0]), joint.before[1], 1] = j
        index[id(joint.after[0]), joint.after[1], 0] = j
    matrix, right = np.zeros((len(joints), len(joints))), np.zeros(len(joints))
    worst = max(float(group.error.max()) for group in groups)
    for group in groups:
        stiffness, gradient = group.turning()
        share = (0.1 + group.error / max(worst, 1e-300)) ** 2
        ends = np.array(
            [
                [index.get((id(group), row, 0), -1), index.get((id(group), row, 1), -1)]
                for row in range(len(group.rows))
            ]
        )
        for a in range(2):
            rows = np.flatnonzero(ends[:, a] >= 0)
            np.add.at(right, ends[rows, a], share[rows] * gradient[rows, a])
            for b in range(2):
                rows = np.flatnonzero((ends[:, a] >= 0) & (ends[:, b] >= 0))
                np.add.at(matrix, (ends[rows, a], ends[rows, b]), share[rows] * stiffness[rows, a, b])
    matrix[np.diag_indices(len(joints))] += 1e-9 * np.trace(matrix) / len(joints) + 1e-300
    for joint, angle in zip(
        joints, np.clip(np.linalg.solve(matrix, right), -MAX_TURN, MAX_TURN), strict=True
    ):
        tau, nu = joint.after[0].axes[joint.after[1], 0]
        turned = np.cos(angle) * tau + np.sin(angle) * nu
        _set_axis(joint, turned / np.linalg.norm(turned))
