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
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import spsolve

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
DAMPING = 0.01
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
#: A tangent turns by at most this angle in one step, and gets no shorter than this part of the source's (to scale).
MAX_TURN, SHORTEST_LEG = 0.1, 0.2
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
    groups: dict[tuple[object, ...], _Group] = {}
    sides: list[list[tuple[_Group, int]]] = []
    for loop in registration.loops:
        sides.append([_add_side(groups, loop, i, uniform) for i in range(len(loop.source.curves))])
    for group in groups.values():
        group.prepare(SLIDE_ERROR * tolerance * diameter)
    smooth = [abs(loop.target.turn(loop.joints[:-1])) < SMOOTH for loop in registration.loops]
    joints = (
        []
        if uniform
        else [_Joint(sides[k][j - 1], sides[k][j]) for k, flags in enumerate(smooth) for j in np.flatnonzero(flags)]
    )
    if not uniform:
        _iterate(list(groups.values()), joints, LEVEL_ABOVE * tolerance * diameter)
    loops, warnings, distances = [], [], []
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
        distances.append(hausdorff(Outline([side.curve for side in fitted]), loop.target) / diameter)
        if distances[-1] > tolerance >= max(side.error for side in fitted):
            # Samples may all lie on the target while the curve cuts a part of it short.
            warnings.append(
                f"boundary loop {k}: the source's knots miss a part of the target by {distances[-1]:.1e} of its "
                f"diameter (tolerance {tolerance:.1e}); refine the source"
            )
    return FittedBoundary(tuple(loops), max(distances), tuple(warnings))


def _add_side(
    groups: dict[tuple[object, ...], _Group], loop: LoopRegistration, i: int, uniform: bool
) -> tuple[_Group, int]:
    """Sample the target for side `i` and put the side to those with the same degree and knots."""
    curve, joints = loop.source.curves[i], loop.joints
    breaks = knot_spans(curve.knots)
    per_span = max(SAMPLES_PER_SPAN, -(-MIN_SAMPLES // (len(breaks) - 1)))
    t = np.interp(np.arange(per_span * (len(breaks) - 1) + 1) / per_span, np.arange(len(breaks)), breaks)
    key = (curve.degree, curve.knots.tobytes())
    if key not in groups:
        groups[key] = _Group(collocation_matrix(curve.knots, curve.degree, t))
    group = groups[key]
    fractions = np.linspace(joints[i], joints[i + 1], len(t))
    lengths = fractions if uniform else loop.to_target(loop.source.arc_length(i, t))
    # The joint's point is evaluated at one and the same arc length for both curves that meet there.
    ends = loop.target.point(np.array([joints[i], joints[(i + 1) % len(loop.source.curves)]]))
    near = 1e-9 * loop.target.length
    tangents = np.stack([loop.target.tangent(joints[i] + near), loop.target.tangent(joints[i + 1] - near, True)])
    c, scale = curve.control_points, (joints[i + 1] - joints[i]) / (loop.source.joints[i + 1] - loop.source.joints[i])
    legs = scale * np.linalg.norm(c[[1, -2]] - c[[0, -1]], axis=1)
    group.rows.append((loop.target, lengths, ends, tangents, legs))
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
    rows: list[tuple[Outline, FloatArray, FloatArray, FloatArray, FloatArray]] = field(default_factory=list)
    control: FloatArray = field(init=False)
    across: FloatArray = field(init=False)

    def prepare(self, error: float) -> None:
        """Sample the target and fit once, with the starting parameters (Eq. 6); `error` scales the cost of sliding."""
        g = len(self.rows)
        self.outlines: list[tuple[Outline, list[int]]] = []
        for outline in {id(row[0]): row[0] for row in self.rows}.values():
            self.outlines.append((outline, [i for i, row in enumerate(self.rows) if row[0] is outline]))
        self.lengths = self.anchor = np.array([row[1] for row in self.rows])
        self.hold = ((error / SLIDE) / np.ptp(self.lengths, axis=1)) ** 2
        self.ends = np.array([row[2] for row in self.rows])
        self.corner_tangents = np.array([row[3] for row in self.rows])
        self.shortest = SHORTEST_LEG * np.array([row[4] for row in self.rows])
        self.weights = np.ones((g, len(self.basis) - 2))
        inner = self.basis[1:-1, 1:-1]
        m = inner.shape[1]
        self.products = np.einsum("ki,kj->kij", inner, inner).reshape(len(inner), m * m)
        #: Orthonormal axes of every inner control point, rows of a block-diagonal matrix.
        self.axes = np.broadcast_to(np.eye(2 * m), (g, 2 * m, 2 * m)).copy()
        #: Whether the (start, end) leg keeps to the line through its end point along its first axis.
        self.on_line: NDArray[np.bool_] = np.zeros((g, 2), bool)
        self._sample()
        self.across = np.broadcast_to(np.eye(2), self.across.shape)
        self.linearise()
        self.solve()
        self.error = self._errors()
        self.best, self.best_error = self.control, self.error

    def _sample(self) -> None:
        """Target points at the arc lengths, and the metric that counts residuals across the target."""
        samples = np.empty((*self.lengths.shape, 4))
        for outline, rows in self.outlines:
            samples[rows] = outline.evaluate(self.lengths[rows])
        samples[:, [0, -1], :2] = self.ends
        self.target, self.tangent = samples[..., :2], samples[..., 2:]
        tangent = self.tangent[:, 1:-1]
        along = (DAMPING + self.hold)[:, None, None, None]
        self.across = np.eye(2) - (1 - along) * tangent[..., :, None] * tangent[..., None, :]

    def _errors(self) -> FloatArray:
        return np.asarray(np.linalg.norm(self.basis @ self.control - self.target, axis=2).max(axis=1))

    def hold_ends(self) -> None:
        """Put a free leg that strays far from the target's tangent at a corner on that tangent."""
        if self.right.shape[1] <= 2:
            return
        for end, direction in ((0, 1.0), (1, -1.0)):
            leg = direction * (self.control[:, 1 if end == 0 else -2] - self.ends[:, end])
            along = (leg * self.corner_tangents[:, end]).sum(axis=1)
            stray = ~self.on_line[:, end] & (along < np.cos(MAX_STRAY) * np.linalg.norm(leg, axis=1))
            for row in np.flatnonzero(stray):
                self.set_axis(int(row), end, self.corner_tangents[row, end])

    def foot_errors(self) -> FloatArray:
        """Largest distance of the curve's points from the target, to first order: without the part along it."""
        offset = self.basis @ self.control - self.target
        offset -= (offset * self.tangent).sum(axis=2)[..., None] * self.tangent
        return np.asarray(np.linalg.norm(offset, axis=2).max(axis=1))

    def slide(self) -> None:
        """Move the inner samples along the target towards the feet of the perpendiculars from the curve."""
        move = ((self.basis @ self.control - self.target) * self.tangent).sum(axis=2)
        move[:, [0, -1]] = 0.0
        self.lengths = np.clip(self.lengths + move, self.lengths[:, :1], self.lengths[:, -1:])
        self._sample()

    def level(self) -> None:
        """Give samples weight by their residual, so that the largest ones come down."""
        residual = np.linalg.norm(self.basis[1:-1] @ self.control - self.target[:, 1:-1], axis=2)
        self.weights *= 0.05 + residual / np.maximum(residual.max(axis=1, keepdims=True), 1e-300)
        self.weights /= self.weights.mean(axis=1, keepdims=True)

    def linearise(self) -> None:
        """Normal equations (g, 2m, 2m) for the inner control points, residuals measured across the target."""
        inner = self.basis[1:-1, 1:-1]
        known = self.basis[1:-1, :1] * self.ends[:, None, 0] + self.basis[1:-1, -1:] * self.ends[:, None, 1]
        metric = self.across * self.weights[..., None, None]
        (g, k), m = metric.shape[:2], inner.shape[1]
        blocks = self.products.T @ metric.reshape(g, k, 4)
        self.normal = blocks.reshape(g, m, m, 2, 2).swapaxes(2, 3).reshape(g, 2 * m, 2 * m)
        # The damping pulls to where the sample is now, the hold to where it started: one pull to a point in between.
        back = (self.hold / (DAMPING + self.hold))[:, None] * (self.anchor - self.lengths)[:, 1:-1]
        rest = self.target[:, 1:-1] + back[..., None] * self.tangent[:, 1:-1] - known
        rest = (metric @ rest[..., None])[..., 0]
        self.right = (inner.T @ rest).reshape(g, 2 * m)

    def _local(self) -> tuple[FloatArray, FloatArray]:
        """Normal matrix (g, 2m, 2m) and right-hand side (g, 2m) in the local axes."""
        right = (self.axes @ self.right[..., None])[..., 0]
        return self.axes @ self.normal @ self.axes.swapaxes(1, 2), right

    def axis(self, end: int, which: int) -> FloatArray:
        """First (along) or second (across) axis (g, 2) of the leg at the start (0) or the end (1)."""
        m = self.axes.shape[1] // 2
        at = 0 if end == 0 else 2 * (m - 1)
        return self.axes[:, at + which, at : at + 2]

    def set_axis(self, row: int, end: int, tau: FloatArray) -> None:
        """Put a leg on the line along `tau` through its end point."""
        at = 0 if end == 0 else self.axes.shape[1] - 2
        self.axes[row, at : at + 2, at : at + 2] = np.array([tau, (-tau[1], tau[0])])
        self.on_line[row, end] = True

    def _end_coordinates(self, which: int) -> FloatArray:
        """Coordinates (g, 2) of both end points along an axis of their legs."""
        return np.stack([(self.axis(e, which) * self.ends[:, e]).sum(axis=1) for e in (0, 1)], axis=1)

    @property
    def _across_index(self) -> list[int]:
        """Index of the across coordinates of the start and the end leg."""
        return [1, self.axes.shape[1] - 1]

    def legs(self) -> FloatArray:
        """Signed lengths (g, 2) of the legs along their axes; the end leg's is negative."""
        tips = self.control[:, 1] - self.ends[:, 0], self.control[:, -2] - self.ends[:, 1]
        return np.stack([(self.axis(e, 0) * tips[e]).sum(axis=1) for e in (0, 1)], axis=1)

    def turning(self) -> tuple[FloatArray, FloatArray]:
        """Quadratic model of the squared error in the angles of the legs: matrices (g, 2, 2), gradients (g, 2)."""
        a, b = self._local()
        inverse = np.linalg.inv(a)
        free = (inverse @ b[..., None])[..., 0][:, self._across_index]
        held = self._end_coordinates(1)
        # Everything else eliminated, the across coordinates of the legs on lines have the matrix (A^-1)^-1.
        both = self.on_line[:, :, None] & self.on_line[:, None]
        compliance = np.where(both, inverse[:, self._across_index][:, :, self._across_index], np.eye(2))
        stiffness = np.where(both, np.linalg.inv(compliance), 0.0)
        legs = self.legs()
        gradient = (stiffness @ (free - held)[..., None])[..., 0] * legs
        return stiffness * legs[:, :, None] * legs[:, None], gradient

    def solve(self) -> None:
        """Control points of the least-squares fit, legs on their lines and pointing forwards."""
        g, size = self.right.shape
        if size == 0:
            self.control = self.ends.copy()
            return
        a, b = self._local()
        fixed, value = np.zeros((g, size), bool), np.zeros((g, size))
        across, along = self._across_index, [0, size - 2]
        fixed[:, across] |= self.on_line
        value[:, across] = np.where(self.on_line, self._end_coordinates(1), 0.0)
        x = _constrained(a, b, fixed, value)
        base, forward = self._end_coordinates(0), np.array([1.0, -1.0])
        short = self.on_line & (forward * (x[:, along] - base) < self.shortest)
        if short.any():
            fixed[:, along] |= short
            value[:, along] = np.where(short, base + forward * self.shortest, value[:, along])
            x = _constrained(a, b, fixed, value)
        points = (self.axes.swapaxes(1, 2) @ x[..., None]).reshape(g, size // 2, 2)
        self.control = np.concatenate([self.ends[:, :1], points, self.ends[:, 1:]], axis=1)
        # Rebuilt from the end points, so that collinearity holds to rounding of the leg, not of the coordinates.
        for end, inner in ((0, 1), (1, -2)):
            leg = (x[:, along[end]] - base[:, end])[:, None] * self.axis(end, 0)
            rebuilt = self.ends[:, end] + leg
            self.control[:, inner] = np.where(self.on_line[:, end, None], rebuilt, self.control[:, inner])


def _constrained(a: FloatArray, b: FloatArray, fixed: NDArray[np.bool_], value: FloatArray) -> FloatArray:
    """Solve with some unknowns fixed, one system a row."""
    known = np.where(fixed, value, 0.0)
    right = np.where(fixed, known, b - np.einsum("gij,gj->gi", a, known))
    matrix = np.where(fixed[:, :, None] | fixed[:, None], 0.0, a)
    matrix[:, np.arange(a.shape[1]), np.arange(a.shape[1])] += fixed
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


def _iterate(groups: list[_Group], joints: list[_Joint], level_above: float) -> None:
    """Gauss–Newton steps on control points, feet and tangents together, then levelling of the largest errors."""
    groups = [group for group in groups if group.right.size]
    # A curve of one inner control point has no leg of its own at either end.
    joints = [j for j in joints if min(j.before[0].right.shape[1], j.after[0].right.shape[1]) > 2]
    if not groups:
        return
    levelling, best, best_step, worst = False, np.inf, 0, np.inf
    for step in range(STEPS + LEVELLING):
        for group in groups:
            if levelling:
                group.level()
            group.slide()
            group.linearise()
        if step == FREE_STEPS:
            for joint in joints:
                _align(joint)
        elif joints and step > FREE_STEPS:
            _turn(groups, joints)
        for group in groups:
            group.solve()
        if step < FREE_STEPS:
            continue
        for group in groups:
            group.hold_ends()
            group.error = group.foot_errors()
        worst = max(float(group.error.max()) for group in groups)
        # Tangents are shared, so the best is one of all sides together: the largest error, then the others.
        score = worst + 0.1 * float(np.mean(np.concatenate([group.error for group in groups])))
        if score < (1 - IMPROVEMENT[levelling]) * best:
            best_step = step
        if score < best:
            best = score
            for group in groups:
                group.best, group.best_error = group.control, group.error
        settled = levelling or step >= STEPS or step - best_step >= 2
        if settled and (worst <= level_above or (levelling and step - best_step > PATIENCE)):
            return
        levelling = settled


def _align(joint: _Joint) -> None:
    """Put both legs of a joint on the mean of their directions."""
    (group_a, row_a), (group_b, row_b) = joint.before, joint.after
    # Turning a leg by an angle moves its control point by length * angle: weigh by the squared length.
    legs = group_a.ends[row_a, 1] - group_a.control[row_a, -2], group_b.control[row_b, 1] - group_b.ends[row_b, 0]
    mean = sum(np.linalg.norm(leg) * leg for leg in legs)
    size = float(np.linalg.norm(mean))
    tau = mean / size if size > 0 else group_b.tangent[row_b, 0]
    group_a.set_axis(row_a, 1, tau)
    group_b.set_axis(row_b, 0, tau)


def _turn(groups: Sequence[_Group], joints: Sequence[_Joint]) -> None:
    """Turn the lines of all joints by the minimiser of the quadratic model; sides with large errors count more."""
    ends = {id(group): np.full((len(group.rows), 2), -1) for group in groups}
    for j, joint in enumerate(joints):
        ends[id(joint.before[0])][joint.before[1], 1] = j
        ends[id(joint.after[0])][joint.after[1], 0] = j
    n = len(joints)
    entries: list[tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]] = []
    right = np.zeros(n)
    worst = max(float(group.error.max()) for group in groups)
    for group in groups:
        stiffness, gradient = group.turning()
        share = (0.1 + group.error / max(worst, 1e-300)) ** 2
        index = ends[id(group)]
        for a in range(2):
            rows = np.flatnonzero(index[:, a] >= 0)
            np.add.at(right, index[rows, a], share[rows] * gradient[rows, a])
            for b in range(2):
                rows = np.flatnonzero((index[:, a] >= 0) & (index[:, b] >= 0))
                entries.append((share[rows] * stiffness[rows, a, b], index[rows, a], index[rows, b]))
    # A joint meets the two next to it only: cyclic tridiagonal, loop by loop.
    values, at, other = (np.concatenate(part) for part in zip(*entries, strict=True))
    matrix = coo_array((values, (at, other)), shape=(n, n)).tocsc()
    shift = 1e-9 * matrix.diagonal().sum() / n + 1e-300
    angles = spsolve(matrix + shift * eye_array(n, format="csc"), right)
    for joint, angle in zip(joints, np.clip(angles, -MAX_TURN, MAX_TURN), strict=True):
        group, row = joint.after
        turned = np.cos(angle) * group.axis(0, 0)[row] + np.sin(angle) * group.axis(0, 1)[row]
        turned /= np.linalg.norm(turned)
        group.set_axis(row, 0, turned)
        joint.before[0].set_axis(joint.before[1], 1, turned)
