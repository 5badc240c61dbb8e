"""Stage 2b, boundary fit: one target curve per source boundary side, on the side's degree and knots.

Paper §3.2, Eq. 2–6: least squares with both ends interpolated. The paper takes uniform parameters;
``parameters="uniform"`` and ``parameters="source"`` do that. The default departs from it in three ways:

- samples start with the source's own speed along the side and slide along the target to the foot of their
  perpendicular (orthogonal distance fit by Gauss–Newton; residuals along the tangent are damped, not penalised);
- where the target is smooth at a joint, the end tangents of both curves stay on one line, so no kink is added. The
  line itself is free: holding it at the target's tangent costs up to ten times in accuracy on few control points;
- if a side's error is not well below the tolerance, samples are reweighted (Lawson) to level the largest errors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from .._core import BoundaryFit
from ..errors import InputError
from ..geometry.basis import knot_spans, parts_of_spans
from ..geometry.curve import BSplineCurve
from ..geometry.outline import Outline
from ..geometry.packing import PackedCurves, pack_curves, unpack_curves
from ..geometry.rational import rational_basis
from ..geometry.straight_corners import Triangles, straighten
from ..numeric.arrays import FloatArray, IntArray, frozen_array
from ..registration.register import LoopRegistration, Registration
from .own_curves import distance, with_own

__all__ = ["FREE", "STIFF", "FittedBoundary", "FittedSide", "Stiffness", "basis_key", "fit_boundary", "sampled_basis"]

#: Samples per knot span and at least per side.
SAMPLES_PER_SPAN, MIN_SAMPLES = 14, 24
#: A joint is smooth when the target turns by less there.
SMOOTH_ANGLE = np.radians(2.0)
#: Sliding by this part of the side costs as much as an error of this part of the tolerance: where the shape leaves the
#: parameters free (straight or round sides) the source's speed is kept, and control points do not crowd.
SLIDE, SLIDE_ERROR = 0.1, 0.1
#: Steps before tangents are joined, and steps at most before levelling.
FREE_STEPS, STEPS = 3, 20
#: Sides whose errors all change by less than this part of the tolerance in a step have settled.
STILL = 0.01
#: Part of the tolerance above which errors are levelled.
LEVEL_ABOVE = 0.4
#: Rounds of levelling at most, and how many without improvement end them.
LEVELLING, PATIENCE = 40, 10
#: What counts as an improvement of the error, before levelling and during it.
IMPROVEMENT = (0.1, 0.01)
#: Backing up costs this many times what an error of the same length costs.
BACKING_UP = 100.0
#: What the errors of a chain's other sides count for beside its largest: so little that they only break ties.
OTHER_SIDES = 0.1
#: Say in a joint's tangent that a side without error keeps; the worst side has as much more as its error is larger.
LEAST_SAY = 0.1
#: Where tangents are taken beside a joint, in parts of the loop: off the joint for any rounding.
BESIDE = 1e-9
#: A tangent turns by at most this angle in one step.
MAX_TURN = 0.1
#: A leg that strays from the target's tangent too far is put on a line nearer to it than the limit by this angle: at
#: the limit itself corners of patches get thin, and the tangent is too far off where the limit is wide.
TURNED_BACK = float(np.radians(25.0))


#: Where samples of a side may be: with the source's speed and corrected, or fixed.
PARAMETERS = ("speed", "uniform", "source")


class Stiffness(NamedTuple):
    """How near the source's shape, and the target's corners, sides stay.

    Attributes
    ----------
    damping : float
        Weight, beside that of the error, of how far samples slide in one step.
    shortest_leg : float
        Part of its length by proportion that a leg at a smooth joint keeps.
    max_stray : float
        At a corner a leg may stray from the target's tangent by this angle (radians); beyond, it is turned back.
    """

    damping: float
    shortest_leg: float
    max_stray: float


#: The default, and what is left of it for targets that sides cannot follow so. With less errors fall further, but legs
#: get short and turn at corners, and the map suffers (turtle nodding: smallest scaled Jacobian 0.05, not 0.26).
STIFF, FREE = Stiffness(1e-2, 0.3, TURNED_BACK), Stiffness(5e-4, 0.2, np.radians(60.0))


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


@dataclass(frozen=True, eq=False)
class FittedBoundary:
    """Fitted sides, loop by loop in the order of the source's loops.

    Attributes
    ----------
    loops : tuple of tuples of FittedSide
    error : float
        Two-sided Hausdorff distance to the target, relative to the target's diameter.
    warnings : tuple of str
    """

    error: float
    warnings: tuple[str, ...]

    def __init__(self, loops: Iterable[tuple[FittedSide, ...]], error: float, warnings: Iterable[str]) -> None:
        self.__dict__.update(loops=tuple(loops), error=error, warnings=tuple(warnings))

    # Made when asked for: results bring it from other processes, and few are looked at there.
    @cached_property
    def loops(self) -> tuple[tuple[FittedSide, ...], ...]:
        """The sides of every loop."""
        return tuple(
            tuple([FittedSide(curve, *rest) for curve, rest in zip(unpack_curves(curves), others, strict=True)])
            for curves, others in self._packed
        )

    def with_curves(self, curves: Sequence[Sequence[BSplineCurve]]) -> FittedBoundary:
        """The same fit by other curves of the same shape: with more knots."""
        pairs = zip(self.loops, curves, strict=True)
        loops = [
            tuple(replace(side, curve=curve) for side, curve in zip(loop, along, strict=True)) for loop, along in pairs
        ]
        return FittedBoundary(loops, self.error, self.warnings)

    @cached_property
    def _packed(self) -> list[tuple[PackedCurves, list[tuple[float, bool]]]]:
        return [
            (pack_curves([side.curve for side in loop]), [(side.error, side.smooth) for side in loop])
            for loop in self.loops
        ]

    def __reduce__(self) -> tuple[Callable[..., FittedBoundary], tuple[object, ...]]:
        return _unpacked, (self._packed, self.error, self.warnings)


def _unpacked(packed: object, error: float, warnings: tuple[str, ...]) -> FittedBoundary:
    fitted = object.__new__(FittedBoundary)
    fitted.__dict__.update(_packed=packed, error=error, warnings=warnings)
    return fitted


def fit_boundary(
    registration: Registration,
    single_patch: Sequence[Sequence[bool]] | None = None,
    *,
    parameters: str = "speed",
    tolerance: float = 1e-3,
    stiffness: Stiffness = STIFF,
) -> FittedBoundary:
    """Fit every source boundary side to its part of the target.

    Parameters
    ----------
    registration : Registration
        Gives the sides (degree, knots, speed) and the corresponding part of the target.
    parameters : {"speed", "uniform", "source"}, default "speed"
        Where the samples are: with the source's speed and corrected; or at uniform parameters and fixed, as in the
        paper (no tangents kept there), "uniform" at equal distances on the target, "source" where the source's points
        at these parameters have their images: what fits the source then is the source itself.
    tolerance : float, default 1e-3
        Error relative to the target's diameter that a side should reach; larger ones are reported.
    stiffness : Stiffness, default STIFF
        With the default sides stay near the source's shape; with less (`FREE`) they come closer to the target, at the
        cost of shorter legs.

    Returns
    -------
    FittedBoundary
    """
    if parameters not in PARAMETERS:
        raise InputError(f'parameters must be "source", "speed" or "uniform", got {parameters!r}')
    fixed = parameters != "speed"
    diameter = registration.loops[0].target.diameter
    bases = _Bases()
    joints = [loop.joints for loop in registration.loops]
    turns = [loop.target.turn(x[:-1]) for loop, x in zip(registration.loops, joints, strict=True)]
    smooth = [np.abs(turn) < SMOOTH_ANGLE for turn in turns]
    single = [np.zeros(len(turn), bool) for turn in turns] if single_patch is None else single_patch
    sides = [
        _sides(bases, loop, x, parameters == "uniform", turn, np.asarray(flags))
        for loop, x, turn, flags in zip(registration.loops, joints, turns, single, strict=True)
    ]
    pairs = _smooth_joints(smooth, registration.loops)
    counts = [len(curve.control_points) for loop in registration.loops for curve in loop.source.curves]
    fit = BoundaryFit(
        [loop.target.core for loop in registration.loops],
        bases.values,
        sides,
        pairs,
        (SLIDE_ERROR * tolerance * diameter / SLIDE, stiffness.damping, stiffness.shortest_leg),
    )
    if fixed:
        points, errors = fit.control_points(), fit.errors(True)
    else:
        points, errors = _iterate(fit, counts, pairs, tolerance * diameter, stiffness.max_stray)
    points, errors = with_own(registration.loops, counts, points, errors)
    points, _ = straighten(points, _single_corners(counts, single))
    return _collect(registration, points, errors / diameter, smooth, fixed, tolerance, diameter)


def _single_corners(counts: Sequence[int], single: Sequence[Sequence[bool] | NDArray[np.bool_]]) -> Triangles:
    """Triangles of a joint and its two legs where one patch fills the corner; points are numbered side by side."""
    first = np.cumsum(counts) - counts
    leg = first + np.asarray(counts) - 2
    rows, side = [], 0
    for flags in single:
        these = np.arange(side, side + len(flags))
        rows.append(np.stack([first[these], first[these] + 1, leg[np.roll(these, 1)]], axis=1)[np.asarray(flags, bool)])
        side += len(flags)
    corners = np.concatenate(rows)
    return Triangles(corners, np.ones(len(corners), np.int64))


def _collect(
    registration: Registration,
    points: FloatArray,
    errors: FloatArray,
    smooth: Sequence[NDArray[np.bool_]],
    fixed: bool,
    tolerance: float,
    diameter: float,
) -> FittedBoundary:
    """Curves and their errors, loop by loop, with warnings on those above the tolerance."""
    loops, warnings, distances = [], [], []
    points = frozen_array(points, "fitted control points")
    at, side = 0, 0
    for k, loop in enumerate(registration.loops):
        fitted = []
        for i, curve in enumerate(loop.source.curves):
            n, error = len(curve.control_points), float(errors[side])
            image = BSplineCurve._trusted(curve.knots, curve.degree, points[at : at + n], curve.weights)
            fitted.append(FittedSide(image, error, bool(smooth[k][i] and not fixed)))
            at, side = at + n, side + 1
            if error > tolerance:
                warnings.append(
                    f"boundary loop {k}, side {i}: the source's knots miss the target by {error:.1e} of its diameter "
                    f"(tolerance {tolerance:.1e}); refine the source"
                )
        loops.append(tuple(fitted))
        distances.append(distance([side.curve for side in fitted], loop) / diameter)
        if distances[-1] > tolerance >= max(side.error for side in fitted):
            # Samples may all lie on the target while the curve cuts a part of it short.
            warnings.append(
                f"boundary loop {k}: the source's knots miss a part of the target by {distances[-1]:.1e} of its "
                f"diameter (tolerance {tolerance:.1e}); refine the source"
            )
    return FittedBoundary(loops, max(distances), warnings)


class _Bases:
    """Basis functions at the samples, once for all sides of the same degree and knots."""

    def __init__(self) -> None:
        self.values: list[FloatArray] = []
        self._known: dict[tuple[int, bytes, bytes | None], tuple[int, FloatArray]] = {}

    def of(self, curve: BSplineCurve) -> tuple[int, FloatArray]:
        """Index of the basis and the samples' parameters."""
        key = basis_key(curve)
        if key not in self._known:
            t, values = sampled_basis(*key)
            self._known[key] = len(self.values), t
            self.values.append(values)
        return self._known[key]


def basis_key(curve: BSplineCurve) -> tuple[int, bytes, bytes | None]:
    """What tells a side's basis: degree, knots and weights."""
    return curve.degree, curve.knots.tobytes(), None if curve.weights is None else curve.weights.tobytes()


@lru_cache(maxsize=256)
def sampled_basis(degree: int, knot_bytes: bytes, weight_bytes: bytes | None) -> tuple[FloatArray, FloatArray]:
    """Parameters of a side's samples, and its basis functions there, for knots (and weights, if any) as bytes."""
    knots = np.frombuffer(knot_bytes)
    per_span = max(SAMPLES_PER_SPAN, -(-MIN_SAMPLES // (len(knot_spans(knots)) - 1)))
    t = parts_of_spans(knots, per_span)
    # Weights stay: the rational basis functions are what control points are coefficients of.
    weights = None if weight_bytes is None else np.frombuffer(weight_bytes)
    return t, rational_basis(knots, degree, weights, t, 0)[0]


class _SourceSides(NamedTuple):
    """What the fit needs of a source loop: arc lengths at all samples, and the lengths (n, 2) of the end legs."""

    samples: FloatArray
    legs: FloatArray


#: Of outlines that are alive: a plan's are, and ask for the same with every target.
_source_sides: WeakKeyDictionary[Outline, _SourceSides] = WeakKeyDictionary()


def _of_source(outline: Outline, parameters: Sequence[FloatArray]) -> _SourceSides:
    if outline not in _source_sides:
        points = [curve.control_points for curve in outline.curves]
        ends = np.array([c[[1, -2]] - c[[0, -1]] for c in points])
        samples = [outline.arc_length(i, t) for i, t in enumerate(parameters)]
        _source_sides[outline] = _SourceSides(np.concatenate(samples), np.linalg.norm(ends, axis=2))
    return _source_sides[outline]


def _sides(
    bases: _Bases,
    loop: LoopRegistration,
    joints: FloatArray,
    uniform: bool,
    turn: FloatArray,
    single: NDArray[np.bool_],
) -> tuple[list[int], FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Bases of a loop's sides, arc lengths of the samples, joints, tangents, leg lengths and angles to stray by."""
    source, target = loop.source, loop.target
    index, parameters = zip(*(bases.of(curve) for curve in source.curves), strict=True)
    known = _of_source(source, parameters)
    if uniform:
        ends = zip(joints[:-1], joints[1:], parameters, strict=True)
        lengths = np.concatenate([np.linspace(a, b, len(t)) for a, b, t in ends])
    else:
        lengths = loop.to_target(known.samples)
    near = BESIDE * target.length
    leaving, arriving = target.tangent(joints[:-1] + near), target.tangent(joints[1:] - near, True)
    straight = single & (turn < SMOOTH_ANGLE)
    if straight.any():
        # Where legs have no line of their own (see `_smooth_joints`): one tangent for both sides.
        mean = leaving[straight] + np.roll(arriving, 1, axis=0)[straight]
        leaving[straight] = mean / np.linalg.norm(mean, axis=1, keepdims=True)
        arriving[np.roll(straight, -1)] = leaving[straight]
    scale = np.diff(joints) / np.diff(source.joints)
    # The joint's point is evaluated at one and the same arc length for both curves that meet there.
    points = target.point(joints[:-1])
    tangents = np.concatenate([leaving, arriving], axis=1)
    # Half of what one patch's corner is short of 180 degrees is left if each leg takes a quarter.
    stray = np.where(straight, 0.0, np.where(single, turn / 4, np.inf))
    stray = np.column_stack([stray, np.roll(stray, -1)])
    return list(index), lengths, np.ascontiguousarray(points), tangents, scale[:, None] * known.legs, stray


def _smooth_joints(smooth: Sequence[NDArray[np.bool_]], loops: Sequence[LoopRegistration]) -> list[tuple[int, int]]:
    """Sides (before, after) at every smooth joint whose legs shall lie on one line, in the order of the loops."""
    pairs, first = [], 0
    for flags, loop in zip(smooth, loops, strict=True):
        # A curve of one inner control point has no leg of its own at either end.
        free = [len(curve.control_points) > 3 for curve in loop.source.curves]
        pairs += [
            (first + (j - 1) % len(flags), first + j)
            for j, there in enumerate(flags.tolist())
            if there and free[j - 1] and free[j]
        ]
        first += len(flags)
    return pairs


class _Chains(NamedTuple):
    """Sides linked by smooth joints: they depend on one another, others do not."""

    of: IntArray
    order: IntArray
    starts: IntArray
    sizes: IntArray

    @classmethod
    def of_sides(cls, n: int, pairs: Sequence[tuple[int, int]]) -> _Chains:
        first = np.ones(n, dtype=bool)
        first[[after for before, after in pairs if before < after]] = False
        chain = np.cumsum(first) - 1
        for before, after in pairs:
            if before >= after:
                # The loop closes smoothly: its first chain goes on from its last.
                chain[chain == chain[after]] = chain[before]
        return cls.numbered(np.unique(chain, return_inverse=True)[1])

    @classmethod
    def numbered(cls, chain: IntArray) -> _Chains:
        sizes = np.bincount(chain)
        return cls(chain, np.argsort(chain, kind="stable"), np.cumsum(sizes) - sizes, sizes)

    def score(self, error: FloatArray, backwards: FloatArray) -> FloatArray:
        """What counts of every chain: the largest error, then the others.

        Loops are worse than any error: they rule out an injective map.
        """
        error, starts = error[self.order], self.starts
        largest = np.maximum.reduceat(error, starts) + OTHER_SIDES * np.add.reduceat(error, starts) / self.sizes
        return np.asarray(largest + BACKING_UP * np.maximum.reduceat(backwards[self.order], starts))


def _iterate(
    fit: BoundaryFit, counts: Sequence[int], pairs: Sequence[tuple[int, int]], tolerance: float, max_stray: float
) -> tuple[FloatArray, FloatArray]:
    """Gauss–Newton steps on control points, feet and tangents together, then levelling of the largest errors.

    Returns the control points of all sides and their errors: those of the best step, or with levelling of every
    chain's own best step (tangents are shared in a chain).
    """
    points, error = fit.control_points(), fit.errors(True)
    found, back = error, np.full(len(error), np.inf)
    chains = _Chains.numbered(np.zeros(len(error), dtype=np.int64))
    best, best_step = np.array([np.inf]), np.array([0])
    levelling = False
    for step in range(STEPS + LEVELLING):
        fit.linearise(levelling)
        if step == FREE_STEPS:
            fit.align()
        elif step > FREE_STEPS:
            # Sides with large errors have more of a say.
            fit.turn((LEAST_SAY + error / max(float(error.max()), 1e-300)) ** 2, MAX_TURN)
        fit.solve()
        if step < FREE_STEPS:
            continue
        fit.hold_ends(max_stray, TURNED_BACK)
        last, error, backwards = error, fit.errors(False), fit.backwards()
        score = chains.score(error, backwards)
        best_step[score < (1 - IMPROVEMENT[levelling]) * best] = step
        better = score < best
        if better.all():
            points, found, back, best = fit.control_points(), error, backwards, score
        elif better.any():
            taken = better[chains.of]
            points = np.where(np.repeat(taken, counts)[:, None], fit.control_points(), points)
            found, back = np.where(taken, error, found), np.where(taken, backwards, back)
            best = np.minimum(score, best)
        worst = float(error.max())
        if levelling:
            if ((best <= LEVEL_ABOVE * tolerance) | (step - best_step > PATIENCE)).all():
                break
        # A tolerance that is missed is worth all steps while any side still comes closer, not only the worst.
        elif step >= STEPS or (
            step - best_step[0] >= 2 and (worst <= tolerance or float(np.abs(error - last).max()) <= STILL * tolerance)
        ):
            if worst <= LEVEL_ABOVE * tolerance:
                break
            levelling, chains = True, _Chains.of_sides(len(error), pairs)
            best = chains.score(found, back)
            best_step = np.full(len(best), step)
    return points, found
