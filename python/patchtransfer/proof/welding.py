"""Interfaces whose sides differ by rounding, made one: the model that a certificate is for.

Programs that evaluate, transform or reverse the sides of an interface one by one write such files. A rewritten model
has one number for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..geometry.combinatorics import Quantity
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.strips import strips
from ..geometry.topology import Topology
from ..numeric.arrays import FloatArray

__all__ = ["Welded", "in_own_knots", "weld"]

#: Interface control points may differ by this many units of the largest coordinate's roundoff.
WELD_ULPS = 8.0
#: Knots along an interface, mapped to [0, 1], may differ by this many units of roundoff.
KNOT_ULPS = 4.0
#: Twice the unit of roundoff.
EPS = float(np.finfo(float).eps)


class Welded(NamedTuple):
    """A multi-patch with common numbers where sides differed by rounding, and what is left.

    Attributes
    ----------
    multipatch : MultiPatch
        With common control points.
    patches : sequence of Patch
        Its patches with common knots, in the sense of the patch but not on its own interval.
    point_gaps, knot_gaps : sequence of float
        What the two sides still differ by, interface by interface.
    notes : list of str
        What was made common.
    """

    multipatch: MultiPatch
    patches: Sequence[Patch]
    point_gaps: Sequence[float]
    knot_gaps: Sequence[float]
    notes: list[str]


def weld(multipatch: MultiPatch) -> Welded:
    """Take common control points and knots for the two sides of interfaces that differ by rounding only."""
    welded, point_gaps, notes = _weld_points(multipatch)
    common = _common_knots(welded.topology)
    patches = welded.patches
    if common.knots is not None:
        patches = tuple(
            Patch._trusted(knots, patch.degrees, patch.control_points, patch.weights)
            for patch, knots in zip(patches, common.knots, strict=True)
        )
    return Welded(welded, patches, point_gaps, common.gaps, notes + common.notes)


def _weld_points(multipatch: MultiPatch) -> tuple[MultiPatch, list[float], list[str]]:
    gaps = _point_gaps(multipatch)
    if multipatch.is_rational or not any(gaps):
        return multipatch, gaps, []
    points = multipatch.topology.coordinates
    if max(gaps) > WELD_ULPS * EPS * float(np.abs(points).max()):
        return multipatch, gaps, []
    notes = [
        f"interface {f.name}: the two sides differ by rounding ({gap:.2g}); the outcome is for their common mean"
        for f, gap in zip(multipatch.interfaces, gaps, strict=True)
        if gap > 0.0
    ]
    return multipatch.with_shared_points(points), [0.0] * len(gaps), notes


def _point_gaps(multipatch: MultiPatch) -> list[float]:
    """Largest difference of the control points of an interface's two sides, interface by interface."""
    if not multipatch.interfaces:
        return []
    a, b, starts = multipatch.topology.glued_entries
    points = np.concatenate([patch.control_points.reshape(-1, 2) for patch in multipatch.patches])
    gaps: list[float] = np.maximum.reduceat(np.abs(points[a] - points[b]).max(axis=1), starts).tolist()
    return gaps


@Quantity
def _common_knots(topology: Topology) -> _CommonKnots:
    """Knots of one patch for all of the strip that they run across, where those differ by rounding."""
    gaps = list(topology.knot_gaps)
    knots: list[tuple[FloatArray, FloatArray]] = [patch.knots for patch in topology.patches]
    found: list[int] = []
    largest = 0.0
    for strip in strips(topology) if any(gaps) else ():
        inside = [i for i in strip.interfaces if gaps[i] > 0.0]
        if not inside or max(gaps[i] for i in inside) > KNOT_ULPS * EPS / 2:
            continue
        first, axis = next(iter(strip.members))
        common = topology.patches[first].knots[axis]
        if strip.twisted:
            # Knots that are their own reverse.
            common = _frozen((common - common[::-1]) / 2)
        against = _frozen(-common[::-1])
        for (k, axis), flipped in strip.members.items():
            own = against if flipped else common
            knots[k] = (own, knots[k][1]) if axis == 0 else (knots[k][0], own)
        largest = max(largest, *(gaps[i] for i in inside))
        for i in inside:
            gaps[i] = 0.0
        found += inside
    if not found:
        return _CommonKnots(None, gaps, [])
    more = f" and {len(found) - 1} more" if len(found) > 1 else ""
    note = (
        f"interface {topology.interfaces[min(found)].name}{more}: the knots of the two sides differ by "
        f"rounding ({largest:.2g}); the outcome is for one side's knots on both"
    )
    return _CommonKnots(knots, gaps, [note])


class _CommonKnots(NamedTuple):
    """Knots of all patches, None if all keep theirs; what the sides still differ by; and notes."""

    knots: list[tuple[FloatArray, FloatArray]] | None
    gaps: list[float]
    notes: list[str]


def _frozen(array: FloatArray) -> FloatArray:
    array.flags.writeable = False
    return array


def in_own_knots(values: Sequence[float], knots: FloatArray, welded: FloatArray) -> tuple[float, ...]:
    """Parameters of a patch whose knots were replaced by `welded` in its own ones."""
    if welded is knots:
        return tuple(values)
    return tuple(np.interp(values, welded[[0, -1]], knots[[0, -1]]).tolist())
