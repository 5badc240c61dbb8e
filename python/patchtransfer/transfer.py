"""The driver: source multi-patch + target boundary -> the same patches on the target, with a proof.

Reads like the pipeline: register, fit, check feasibility, map, optimise, certify, measure. Each stage is a module
of its own that takes and returns plain values.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csc_array

from .background_mesh import source_mesh
from .bounded_distortion import remove_foldovers
from .certificate import Certificate, certify
from .constrained import ActiveRows, best_under_rows, optimize_under_rows, rows_summary
from .continuity import ContinuityRows, c1_rows
from .continuity_report import check_continuity
from .errors import InfeasibleTargetError, InputError, NotCertifiedError
from .feasibility import check_corners, check_loops, check_target_corners
from .fitting import SMOOTH, FittedBoundary, fit_boundary
from .g1 import check_g1_space, g1_rows
from .gluing import control_rows
from .harmonic import mesh_harmonic_map
from .multipatch import Boundary, MultiPatch
from .null_space import RowSpace, row_space
from .optimize import Progress, SplineOptimizer, degenerate_corners, optimize_with_ladder
from .quality import quality
from .registration import register
from .result import TransferResult
from .splines import FloatArray, Patch
from .topology import CORNERS, Spoke

__all__ = ["TransferPlan", "transfer"]

METHODS = ("certified", "paper")
CONTINUITY = ("c0", "c1", "g1")


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
    on_failure: str = "raise",
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
        distortion; its result is certified as well, but nothing forces it to be injective.
    progress : callable, optional
        Called as ``progress(stage, step, energy, smallest_determinant)``.
    refine : {"never", "auto"}, default "never"
        "auto" allows one uniform refinement of the source when its knots miss the target or no certified map
        is found.
    fit_tolerance : float, default 1e-3
        Boundary error, relative to the target's diameter, that the fit should reach.
    on_failure : {"raise", "return"}, default "raise"
        What to do when no certified map is found: raise `NotCertifiedError` (the best map is its ``result``) or
        return the result with ``certificate.injective == False``.

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
        on_failure=on_failure,
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
        self._welded = source.with_shared_points(topology.coordinates)
        self._control = () if continuity == "c0" else control_rows(topology)
        self._loops = self._welded.boundary().loops
        valence = {vertex.point: vertex.valence for vertex in topology.vertices}
        starts = [[int(side.points(topology.points[side.patch])[0]) for side in loop] for loop in topology.loops]
        self._single = [[valence[point] == 1 for point in loop] for loop in starts]
        self._degenerate = degenerate_corners(source.patches if reference is None else reference)
        certificate = certify(self._welded)
        if not certificate.injective:
            raise InputError(f"the source is not an injective parameterization: {'; '.join(certificate.reasons)}")
        self._thread = threading.local()

    def __getstate__(self) -> dict[str, object]:
        # Optimizers stay behind: they are rebuilt where the plan arrives.
        return {name: value for name, value in self.__dict__.items() if name != "_thread"}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state, _thread=threading.local())

    def transfer(
        self,
        target: Boundary,
        landmarks: ArrayLike | None = None,
        *,
        method: str = "certified",
        progress: Progress | None = None,
        refine: str = "never",
        fit_tolerance: float = 1e-3,
        on_failure: str = "raise",
    ) -> TransferResult:
        """Transfer to one target; parameters as in `patchtransfer.transfer`."""
        for name, value, allowed in (
            ("method", method, METHODS),
            ("refine", refine, ("never", "auto")),
            ("on_failure", on_failure, ("raise", "return")),
        ):
            if value not in allowed:
                raise InputError(f"{name} must be one of {', '.join(allowed)}, got {value!r}")
        if not 0 < fit_tolerance < 1:
            raise InputError(f"fit_tolerance must lie between 0 and 1, got {fit_tolerance!r}")
        result = self._attempt(target, landmarks, method, progress, fit_tolerance)
        good = result.certificate.injective and result.boundary_error <= fit_tolerance
        if refine == "auto" and not good:
            reference = None if self.reference is None else [_halve_spans(patch) for patch in self.reference]
            plan = TransferPlan(refine_uniformly(self._welded), self.continuity, reference=reference)
            finer = plan._attempt(target, landmarks, method, progress, fit_tolerance)
            if finer.certificate.injective or not result.certificate.injective:
                result = finer.with_warning("the source was refined uniformly: one knot in every span of every patch")
            else:
                result = result.with_warning("a uniform refinement of the source was tried: no certified map was found")
        if on_failure == "raise" and not result.certificate.injective:
            raise NotCertifiedError(
                f"no certified map was found ({result.certificate.status}): "
                f"{result.log[-1] if result.fit_failed else '; '.join(result.certificate.reasons[:3])}; try --refine "
                "auto (refine='auto') or more landmarks; --keep-uncertified (on_failure='return') gives the best map",
                result,
            )
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
            Runs the targets in parallel; None (the default) one after the other.
        **options
            As in `transfer`.
        """
        task = _Task(self, options)
        return map(task, targets) if executor is None else executor.map(task, targets)

    def _attempt(
        self,
        target: Boundary,
        landmarks: ArrayLike | None,
        method: str,
        progress: Progress | None,
        fit_tolerance: float,
    ) -> TransferResult:
        """One pass through the pipeline."""
        clock = _Clock()
        paper = method == "paper"
        with clock("registration"):
            registration = register(self._loops, target, landmarks, marked_curves=paper)
        with clock("feasibility"):
            warnings = [*registration.warnings]
            # As given, so that messages name the user's own loops, curves and parameters.
            warnings += check_loops(target.loops, "target boundary")
            images = [loop.joints[:-1] for loop in registration.loops]
            check_target_corners(
                [loop.target.point(s) for loop, s in zip(registration.loops, images, strict=True)],
                [loop.target.turn(s) for loop, s in zip(registration.loops, images, strict=True)],
                self._single,
                SMOOTH,
            )
        with clock("fitting"):
            fitted = fit_boundary(registration, parameters="uniform" if paper else "speed", tolerance=fit_tolerance)
            warnings += fitted.warnings
        with clock("feasibility"):
            corner_bound, degenerate, failure = self._check_fit(fitted)
            warnings += [
                f"patch {k} is degenerate at its corner {c}: one patch fills a straight angle of the target there"
                for k, c in degenerate
            ]
            start = self._with_boundary(fitted)
        rows: ActiveRows | None = None
        if failure is not None:
            # No interior can mend the boundary: show the harmonic map on it.
            points, log = self._optimizer(()).harmonic(start), [failure]
            certificate = self._certify(points, clock)
        elif paper:
            points, certificate, log, notes, rows = self._paper(start, clock)
            warnings += notes
        else:
            points, certificate, log, rows = self._certified(start, degenerate, progress, clock)
        if rows is not None:
            warnings += rows.warnings(self.source)
        elif self.continuity != "c0" and self.source.interfaces:
            warnings.append(
                f'patches are joined C0 only, not "{self.continuity}": there is no injective map to start from'
            )
        with clock("quality"):
            multipatch = self.source.with_shared_points(points)
            metrics = quality(multipatch, exclude=degenerate)
        with clock("continuity report"):
            continuity = check_continuity(multipatch)
        return TransferResult(
            multipatch=multipatch,
            certificate=certificate,
            quality=metrics,
            continuity=continuity,
            rows=rows,
            boundary_error=fitted.error,
            registration=registration,
            fitted=fitted,
            corner_bound=corner_bound,
            method=method,
            log=tuple(log),
            fit_failed=failure is not None,
            warnings=tuple(warnings),
            timings=clock.seconds,
        )

    def _check_fit(self, fitted: FittedBoundary) -> tuple[float, list[tuple[int, int]], str | None]:
        """Loops and corners of the fit: upper bound of the scaled Jacobian, degenerate corners, and what is wrong.

        The target passed these checks, so a failure is the fit's: the source's knots are too coarse for it.
        """
        curves = [[side.curve for side in sides] for sides in fitted.loops]
        try:
            check_loops(curves, "fitted boundary")
            corners = check_corners(curves, self._single, "fitted boundary")
        except InfeasibleTargetError as error:
            failure = (
                f"the target is feasible, but the source's knots cannot represent it (fit error {fitted.error:.1e} of "
                f"the diameter): {error}"
            )
            return -1.0, [], failure
        degenerate = [self._corner_of(corner.loop, corner.joint) for corner in corners if corner.kind == "degenerate"]
        return min((corner.bound for corner in corners), default=1.0), degenerate, None

    def _corner_of(self, loop: int, joint: int) -> tuple[int, int]:
        """(patch, corner) that a joint filled by a single patch belongs to."""
        side = self.source.topology.loops[loop][joint]
        points = self.source.topology.points[side.patch]
        start = side.points(points)[0]
        return side.patch, next(c for c, (i, j) in enumerate(CORNERS) if points[i, j] == start)

    def _with_boundary(self, fitted: FittedBoundary) -> FloatArray:
        """Shared control points with the fitted boundary and the source's interior."""
        topology = self.source.topology
        points = topology.coordinates.copy()
        for loop, sides in zip(topology.loops, fitted.loops, strict=True):
            for side, fit in zip(loop, sides, strict=True):
                points[side.points(topology.points[side.patch])] = fit.curve.control_points
        return points

    def _certify(self, points: FloatArray, clock: _Clock) -> Certificate:
        with clock("certificate"):
            return certify(self.source.with_shared_points(points))

    def _certified(
        self, start: FloatArray, degenerate: Sequence[tuple[int, int]], progress: Progress | None, clock: _Clock
    ) -> tuple[FloatArray, Certificate, list[str], ActiveRows | None]:
        """Spline harmonic map, then distortion optimisation until the certificate accepts the map; then rows."""
        topology = self.source.topology
        make, check = partial(self._optimizer, degenerate), partial(self._certify, clock=clock)
        with clock("optimisation"):
            found, certificate, log = optimize_with_ladder(
                make,
                start,
                check,
                source=topology.coordinates,
                boundary=topology.boundary_points,
                progress=progress,
            )
        points, rows = found.points, None
        for level in self._levels if certificate.injective else ():
            with clock("continuity rows"):
                choices = [
                    partial(self._rows, choice, points) for choice in (level, "g1 linear")[: 1 + (level == "g1")]
                ]
                points, certificate, under, rows = best_under_rows(
                    topology, choices, make, points, check, progress, release=level == "c1"
                )
            log += under
        return points, certificate, log, rows

    @property
    def _levels(self) -> tuple[str, ...]:
        """Exact G1 follows the frames of a map with C1 rows."""
        return CONTINUITY[1 : CONTINUITY.index(self.continuity) + 1]

    def _rows(
        self,
        level: str,
        reference: FloatArray,
        released: Collection[Spoke] = (),
        without: Collection[int] = (),
    ) -> ContinuityRows:
        """Continuity rows that follow the speeds and frames of a reference map."""
        if level.startswith("g1"):
            return g1_rows(self.source.topology, self._control, reference, without, linear=level == "g1 linear")
        return c1_rows(self.source.topology, self._control, reference, released, without)

    def _optimizer(
        self,
        degenerate: Sequence[tuple[int, int]],
        nodes_per_degree: int = 2,
        extra_nodes: Sequence[tuple[int, float, float]] = (),
        null_space: csc_array | None = None,
    ) -> SplineOptimizer:
        """Optimizer on the source; symbolic work is kept, one optimizer a thread because it owns its buffers."""
        excluded = sorted(set(degenerate) | set(self._degenerate))
        cache: dict[object, SplineOptimizer] = self._thread.__dict__.setdefault("optimizers", {})
        key = (nodes_per_degree, tuple(excluded))
        single_use = bool(extra_nodes) or null_space is not None
        if single_use or key not in cache:
            optimizer = SplineOptimizer(
                self.source.topology,
                self.reference,
                nodes_per_degree=nodes_per_degree,
                extra_nodes=extra_nodes,
                excluded_corners=excluded,
                null_space=null_space,
            )
            if single_use:
                return optimizer
            cache[key] = optimizer
        return cache[key]

    def _paper(
        self, start: FloatArray, clock: _Clock
    ) -> tuple[FloatArray, Certificate, list[str], list[str], ActiveRows | None]:
        """Harmonic map on the triangulated control net, then bounded conformal distortion (paper §3.3)."""
        topology = self.source.topology
        with clock("background mesh"):
            mesh, notes = source_mesh(topology)
        boundary, interior = topology.boundary_points, topology.interior_points

        def solve(space: RowSpace | None, near: FloatArray) -> tuple[FloatArray, Certificate, list[str]]:
            basis = None if space is None else space.basis
            particular = None if space is None else space.project(near)[interior]
            with clock("harmonic map"):
                points = mesh_harmonic_map(mesh, boundary, start[boundary], basis, particular)
            with clock("bounded distortion"):
                unfolded = remove_foldovers(mesh, points, boundary, basis)
            log = (
                f"bounded distortion: {unfolded.flips[0]} flipped faces, {unfolded.flips[-1]} after "
                f"{unfolded.iterations} iterations"
            )
            return unfolded.points, self._certify(unfolded.points, clock), [log]

        points, certificate, log = solve(None, start)
        rows: ActiveRows | None = None
        for level in self._levels:
            with clock("continuity rows"):
                if certificate.injective:
                    points, certificate, under, rows = optimize_under_rows(
                        topology,
                        partial(self._rows, level, points),
                        solve,
                        points,
                        partial(self._certify, clock=clock),
                        release=level == "c1",
                    )
                else:
                    # A folded map has no frames to follow: take the source's.
                    space = row_space(self._rows(level, topology.coordinates), interior, start)
                    points, certificate, under = solve(space, start)
                    under = [f"under {len(space.rows)} rows with the source's frames, {entry}" for entry in under]
                    rows = rows_summary(topology, space, points)
            log += under
        return points, certificate, log, list(notes), rows


class _Task:
    """A plan's transfer with its options, picklable for process pools."""

    def __init__(self, plan: TransferPlan, options: dict[str, object]) -> None:
        self.plan, self.options = plan, options

    def __call__(self, target: Boundary | tuple[Boundary, ArrayLike]) -> TransferResult:
        if isinstance(target, Boundary):
            return self.plan.transfer(target, **self.options)  # type: ignore[arg-type]
        return self.plan.transfer(*target, **self.options)  # type: ignore[arg-type]


class _Clock:
    """Seconds per stage; a stage inside another is not counted twice."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._open: list[str] = []

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begin = time.perf_counter()
        self._open.append(stage)
        try:
            yield
        finally:
            self._open.pop()
            spent = time.perf_counter() - begin
            self.seconds[stage] = self.seconds.get(stage, 0.0) + spent
            if self._open:
                outer = self._open[-1]
                self.seconds[outer] = self.seconds.get(outer, 0.0) - spent


def refine_uniformly(source: MultiPatch) -> MultiPatch:
    """The same geometry with one knot inserted in the middle of every span of every patch."""
    return MultiPatch([_halve_spans(patch) for patch in source.patches], source.interfaces, source.ids)


def _halve_spans(patch: Patch) -> Patch:
    for axis in (0, 1):
        breaks = np.unique(patch.knots[axis])
        patch = patch.insert_knots(axis, (breaks[:-1] + breaks[1:]) / 2)
    return patch
