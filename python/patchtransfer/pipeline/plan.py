"""The driver: source multi-patch + target boundary -> the same patches on the target, with a proof.

Reads like the pipeline: register, fit, check feasibility, map, optimise, certify, measure. Each stage is a module
of its own that takes and returns plain values.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..continuity.g1 import check_g1_space
from ..errors import InfeasibleTargetError, InputError
from ..fitting.fit import FREE, SMOOTH_ANGLE, FittedBoundary, fit_boundary
from ..fitting.refinement import Knot, insert_in_strips, missed_spans, span_middles
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.multipatch import MultiPatch
from ..geometry.outline import Outline
from ..geometry.patch import Patch
from ..geometry.sides import CORNERS
from ..geometry.straight_corners import corner_triangles, straighten
from ..interior.solver import CONTINUITY, InteriorSolver
from ..measure.continuity import check_continuity
from ..measure.quality import quality
from ..numeric.arrays import FloatArray
from ..progress import Budget, Clock, Progress
from ..proof.certificate import BoundaryReport, Certificate, check_boundary
from ..proof.feasibility import check_corners, check_loops, check_report, check_target_corners
from ..proof.source_corners import certify_straight
from ..registration.register import Registration, register
from .failures import FITTED, TARGET, no_fit, no_proof, not_certified
from .options import check_fit_tolerance, check_options, check_time_limit
from .result import NotCertifiedError, TransferResult
from .sliding import Slid, movable_joints, slide_joints
from .tasks import TransferTask, in_order

__all__ = ["Refilled", "TransferPlan", "transfer"]

#: Rounds of knot insertion at most to reach the fit tolerance; each halves the spans that miss it.
REFINEMENTS = 6
#: A fit that misses the target by more than so many tolerances is tried once more.
MISSED = 2.0
#: Part of the work for a source as it is, and for the refined one, where both are tried.
HALF = 0.5


def transfer(
    source: MultiPatch,
    target: Boundary,
    landmarks: ArrayLike | None = None,
    continuity: str = "c1",
    method: str = "certified",
    progress: Progress | None = None,
    *,
    refine: str = "never",
    fit_tolerance: float = 1e-3,
    fixed_correspondence: bool | None = None,
    on_failure: str = "raise",
    time_limit: float | None = None,
) -> TransferResult:
    """Transfer a multi-patch parameterization to a target boundary.

    Parameters
    ----------
    source : MultiPatch
        Polynomial patches, injective, connected.
    target : Boundary
        Closed loops in any order, sense, start, segmentation and degree; as many as the source has.
    landmarks : (r, 4) array, optional
        Rows (xs, ys, xt, yt) of corresponding boundary points; see `register`.
    continuity : {"c0", "c1", "g1"}, default "c1"
        Continuity across patches: "c1" keeps C1 rows along interfaces, with the ratio of speeds that the C0 solution
        has, and vertex rows at extraordinary vertices (paper Eq. 10-12). "g1" is exact along whole interfaces
        (analysis-suitable gluing) and needs splines with enough freedom: degree 3 or more, inner knots of C^(p - 2),
        two spans where the degree is 3 (`MultiPatch.elevate`, `split_spans`, `reduce_continuity`). See
        ``docs/continuity.md``.
    method : {"certified", "paper"}, default "certified"
        "certified" optimises the spline itself and proves the result. "paper" follows Xu, Xiao, Xu, Gu, CMES
        137(2), 2023: uniform fit, harmonic map on a triangulated control net, fold-over removal by bounded
        distortion, distortion descent; its result is certified as well, but nothing forces it to be injective.
    progress : callable, optional
        Called as ``progress(stage, step, energy, smallest_determinant)``.
    refine : {"never", "auto"}, default "never"
        "auto" inserts knots into the source, in whole strips of patches, where its boundary misses the target by
        more than `fit_tolerance`, and refines it uniformly once if no certified map is found.
    fit_tolerance : float, default 1e-3
        Boundary error, relative to the target's diameter, that the fit should reach.
    fixed_correspondence : bool, optional
        False lets boundary joints that are neither corners nor landmarks slide along the target to lower the
        distortion (see `slide_joints`; method "certified" only). Default True with landmarks, False without.
    on_failure : {"raise", "return"}, default "raise"
        What to do when no certified map is found: raise `NotCertifiedError` (the best map is its ``result``) or
        return the result with ``certificate.injective == False``.
    time_limit : float, optional
        Seconds, counted from when the source is prepared, after which searches end with the best map so far; a warning
        says so. They look at the clock between steps. A result that was cut may differ from run to run, others do not
        depend on the limit. Default none: a budget of Newton steps ends what has no hope
        (``docs/stages/optimisation.md``).

    Returns
    -------
    TransferResult

    Raises
    ------
    InputError
        On a folded, rational or disconnected source, bad landmarks or options.
    InfeasibleTargetError
        When no injective parameterization with this topology exists on the target.
    NotCertifiedError
        See `on_failure`.
    """
    plan = TransferPlan(source, continuity)
    return plan.transfer(
        target,
        landmarks,
        method=method,
        progress=progress,
        refine=refine,
        fit_tolerance=fit_tolerance,
        fixed_correspondence=fixed_correspondence,
        on_failure=on_failure,
        time_limit=time_limit,
    )


class TransferPlan:
    """All source-only work of a transfer, done once for many targets.

    Parameters
    ----------
    source : MultiPatch
    continuity : {"c0", "c1", "g1"}, default "c1"
    reference : sequence of Patch, optional
        Maps that distortion is measured against, one a patch on the same knots; default the source's own patches.

    Raises
    ------
    InputError
        On a source that cannot be transferred: folded (naming the patch), rational, disconnected, or without the
        freedom that "g1" needs.
    """

    def __init__(self, source: MultiPatch, continuity: str = "c1", *, reference: Sequence[Patch] | None = None) -> None:
        if not isinstance(source, MultiPatch):
            raise InputError(f"source must be a MultiPatch (see read), got {type(source).__name__}")
        if continuity not in CONTINUITY:
            raise InputError(f"continuity must be one of {', '.join(CONTINUITY)}, got {continuity!r}")
        if source.is_rational:
            rational = [k for k, patch in enumerate(source.patches) if patch.weights is not None]
            raise InputError(
                f"patch {rational[0]} of the source is rational (NURBS); transfer needs polynomial B-splines: "
                "approximate the source by B-splines first"
            )
        if continuity == "g1":
            check_g1_space(source)
        self.source = source
        self.continuity = continuity
        self.reference = reference
        topology = source.topology
        if topology.n_components != 1:
            raise InputError(
                f"the source has {topology.n_components} separate parts (are interfaces missing?); transfer them one "
                "by one"
            )
        self._welded, certificate, self._notes = certify_straight(source.with_shared_points(topology.coordinates))
        if self._notes:
            self.source = source = self._welded
            topology = source.topology
        if not certificate.injective:
            raise InputError(f"the source is not an injective parameterization: {'; '.join(certificate.reasons)}")
        self._loops = self._welded.boundary().loops
        self._outlines = [Outline(loop) for loop in self._loops]
        valence = {vertex.point: vertex.valence for vertex in topology.vertices}
        of_sides = [[side.points(topology.points[side.patch]) for side in loop] for loop in topology.loops]
        self._single = [[valence[int(points[0])] == 1 for points in loop] for loop in of_sides]
        self._side_points = np.concatenate([points for loop in of_sides for points in loop])
        self._interior = InteriorSolver(source, continuity, reference)

    def transfer(
        self,
        target: Boundary,
        landmarks: ArrayLike | None = None,
        *,
        method: str = "certified",
        progress: Progress | None = None,
        refine: str = "never",
        fit_tolerance: float = 1e-3,
        fixed_correspondence: bool | None = None,
        on_failure: str = "raise",
        time_limit: float | None = None,
    ) -> TransferResult:
        """Transfer to one target; parameters as in `patchtransfer.transfer`."""
        if not isinstance(target, Boundary):
            raise InputError(f"target must be a Boundary (see read_boundary), got {type(target).__name__}")
        check_options(method=method, refine=refine, on_failure=on_failure)
        check_fit_tolerance(fit_tolerance)
        check_time_limit(time_limit)
        if fixed_correspondence is None:
            fixed_correspondence = landmarks is not None or method == "paper"
        elif not fixed_correspondence and method == "paper":
            raise InputError('joints slide with method="certified" only; leave fixed_correspondence out')
        clock, budget = Clock(), Budget.of_source(self._interior.step_cost, time_limit)
        registration = self._register(target, landmarks, method, clock)
        movable = None if fixed_correspondence else movable_joints(registration, landmarks)
        plan, fitted = self, self._fit(registration, method, fit_tolerance, clock)
        notes = list(self._notes)
        if refine == "auto":
            plan, registration, fitted, refined = self._refined_to_tolerance(
                registration, fitted, method, fit_tolerance, clock, budget
            )
            notes += refined
            budget = budget.part(HALF)
        result = plan._attempt(registration, fitted, movable, method, progress, fit_tolerance, clock, budget)
        if refine == "auto" and not result.certificate.injective and not budget.expired():
            plan, registration = plan._refined(span_middles(plan.source.patches), registration)
            fitted = plan._fit(registration, method, fit_tolerance, clock)
            finer = plan._attempt(registration, fitted, movable, method, progress, fit_tolerance, clock, budget)
            if finer.certificate.injective:
                result, note = finer, "the source was refined uniformly: one knot in every span of every patch"
            else:
                note = "a uniform refinement of the source was tried: no certified map was found"
            notes.append(note)
        result = result.with_warnings(notes)
        if on_failure == "raise" and not result.certificate.injective:
            raise NotCertifiedError(not_certified(result), result)
        return result

    def map(
        self,
        targets: Iterable[Boundary | tuple[Boundary, ArrayLike]],
        executor: Executor | None = None,
        **options: object,
    ) -> Iterator[TransferResult]:
        """Transfer to many targets, lazily and in order.

        Parameters
        ----------
        targets : iterable of Boundary, or of pairs (Boundary, landmarks)
        executor : concurrent.futures.Executor, optional
            Runs the targets in parallel; None (the default) one after the other, with threads inside the core. A
            process pool works on every target with one thread; small models gain from processes, for much of their
            time is Python's. Of a small source several targets go to a worker at once.
        **options
            As in `transfer`; a ``time_limit`` is for every target by itself.

        Raises
        ------
        TransferError
            As `transfer` does, when the target's turn comes; the message begins with its place, as in "targets[3]: ".
        """
        task, numbered = TransferTask(self.transfer, options), enumerate(targets)
        if executor is None:
            return map(task, numbered)
        return in_order(task, list(numbered), executor, self.source.topology.n_points)

    def refill(self, points: ArrayLike, progress: Progress | None = None) -> Refilled:
        """Parameterize a boundary that is given on the source's own sides: no registration, no fit.

        Parameters
        ----------
        points : (n_points, 2) array
            Shared control points with the new boundary; interior points do not matter.
        progress : callable, optional
            As in `transfer`.

        Returns
        -------
        Refilled
            Its certificate says whether a map was found.

        Raises
        ------
        InputError
            On another shape or NaN.
        InfeasibleTargetError
            When the boundary crosses itself, or a single patch would have to fill more than 180 degrees.
        """
        start = np.asarray(points, float)
        topology = self.source.topology
        if start.shape != (topology.n_points, 2) or not np.isfinite(start).all():
            raise InputError(f"refill: expected finite points of shape {(topology.n_points, 2)}, got {start.shape}")
        curves = self._boundary(start)
        known = check_boundary(curves)
        check_report(known, "boundary")
        corners = check_corners(curves, self._single, "boundary")
        degenerate = [self._corner_of(c.loop, c.joint) for c in corners if c.kind == "degenerate"]
        start, _ = straighten(start, corner_triangles(topology, degenerate))
        budget = Budget.of_source(self._interior.step_cost)
        report = check_boundary(self._boundary(start), known)
        if report.simple:
            found = self._interior.certified(start, degenerate, progress, Clock(), budget, report)
        else:
            failure = no_proof(report)
            found = self._interior.unproved(start, degenerate, progress, Clock(), budget, failure, report)
        return Refilled(self.source.with_shared_points(found.points), found.certificate, tuple(found.log))

    def _register(self, target: Boundary, landmarks: ArrayLike | None, method: str, clock: Clock) -> Registration:
        """Correspondence of the boundaries, on a target that allows an injective map."""
        with clock("feasibility"):
            # Before what depends on a correspondence is blamed on landmarks. As given, so that messages name the user's
            # own loops, curves and parameters. Registration itself refuses another number of loops.
            same = len(target.loops) == len(self._loops)
            notes = check_loops(target.loops, TARGET) if same else []
        with clock("registration"):
            registration = register(self._outlines, target, landmarks, marked_curves=method == "paper")
        with clock("feasibility"):
            images = [loop.joints[:-1] for loop in registration.loops]
            check_target_corners(
                [loop.target.point(s) for loop, s in zip(registration.loops, images, strict=True)],
                [loop.target.turn(s) for loop, s in zip(registration.loops, images, strict=True)],
                self._single,
                SMOOTH_ANGLE,
            )
        return replace(registration, warnings=(*registration.warnings, *notes))

    def _fit(self, registration: Registration, method: str, tolerance: float, clock: Clock) -> FittedBoundary:
        """The fit, made more freely where it misses the target by far."""
        with clock("fitting"):
            if method == "paper":
                return fit_boundary(registration, parameters="uniform", tolerance=tolerance)
            fitted = fit_boundary(registration, self._single, tolerance=tolerance)
            if fitted.error <= MISSED * tolerance:
                return fitted
            free = fit_boundary(registration, self._single, tolerance=tolerance, stiffness=FREE)
        with clock("feasibility"):
            return free if free.error < fitted.error and self._check_fit(free)[2] is None else fitted

    def _refined_to_tolerance(
        self,
        registration: Registration,
        fitted: FittedBoundary,
        method: str,
        tolerance: float,
        clock: Clock,
        budget: Budget,
    ) -> tuple[TransferPlan, Registration, FittedBoundary, list[str]]:
        """Insert knots where the fit misses the target, until it reaches the tolerance."""
        plan, count = self, 0
        for _ in range(REFINEMENTS):
            if fitted.error <= tolerance or budget.expired():
                break
            with clock("refinement"):
                knots = missed_spans(registration, fitted, plan.source.topology.loops, tolerance)
                plan, registration = plan._refined(knots, registration)
            count += len(knots)
            fitted = plan._fit(registration, method, tolerance, clock)
        if plan is self:
            return plan, registration, fitted, []
        before, after = self.source.topology.n_points, plan.source.topology.n_points
        note = (
            f"the source was refined: knots in {count} boundary spans and the strips of patches behind them, "
            f"{before} -> {after} control points"
        )
        return plan, registration, fitted, [note]

    def _refined(self, knots: Sequence[Knot], registration: Registration) -> tuple[TransferPlan, Registration]:
        """A plan for the source with more knots, and the same correspondence with its boundary curves."""
        topology = self._welded.topology
        # Exact G1 needs inner knots of C^(p - 2): simple ones would lock its rows.
        multiplicity = 2 if self.continuity == "g1" else 1
        patches = insert_in_strips(topology, topology.patches, knots, multiplicity)
        reference = self.reference and insert_in_strips(topology, self.reference, knots, multiplicity)
        source = MultiPatch(patches, self.source.interfaces, self.source.ids)
        plan = TransferPlan(source, self.continuity, reference=reference)
        loops = [
            replace(loop, source=Outline(curves)) for loop, curves in zip(registration.loops, plan._loops, strict=True)
        ]
        return plan, replace(registration, loops=tuple(loops))

    def _attempt(
        self,
        registration: Registration,
        fitted: FittedBoundary,
        movable: Sequence[NDArray[np.bool_]] | None,
        method: str,
        progress: Progress | None,
        fit_tolerance: float,
        clock: Clock,
        budget: Budget,
    ) -> TransferResult:
        """From the fitted boundary to the result, with the source's knots."""
        with clock("feasibility"):
            corner_bound, degenerate, failure, known = self._check_fit(fitted)
            if failure is not None:
                failure = no_fit(registration, failure)
            warnings = [
                f"patch {k} is degenerate at its corner {c}: one patch fills a straight angle of the target there"
                for k, c in degenerate
            ]
            start = self._with_boundary(fitted)
        if failure is not None:
            found = self._interior.harmonic(start, clock, failure, known)
        elif method == "paper":
            found = self._interior.paper(start, clock, budget, known)
        else:
            slides = []
            if movable is not None and any(mask.any() for mask in movable):
                with clock("sliding"):
                    slid = self._slide(registration, fitted, start, movable, degenerate, fit_tolerance, budget)
                if slid is None:
                    slides = ["joints were not slid: the map has folds, so no distortion to compare"]
                else:
                    registration, fitted, start = slid.registration, slid.fitted, slid.map.points
                    slides = [
                        f"joints slid in {len(slid.energies) - 1} rounds: energy {slid.energies[0]:.4f} -> "
                        f"{slid.energies[-1]:.4f}"
                    ]
            report = check_boundary(self._boundary(start), known)
            if report.simple:
                found = self._interior.certified(start, degenerate, progress, clock, budget, report)
            else:
                failure = no_proof(report, registration)
                found = self._interior.unproved(start, degenerate, progress, clock, budget, failure, report)
            found.log[:0] = slides
        warnings += found.notes
        if budget.expired() or found.log[-1:] == [budget.reason()]:
            warnings.append(budget.reason())
        if found.rows is not None:
            warnings += found.rows.warnings(self.source)
        elif found.certificate.injective and budget.expired():
            warnings.append(f'patches are joined C0 only, not "{self.continuity}": no time was left for more')
        elif self.continuity != "c0" and self.source.interfaces:
            warnings.append(
                f'patches are joined C0 only, not "{self.continuity}": there is no injective map to start from'
            )
        with clock("quality"):
            multipatch = self._interior.model(found.points)
            metrics = quality(multipatch, exclude=degenerate)
        with clock("continuity report"):
            continuity = check_continuity(multipatch)
        return TransferResult(
            multipatch=multipatch,
            certificate=found.certificate,
            quality=metrics,
            continuity=continuity,
            rows=found.rows,
            boundary_error=fitted.error,
            registration=registration,
            fitted=fitted,
            corner_bound=corner_bound,
            method=method,
            log=tuple(found.log),
            fit_failed=failure is not None,
            warnings=(*registration.warnings, *fitted.warnings, *warnings),
            timings=clock.seconds,
            paper_history=found.history,
        )

    def _check_fit(self, fitted: FittedBoundary) -> tuple[float, list[tuple[int, int]], str | None, BoundaryReport]:
        """Loops and corners of the fit: upper bound of the scaled Jacobian, degenerate corners, and what is wrong.

        The target passed these checks, so a failure is the fit's: the source's knots are too coarse for it.
        """
        curves = [[side.curve for side in sides] for sides in fitted.loops]
        report = check_boundary(curves)
        try:
            check_report(report, FITTED)
            corners = check_corners(curves, self._single, FITTED)
        except InfeasibleTargetError as error:
            return -1.0, [], f"(fit error {fitted.error:.1e} of the diameter): {error}", report
        degenerate = [self._corner_of(corner.loop, corner.joint) for corner in corners if corner.kind == "degenerate"]
        return min((corner.bound for corner in corners), default=1.0), degenerate, None, report

    def _corner_of(self, loop: int, joint: int) -> tuple[int, int]:
        """(patch, corner) that a joint filled by a single patch belongs to."""
        side = self.source.topology.loops[loop][joint]
        points = self.source.topology.points[side.patch]
        start = side.points(points)[0]
        return side.patch, next(c for c, (i, j) in enumerate(CORNERS) if points[i, j] == start)

    def _boundary(self, points: FloatArray) -> list[list[BSplineCurve]]:
        """The boundary loops of shared control points."""
        topology = self.source.topology
        pairs = zip(topology.patches, topology.points, strict=True)
        patches = [patch.with_control_points(points[p]) for patch, p in pairs]
        return [[side.curve(patches) for side in loop] for loop in topology.loops]

    def _with_boundary(self, fitted: FittedBoundary) -> FloatArray:
        """Shared control points with the fitted boundary and the source's interior."""
        topology = self.source.topology
        points = topology.coordinates.copy()
        points[self._side_points] = np.concatenate(
            [fit.curve.control_points for sides in fitted.loops for fit in sides]
        )
        return points

    def _slide(
        self,
        registration: Registration,
        fitted: FittedBoundary,
        start: FloatArray,
        movable: Sequence[NDArray[np.bool_]],
        degenerate: Sequence[tuple[int, int]],
        tolerance: float,
        budget: Budget,
    ) -> Slid | None:
        """Joints where the distortion is least; None when the map is folded to begin with, so has no distortion."""

        def refit(moved: Registration) -> FittedBoundary | None:
            trial = fit_boundary(moved, self._single, tolerance=tolerance)
            _, corners, failure, _ = self._check_fit(trial)
            return trial if failure is None and corners == list(degenerate) else None

        return slide_joints(
            registration,
            fitted,
            start,
            movable,
            self.source.topology,
            self._interior.optimizer(degenerate),
            refit,
            self._with_boundary,
            tolerance,
            budget,
        )


class Refilled(NamedTuple):
    """Outcome of `TransferPlan.refill`."""

    multipatch: MultiPatch
    certificate: Certificate
    log: tuple[str, ...]
