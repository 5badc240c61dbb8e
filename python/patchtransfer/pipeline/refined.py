"""A source with more knots: the same map in a finer spline space."""

from __future__ import annotations

from collections.abc import Sequence

from ..fitting.refinement import Knot, insert_in_strips
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch

__all__ = ["finer", "refined_note"]


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
