"""A source with more knots: the same map in a finer spline space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..fitting.fit import FittedBoundary
from ..fitting.refinement import Knot, insert_in_strips, missed_spans
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..interior.solver import InteriorSolver
from .options import Run
from .posed import Registered
from .source_boundary import SourceBoundary

__all__ = ["Finer", "finer", "refined_note", "to_tolerance"]

#: Rounds of knot insertion at most to reach the fit tolerance; each halves the spans that miss it.
REFINEMENTS = 6
WIGGLES = "the fit tolerance is not reached: with more knots the fitted boundary rules out an injective map"


class Finer(NamedTuple):
    """What a transfer goes on with, its source refined or not, and how it gets more knots."""

    boundary: SourceBoundary
    interior: InteriorSolver
    registered: Registered
    refine: Callable[[Sequence[Knot], Registered], Finer]

    @property
    def source(self) -> MultiPatch:
        """The source with the knots that it has by now."""
        return self.interior.source

    def fit(self, run: Run) -> FittedBoundary:
        """The boundary fitted with these knots."""
        return self.boundary.fit(self.registered.registration, run)


def finer(
    source: MultiPatch, reference: Sequence[Patch] | None, knots: Sequence[Knot], multiplicity: int
) -> tuple[MultiPatch, list[Patch] | None]:
    """A source with shared points, and its reference, with knots inserted in whole strips of patches."""
    topology = source.topology
    patches = insert_in_strips(topology, topology.patches, knots, multiplicity)
    of_reference = None if reference is None else insert_in_strips(topology, reference, knots, multiplicity)
    return MultiPatch(patches, source.interfaces, source.ids, source.sides, source.blocks), of_reference


def refined_note(knots: str, before: MultiPatch, after: MultiPatch) -> str:
    """What is said of a source that got more knots."""
    sizes = f"{before.topology.n_points} -> {after.topology.n_points} control points"
    return f"the source was refined: {knots} and the strips of patches behind them, {sizes}"


def to_tolerance(now: Finer, fitted: FittedBoundary, run: Run) -> tuple[Finer, FittedBoundary, list[str]]:
    """Insert knots where the fit misses the target, until it reaches the tolerance, and say so."""
    source, count, tolerance = now.source, 0, run.options.fit_tolerance
    rounds = [(now, fitted, count)]
    for _ in range(REFINEMENTS):
        if fitted.error <= tolerance or run.budget.expired():
            break
        with run.clock("refinement") as stage:
            knots = missed_spans(now.registered.registration, fitted, now.source.topology.loops, tolerance)
            now = now.refine(knots, now.registered)
            stage.found = f"{len(knots)} boundary spans halved, {now.source.topology.n_points} control points"
        count += len(knots)
        fitted = now.fit(run)
        rounds.append((now, fitted, count))
    now, fitted, count = _feasible(rounds)
    notes = [] if now is rounds[-1][0] else [WIGGLES]
    note = refined_note(f"knots in {count} boundary spans", source, now.source)
    return now, fitted, notes if now.source is source else [note, *notes]


def _feasible(rounds: Sequence[tuple[Finer, FittedBoundary, int]]) -> tuple[Finer, FittedBoundary, int]:
    """The last of the rounds whose fit allows an injective map, the very last if none does."""
    for now, fitted, count in reversed(rounds):
        if now.boundary.check(fitted).failure is None:
            return now, fitted, count
    return rounds[-1]
