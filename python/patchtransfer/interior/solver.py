"""Stages 4 to 9 together: boundary points -> all control points, by either method, under rows, with a certificate."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from ..continuity.g1 import g1_rows
from ..continuity.interfaces import control_rows
from ..continuity.joint_ratios import LegWish
from ..continuity.null_space import RowSpace, row_space
from ..continuity.rows import C1Rows, ContinuityRows
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.topology import Spoke
from ..measure.quality import quality
from ..numeric.arrays import FloatArray
from ..numeric.compressed import Compressed
from ..progress import Budget, Clock, Progress, reporter
from ..proof.certificate import BoundaryReport, Certificate, certify
from .interior_map import InteriorMap
from .opened import OPENED, with_open_corners
from .optimizer import (
    MAX_STEPS,
    ROUGH,
    Certify,
    OptimizedMap,
    SplineOptimizer,
    degenerate_corners,
    optimize_with_ladder,
    step_cost,
)
from .polish import Goal, polished
from .spoilt import SPOILT, spoilt_vertices
from .under_g1 import with_better_middles
from .under_rows import ROW_ROUNDS, ActiveRows, MakeRows, best_under_rows, optimize_under_rows, rows_summary

if TYPE_CHECKING:
    from ..paper.method import PaperHistory
    from ..paper.options import PaperOptions

__all__ = ["CONTINUITY", "InteriorSolver"]

CONTINUITY = ("c0", "c1", "g1")
#: Diameters from the origin beyond which a target is brought there to be solved.
FAR = 100.0
#: Part of the work for rows, which need most of it; the rest is for finding a map without them.
ROWS_SHARE = 0.65
#: Optimizers under rows that a thread keeps, one a pattern of the null-space basis: of C1, and of exact G1 twice.
KEPT_PATTERNS = 3


class _Kept(threading.local):
    """What every thread has of its own: optimizers, which own their buffers, and the model it asked for last."""

    def __init__(self) -> None:
        self.optimizers: dict[tuple[object, ...], SplineOptimizer] = {}
        self.model: tuple[FloatArray, MultiPatch] | None = None


class InteriorSolver:
    """What depends on the source only: rows, optimizers and their symbolic factorizations.

    Parameters
    ----------
    source : MultiPatch
    continuity : {"c0", "c1", "g1"}
    reference : sequence of Patch, optional
        Maps that distortion is measured against; default the source's own patches.
    ratios : {"target", "source"}, default "target"
        Whether rows follow the speeds and frames of the map that they are for, or those of the source.
    """

    def __init__(
        self, source: MultiPatch, continuity: str, reference: Sequence[Patch] | None = None, ratios: str = "target"
    ) -> None:
        self.source, self.continuity, self.reference, self.ratios = source, continuity, reference, ratios
        self._control = () if continuity == "c0" else control_rows(source.topology)
        # Exact G1 has no use for the legs' ratio: its own may vary along an interface.
        self._c1 = C1Rows(source.topology, self._control, legs=(continuity, ratios) == ("c1", "target"))
        self._linear = frozenset(i for i, r in enumerate(self._control) if r.lowest_degree < 2)
        self._degenerate = degenerate_corners(source.patches if reference is None else reference)
        #: Of a Newton step on the source's own nodes; see `SplineOptimizer`.
        self.step_cost = step_cost(source.patches)
        self._kept = _Kept()

    def __getstate__(self) -> dict[str, object]:
        # Optimizers stay behind: they are rebuilt where the solver arrives.
        return {name: value for name, value in self.__dict__.items() if name != "_kept"}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state, _kept=_Kept())

    @property
    def follows_legs(self) -> bool:
        """Whether there are chords whose ratio is to be that of legs on the boundary."""
        return self._c1.has_joints

    def leg_wishes(self, points: FloatArray, degenerate: Sequence[tuple[int, int]]) -> list[LegWish]:
        """Legs in the ratios of the chords that end at them, whose speeds are those of the harmonic map."""
        return self._c1.leg_wishes(self.optimizer(degenerate).harmonic(points))

    @cached_property
    def _opened(self) -> InteriorSolver | None:
        """The same against the source with its straight corners inside open, if it has some."""
        reference = None if self.reference is not None else with_open_corners(self.source)
        return None if reference is None else InteriorSolver(self.source, self.continuity, reference, self.ratios)

    def certified(
        self,
        start: FloatArray,
        degenerate: Sequence[tuple[int, int]],
        progress: Progress | None,
        clock: Clock,
        budget: Budget,
        boundary: BoundaryReport | None = None,
    ) -> InteriorMap:
        """Spline harmonic map, then distortion optimisation until the certificate accepts the map; then rows.

        Rows only follow speeds and frames of the map without them, so that a rough one is tried first. Where it has
        folds, or its rows cannot all be kept, the map without rows is found as if there were none to follow.

        Near-singular rows enlarge the rounding of coordinates, so a target far from the origin is brought there first;
        the proof is for the points as they are put back. All certificates share `boundary`, the proof of its loops.
        """
        check = partial(self.certify, clock=clock, boundary=boundary)
        near, centre, back = self._near_origin(start)
        found = self._certified(near, degenerate, lambda points: check(back(points)), progress, clock, budget)
        if centre is None:
            return found
        rows = found.rows and found.rows.moved(centre, float(np.linalg.norm(np.ptp(start, axis=0))))
        return replace(found, points=back(found.points), rows=rows)

    def _near_origin(
        self, start: FloatArray
    ) -> tuple[FloatArray, FloatArray | None, Callable[[FloatArray], FloatArray]]:
        """Points near the origin, how far they were brought if they were, and what brings such points back."""
        on = self.source.topology.boundary_points
        fixed = start[on]
        centre, diameter = fixed.mean(axis=0), float(np.linalg.norm(np.ptp(fixed, axis=0)))
        if float(np.linalg.norm(centre)) <= FAR * diameter:
            return start, None, lambda points: points

        def back(points: FloatArray) -> FloatArray:
            there = np.array(points + centre)
            # To the bit: the proof of the loops is theirs.
            there[on] = fixed
            return there

        return start - centre, centre, back

    def polished(
        self,
        found: InteriorMap,
        goal: Goal,
        degenerate: Sequence[tuple[int, int]],
        clock: Clock,
        budget: Budget,
        boundary: BoundaryReport | None = None,
    ) -> InteriorMap:
        """A certified map with a better worst place, under the rows that it satisfies."""
        if goal.reason is not None:
            return replace(found, notes=[*found.notes, f"polish={goal.name!r} is left out: {goal.reason}"])
        rows, space = found.rows, found.rows.space if found.rows is not None else None
        make = partial(
            SplineOptimizer,
            self.source.topology,
            excluded_corners=sorted(degenerate),
            null_space=None if space is None else space.columns,
        )
        near, _, back = self._near_origin(found.points)
        with clock("polish") as stage:
            best, report = polished(
                goal,
                make,
                near,
                lambda points: self.model(back(points)),
                lambda points: self.certify(back(points), clock, boundary),
                budget,
            )
            stage.found = str(report)
        found = replace(found, log=[*found.log, str(report)], polish=report)
        if best is None:
            return found
        if rows is not None and space is not None:
            left = space.residual(best.points) / float(np.linalg.norm(np.ptp(near, axis=0)))
            rows = replace(rows, residual=max(rows.residual, left))
        return replace(found, points=back(best.points), certificate=best.certificate, rows=rows)

    def _certified(
        self,
        start: FloatArray,
        degenerate: Sequence[tuple[int, int]],
        check: Certify,
        progress: Progress | None,
        clock: Clock,
        budget: Budget,
    ) -> InteriorMap:
        topology = self.source.topology
        make = partial(self.optimizer, degenerate)
        log: list[str] = []
        spare: InteriorMap | None = None
        if self._levels:
            with clock("optimisation") as stage:
                optimizer = make()
                rough = optimizer.minimise(
                    optimizer.harmonic(start),
                    max_steps=budget.first_steps(optimizer.step_cost, MAX_STEPS),
                    progress=reporter(progress, "optimise"),
                    tolerance=ROUGH,
                    seconds=budget.seconds_left(),
                )
                stage.found = _figures(rough)
            log.append(f"rough map for the rows to follow: smallest determinant {rough.min_determinant:.3g}")
            if budget.expired():
                return InteriorMap(rough.points, check(rough.points), log, [])
            if rough.min_determinant > 0:
                part = budget.part(ROWS_SHARE)
                under, complete = self._under_rows(rough.points, degenerate, check, progress, clock, part, rounds=1)
                log += under.log
                # Rows that are not complete leave the rough map as it was, or one that is certified.
                if complete or budget.expired():
                    return replace(under, log=log)
                spare = under if under.rows is not None and under.rows.collapsed else None
        with clock("optimisation") as stage:
            found, certificate, entries = optimize_with_ladder(
                make,
                start,
                check,
                source=topology.coordinates,
                boundary=topology.boundary_points,
                progress=progress,
                budget=budget.part(1 - ROWS_SHARE if self._levels else 1),
            )
            stage.found = _figures(found)
        log += entries
        if not (certificate.injective or budget.expired()) and self._opened is not None:
            opened = self._opened._certified(start, degenerate, check, progress, clock, budget)
            if opened.certificate.injective:
                return replace(opened, log=[*log, OPENED, *opened.log])
        if spare is not None and not certificate.injective:
            return replace(spare, log=[*log, "the certified map under rows is kept, though its corners collapse"])
        if not (self._levels and certificate.injective) or budget.expired():
            return InteriorMap(found.points, certificate, log, [])
        under, _ = self._under_rows(found.points, degenerate, check, progress, clock, budget.part(ROWS_SHARE))
        return replace(under, log=log + under.log)

    def _under_rows(
        self,
        points: FloatArray,
        degenerate: Sequence[tuple[int, int]],
        check: Certify,
        progress: Progress | None,
        clock: Clock,
        budget: Budget,
        rounds: int = ROW_ROUNDS,
    ) -> tuple[InteriorMap, bool]:
        """Rows that follow a map without them: C1 first, then exact G1 that follows the C1 map.

        Also whether it is certified with rows on all interfaces that can have any: of no use otherwise after one round.
        """
        log: list[str] = []
        make, complete = partial(self.optimizer, degenerate), True
        for level in self._levels:
            with clock("continuity rows") as stage:
                choices = [
                    partial(self._rows, choice, points) for choice in (level, "g1 linear")[: 1 + (level == "g1")]
                ]
                points, certificate, entries, rows = best_under_rows(
                    self.source.topology,
                    choices,
                    make,
                    points,
                    check,
                    progress,
                    looser=partial(self._looser, points, log) if level == "c1" else None,
                    release=level == "c1",
                    rounds=rounds,
                    budget=budget,
                )
                kept = self._linear.issuperset(rows.without) and not rows.collapsed
                # Fixed ratios are those of the source, whatever they cost.
                exact = level == "g1" and certificate.injective and not (rows.without or rows.contradictory)
                if exact and self.ratios == "target":
                    points, certificate, rows, changes = with_better_middles(
                        self.source.topology,
                        self._control,
                        points,
                        certificate,
                        rows,
                        make,
                        partial(self._least_jacobian, degenerate),
                        check,
                        budget,
                    )
                    entries += changes
                stage.found = f"{rows.active} rows kept; {entries[-1] if entries else 'no step'}"
            log += entries
            complete = complete and certificate.injective and kept
            if budget.expired() or (rounds == 1 and not complete):
                break
        return InteriorMap(points, certificate, log, [], rows), complete

    def paper(
        self,
        start: FloatArray,
        clock: Clock,
        budget: Budget,
        boundary: BoundaryReport | None = None,
        options: PaperOptions | None = None,
    ) -> InteriorMap:
        """The published method on the triangulated control net (paper §3.3), without rows and then under them.

        The passes under rows start from the map without them: the first map, which takes longest, is found once.
        """
        # Triangle meshes need SciPy, whose import takes longer than most maps.
        from ..paper.method import DEFAULTS, paper_map

        options = options or DEFAULTS
        topology = self.source.topology
        mapped = paper_map(topology, start, options=options, stage=clock, budget=budget)
        passes: tuple[PaperHistory, ...] = (mapped.history,)
        make_rows = partial(self._rows, literal=options.literal_rows)

        points, log, rows = mapped.points, list(mapped.log), None
        certificate = self.certify(points, clock, boundary)
        check = partial(self.certify, clock=clock, boundary=certificate.boundary)

        def solve(space: RowSpace, near: FloatArray) -> tuple[FloatArray, Certificate, list[str]]:
            nonlocal mapped, passes
            first = space.project(near)
            mapped = paper_map(topology, first, space.basis, options=options, given=first, stage=clock, budget=budget)
            passes = (*passes, mapped.history.after(passes, len(space.rows)))
            return mapped.points, check(mapped.points), mapped.log

        for level in self._levels:
            if budget.expired():
                break
            with clock("continuity rows"):
                if certificate.injective:
                    points, certificate, under, rows = optimize_under_rows(
                        topology,
                        partial(make_rows, level, points),
                        solve,
                        points,
                        check,
                        release=level == "c1",
                        budget=budget,
                    )
                else:
                    # A folded map has no frames to follow: take the source's.
                    space = row_space(make_rows(level, topology.coordinates), topology.interior_points, start)
                    points, certificate, under = solve(space, start)
                    under = [f"under {len(space.rows)} rows with the source's frames, {entry}" for entry in under]
                    rows = rows_summary(topology, space, points)
            log += under
        return InteriorMap(points, certificate, log, mapped.notes, rows, passes[-1])

    def harmonic(
        self, start: FloatArray, clock: Clock, reason: str, boundary: BoundaryReport | None = None
    ) -> InteriorMap:
        """The harmonic map on a boundary that rules out an injective one: an illustration of the reason."""
        points = self.optimizer(()).harmonic(start)
        return InteriorMap(points, self.certify(points, clock, boundary), [reason], [])

    def unproved(
        self,
        start: FloatArray,
        degenerate: Sequence[tuple[int, int]],
        progress: Progress | None,
        clock: Clock,
        budget: Budget,
        reason: str,
        boundary: BoundaryReport | None = None,
    ) -> InteriorMap:
        """One map of low distortion on a boundary that no certificate will accept: an illustration of the reason."""
        with clock("optimisation") as stage:
            optimizer = self.optimizer(degenerate)
            found = optimizer.minimise(
                optimizer.harmonic(start),
                max_steps=budget.first_steps(optimizer.step_cost, MAX_STEPS),
                progress=reporter(progress, "optimise"),
                tolerance=ROUGH,
                seconds=budget.seconds_left(),
            )
            stage.found = _figures(found)
        entry = f"optimise: {len(found.history)} Newton steps, {found.stop}, smallest determinant "
        certificate = self.certify(found.points, clock, boundary)
        return InteriorMap(found.points, certificate, [f"{entry}{found.min_determinant:.3g}", reason], [])

    def certify(self, points: FloatArray, clock: Clock, boundary: BoundaryReport | None = None) -> Certificate:
        """Proof of injectivity for shared control points; `boundary` is what is known of its loops."""
        with clock("certificate") as stage:
            certificate = certify(self.model(points), boundary=boundary)
            stage.found = certificate.status
        return certificate

    def model(self, points: FloatArray) -> MultiPatch:
        """The source with other control points; the last one is kept."""
        last = self._kept.model
        if last is None or last[0] is not points:
            last = self._kept.model = points, self.source.with_shared_points(points)
        return last[1]

    def optimizer(
        self,
        degenerate: Sequence[tuple[int, int]],
        nodes_per_degree: int = 2,
        extra_nodes: Sequence[tuple[int, float, float]] = (),
        null_space: Compressed | None = None,
    ) -> SplineOptimizer:
        """Optimizer on the source; symbolic work is kept, one optimizer a thread because it owns its buffers."""
        excluded = sorted(set(degenerate) | set(self._degenerate))

        def new() -> SplineOptimizer:
            return SplineOptimizer(
                self.source.topology,
                self.reference,
                nodes_per_degree=nodes_per_degree,
                extra_nodes=extra_nodes,
                excluded_corners=excluded,
                null_space=null_space,
            )

        if extra_nodes:
            return new()
        cache = self._kept.optimizers
        # Rows follow the target, but where a basis has its entries seldom changes.
        pattern = null_space is not None and (null_space.indptr.tobytes(), null_space.indices.tobytes())
        key = (nodes_per_degree, tuple(excluded), pattern)
        if key not in cache:
            under_rows = [known for known in cache if known[-1]]
            if pattern and len(under_rows) >= KEPT_PATTERNS:
                del cache[under_rows[0]]
            cache[key] = new()
        elif null_space is not None:
            cache[key].set_basis(null_space)
        return cache[key]

    def _looser(
        self, reference: FloatArray, log: list[str], tried: int, points: FloatArray, rows: ActiveRows
    ) -> MakeRows | None:
        """C1 rows with second rows that are relaxed, and then without them, at vertices where these spoil a map.

        Each choice may spoil a patch by half of what the one before may, for the kink grows from one to the next.
        """
        before, after = (self.source.with_shared_points(x) for x in (reference, points))
        lost = self._linear.symmetric_difference(rows.without)
        found = self._c1.second_rows & spoilt_vertices(before, after, lost, SPOILT**tried)
        if tried > 2 or not found:
            return None
        places = ", ".join(f"({x:.4g}, {y:.4g})" for x, y in reference[sorted(found)].tolist())
        way = "are relaxed" if tried == 1 else "are left out, all others relaxed"
        log.append(f"rows spoil patches: the second ones at the extraordinary vertices {places} {way}")

        followed = self._followed(reference)

        def make(released: Collection[Spoke], without: Collection[int]) -> ContinuityRows:
            if tried == 1:
                return self._c1(followed, released, without, relaxed=found)
            return self._c1(followed, released, without, relaxed=self._c1.second_rows, open_vertices=found)

        return make

    def _least_jacobian(self, degenerate: Sequence[tuple[int, int]], points: FloatArray) -> float:
        """Smallest scaled Jacobian of a map, of the samples that results are measured by."""
        return quality(self.model(points), exclude=degenerate).scaled_jacobian.min

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
        literal: bool = False,
    ) -> ContinuityRows:
        """Continuity rows that follow the speeds and frames of a reference map; C1 ones literally as the paper's."""
        followed = self._followed(reference)
        if level.startswith("g1"):
            return g1_rows(self.source.topology, self._control, followed, without, linear=level == "g1 linear")
        return self._c1(followed, released, without, literal=literal)

    def _followed(self, reference: FloatArray) -> FloatArray:
        """The map whose speeds and frames rows follow."""
        return self.source.topology.coordinates if self.ratios == "source" else reference


def _figures(found: OptimizedMap) -> str:
    """Steps and energy of the optimiser, for those who watch."""
    return f"{len(found.history)} Newton steps, energy {found.energy:.4f}, {found.stop}"
