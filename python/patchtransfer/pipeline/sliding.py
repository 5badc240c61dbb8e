"""Stage 2c, sliding joints: boundary correspondence of lower distortion, where shape leaves it open.

Beyond the paper. Between corners the boundary's shape says little about which point belongs to which, but the map's
distortion does. Joints that are neither corners nor landmarks move along the target boundary to where the energy of
the spline optimiser is least; every move is followed by a new fit and a new interior, and is kept only if the energy
came down. The step is Newton's in the joints alone: a joint's motion moves the boundary points next to it along the
target, and the interior follows so that it stays in equilibrium, which leaves the Schur complement of the energy's
Hessian.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..fitting.fit import FittedBoundary
from ..geometry.basis import greville
from ..geometry.topology import Topology
from ..interior.optimizer import AREA_WEIGHT, OptimizedMap, SplineOptimizer
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.dense import eigen, product
from ..progress import Budget
from ..registration.register import LoopRegistration, Registration

__all__ = ["Slid", "SlideReport", "movable_joints", "slide_joints"]


#: A joint where either boundary turns by more stays where it is.
CORNER = np.radians(10.0)
#: A joint closer to a landmark than this part of the loop is at it.
SAME_POINT = 1e-4
#: Rounds of moving all joints at most.
ROUNDS = 10
#: Dampings tried in a round, relative to the mean stiffness of the modes, until the energy comes down.
DAMPINGS = (0.0, 0.3, 1.0, 3.0, 10.0)
#: Moving ends when a round lowers the energy above its least possible value by less than this part, or promises to.
IMPROVEMENT = 0.02
#: Energy above the least possible that is as good as none: an isometry up to the fit.
NOTHING_TO_GAIN = 1e-6
#: A joint moves by at most this part of the distance to its neighbour in one round.
LONGEST_STEP = 0.3
#: Part of a transfer's work that is for sliding; the samples' joints need a tenth of it.
SHARE = 0.1
#: Newton steps after a move at most: few are left where it does good.
MAX_STEPS = 30
#: More modes than this are coupled in groups of neighbouring joints.
MODES = 96
#: Moves may raise a fit error that is above the tolerance by this factor in all.
FIT_GROWTH = 1.2


@dataclass(frozen=True)
class Slid:
    """Outcome of sliding.

    Attributes
    ----------
    registration : Registration
        With the joints where they are now.
    fitted : FittedBoundary
    map : OptimizedMap
        Fold-free at the optimiser's nodes.
    energies : tuple of float
        Energy before and after every round that was kept; it decreases.
    """

    registration: Registration
    fitted: FittedBoundary
    map: OptimizedMap
    energies: tuple[float, ...]


@dataclass(frozen=True)
class SlideReport:
    """What sliding gained.

    Attributes
    ----------
    energies : tuple of float
        Energy before and after every round that was kept; it decreases. Empty where the map was folded to begin with,
        so had no distortion to compare.
    """

    energies: tuple[float, ...]

    @property
    def rounds(self) -> int:
        """How often joints were moved."""
        return max(len(self.energies) - 1, 0)

    def __str__(self) -> str:
        if not self.energies:
            return "joints were not slid: the map has folds, so no distortion to compare"
        first, last = self.energies[0], self.energies[-1]
        return f"joints slid in {self.rounds} rounds: energy {first:.4f} -> {last:.4f}"


def movable_joints(registration: Registration, landmarks: ArrayLike | None) -> list[NDArray[np.bool_]]:
    """Joints that may slide: smooth on both boundaries, not at a landmark or at a side that is the target's own curve.

    Parameters
    ----------
    registration : Registration
    landmarks : (r, 4) array, optional
        The user's landmarks; see `register`.

    Returns
    -------
    list of (n_joints,) bool arrays
        Loop by loop.
    """
    rows = np.empty((0, 4)) if landmarks is None else np.asarray(landmarks, dtype=np.float64).reshape(-1, 4)
    feet = [loop.source.nearest(rows[:, :2]) for loop in registration.loops] if len(rows) else []
    nearest = np.argmin([distance for _, distance in feet], axis=0) if feet else np.empty(0, int)
    movable = []
    for k, loop in enumerate(registration.loops):
        s = loop.source.joints[:-1]
        smooth = (abs(loop.source.turn(s)) < CORNER) & (abs(loop.target.turn(loop.joints[:-1])) < CORNER)
        held = np.array([own is not None for own in loop.own] or [False] * len(s))
        smooth &= ~(held | np.roll(held, 1))
        fixed = feet[k][0][nearest == k] if feet else np.empty(0)
        gap = abs(s[:, None] - fixed)
        gap = np.minimum(gap, loop.source.length - gap).min(axis=1, initial=np.inf)
        movable.append(smooth & (gap > SAME_POINT * loop.source.length))
    return movable


def slide_joints(
    registration: Registration,
    fitted: FittedBoundary,
    start: FloatArray,
    movable: Sequence[NDArray[np.bool_]],
    topology: Topology,
    optimizer: SplineOptimizer,
    refit: Callable[[Registration], FittedBoundary | None],
    with_boundary: Callable[[FittedBoundary], FloatArray],
    tolerance: float,
    budget: Budget | None = None,
) -> Slid | None:
    """Move joints along the target boundary as long as the distortion energy of the map comes down.

    Parameters
    ----------
    registration, fitted
        Correspondence and its boundary fit.
    start : (n_points, 2) array
        Shared control points with that boundary, any interior.
    movable : list of (n_joints,) bool arrays
        See `movable_joints`.
    topology : Topology
        Of the source.
    optimizer : SplineOptimizer
    refit : callable
        Registration to fit; None where the fitted boundary is not feasible.
    with_boundary : callable
        Fit to shared control points with its boundary.
    tolerance : float
        Error that the fit should reach; a move may not give it up.
    budget : Budget, optional
        Moving ends when `SHARE` of it is used up. Default unlimited.

    Returns
    -------
    Slid or None
        Never of higher energy than what came in; None when that is folded, so has no distortion to compare.
    """
    budget = (budget or Budget()).part(SHARE)
    found = optimizer.minimise(optimizer.harmonic(start), seconds=budget.seconds_left())
    budget.spend(len(found.history) * optimizer.step_cost)
    if found.min_determinant <= 0:
        return None
    current = Slid(registration, fitted, found, (found.energy,))
    least = 2 + 2 * AREA_WEIGHT
    allowed = tolerance if fitted.error <= tolerance else FIT_GROWTH * fitted.error
    first = 0
    for _ in range(ROUNDS if any(mask.any() for mask in movable) else 0):
        if current.map.energy - least < NOTHING_TO_GAIN:
            break
        if not budget.steps(optimizer.step_cost, 1):
            break
        step, promised = _model(current, movable, topology, optimizer)
        if promised < IMPROVEMENT * (current.map.energy - least):
            break
        for k in range(first, len(DAMPINGS)):
            max_steps = budget.steps(optimizer.step_cost, MAX_STEPS)
            if not max_steps:
                return current
            shifts, motion = step(DAMPINGS[k])
            moved = _shifted(current.registration, shifts)
            trial = refit(moved)
            if trial is None or trial.error > allowed:
                continue
            points = with_boundary(trial)
            # What the fit adds to the motion, the interior follows harmonically: few Newton steps are left then.
            boundary = topology.boundary_points
            near = current.map.points + motion
            rest = np.zeros_like(points)
            rest[boundary] = points[boundary] - near[boundary]
            near += optimizer.harmonic(rest)
            near[boundary] = points[boundary]
            better = optimizer.minimise(near, max_steps=max_steps, seconds=budget.seconds_left())
            budget.spend(len(better.history) * optimizer.step_cost)
            if better.min_determinant > 0 and better.energy < current.map.energy:
                # Where damping was needed it will be again.
                first = max(k - 1, 0)
                break
        else:
            break
        gain = (current.map.energy - better.energy) / (current.map.energy - least)
        current = Slid(moved, trial, better, (*current.energies, better.energy))
        if gain < IMPROVEMENT:
            break
    return current


def _model(
    current: Slid, movable: Sequence[NDArray[np.bool_]], topology: Topology, optimizer: SplineOptimizer
) -> tuple[Callable[[float], tuple[list[FloatArray], FloatArray]], float]:
    """Quadratic model of the energy in the joints.

    Gives, for a damping, the shift of every joint along the target and the motion of all points to first order; and by
    how much the energy falls at most, as far as the model can tell.
    """
    points = current.map.points
    loops = [
        _motion(loop, fits, sides, topology, points)
        for loop, fits, sides in zip(current.registration.loops, current.fitted.loops, topology.loops, strict=True)
    ]
    modes = _modes(movable)
    _, gradient = optimizer.gradient(points)
    begins: list[FloatArray] = []
    bent = np.zeros((len(modes), len(modes)))
    for k, (index, hats, tangent, curvature) in enumerate(loops):
        weights = [w for loop, w in modes if loop == k]
        if not weights:
            continue
        along = product(hats, np.column_stack(weights))
        # Along a curved boundary a point also moves towards the centre of curvature, to second order.
        block = slice(len(begins), len(begins) + len(weights))
        bent[block, block] = product(along.T * (gradient[index] * curvature).sum(axis=1), along)
        for distance in along.T:
            begin = np.zeros_like(points)
            begin[index] = distance[:, None] * tangent
            begins.append(begin)
    optimizer.linearise(points)
    fields, slope, hessian = optimizer.motions(begins)
    hessian += bent
    values, vectors = eigen(hessian)
    values = abs(values) + 1e-9 * abs(values).max(initial=1e-300)
    longest = [
        LONGEST_STEP * np.minimum(gap, np.roll(gap, 1))
        for gap in (np.diff(loop.joints) for loop in current.registration.loops)
    ]

    def step(damping: float) -> tuple[list[FloatArray], FloatArray]:
        coefficients = -product(vectors, product(vectors.T, slope) / (values + damping * values.mean()))
        shift = [np.zeros(len(mask)) for mask in movable]
        for (k, weights), c in zip(modes, coefficients, strict=True):
            shift[k] += c * weights
        # Scaled as a whole: the direction goes downhill.
        excess = max(1.0, *(float((abs(s) / most).max()) for s, most in zip(shift, longest, strict=True)))
        motion = sum((c / excess * field for c, field in zip(coefficients, fields, strict=True)), np.zeros_like(points))
        return [s / excess for s in shift], motion

    return step, float((product(vectors.T, slope) ** 2 / values).sum() / 2)


def _modes(movable: Sequence[NDArray[np.bool_]]) -> list[tuple[int, FloatArray]]:
    """Loop and joint weights of every mode of motion: single joints, or hats over neighbours if there are many."""
    count = sum(int(mask.sum()) for mask in movable)
    group = -(-count // MODES)
    modes = []
    for k, mask in enumerate(movable):
        at = np.flatnonzero(mask)
        centres = np.arange(0, len(at), max(group, 1))
        for c in centres:
            weights = np.zeros(len(mask))
            weights[at] = np.clip(1 - abs(np.arange(len(at)) - c) / max(group, 1), 0, None)
            modes.append((k, weights))
    return modes


def _motion(
    loop: LoopRegistration,
    fits: Sequence[object],
    sides: Sequence[object],
    topology: Topology,
    points: FloatArray,
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """How the boundary points of a loop move with its joints.

    Returns point indices (m,), weights (m, n_joints), the target's unit tangent and its curvature vector at them.
    """
    n = len(loop.source.curves)
    joints = loop.joints
    index, rows, at = [], [], []
    for i, (curve, side) in enumerate(zip(loop.source.curves, sides, strict=True)):
        # The last point of a side is the first of the next.
        fraction = (loop.to_target(loop.source.arc_length(i, greville(curve.knots, curve.degree)[:-1])) - joints[i]) / (
            joints[i + 1] - joints[i]
        )
        index.append(side.points(topology.points[side.patch])[:-1])  # type: ignore[attr-defined]
        hats = np.zeros((len(fraction), n))
        hats[:, i] += 1 - fraction
        hats[:, (i + 1) % n] += fraction
        rows.append(hats)
        at.append(joints[i] + fraction * (joints[i + 1] - joints[i]))
    s = np.concatenate(at)
    h = 1e-4 * loop.target.length
    before, after = loop.target.tangent(s - h), loop.target.tangent(s + h)
    curvature = (after - before) / (2 * h)
    # A corner is no curvature: the points there do not move.
    curvature[(before * after).sum(axis=1) < np.cos(CORNER)] = 0.0
    return np.concatenate(index), np.concatenate(rows), loop.target.tangent(s), curvature


def _shifted(registration: Registration, shifts: Sequence[FloatArray]) -> Registration:
    """The registration with every joint moved along the target, what lies between in proportion."""
    loops = []
    for loop, shift in zip(registration.loops, shifts, strict=True):
        joints, length = loop.source.joints, loop.source.length
        rows = np.concatenate([loop.anchors[:-1], np.column_stack([joints[:-1], loop.joints[:-1]])])
        turns = np.floor(rows[:, 0] / length)
        rows -= np.outer(turns, [length, loop.target.length])
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        rows = rows[np.diff(rows[:, 0], prepend=-length) > 1e-9 * length]
        # In proportion on the target: on the source another anchor might overtake a joint.
        rows[:, 1] += np.interp(rows[:, 1], loop.joints, np.append(shift, shift[0]))
        anchors = np.concatenate([rows, rows[:1] + np.array([length, loop.target.length])])
        loops.append(replace(loop, anchors=anchors))
    return replace(registration, loops=tuple(loops))
