"""Interfaces whose sides differ by rounding, made one: the model that a certificate is for.

Programs that evaluate, transform or reverse the sides of an interface one by one write such files. A rewritten model
has one number for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ..geometry.combinatorics import Quantity
from ..geometry.conformity.weighting import along
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
    point_gaps, knot_gaps, weight_gaps : sequence of float
        What the two sides still differ by, interface by interface; weights relative to their size and up to a common
        factor, which does not change a curve.
    notes : list of str
        What was made common.
    """

    multipatch: MultiPatch
    patches: Sequence[Patch]
    point_gaps: Sequence[float]
    knot_gaps: Sequence[float]
    weight_gaps: Sequence[float]
    notes: list[str]


def weld(multipatch: MultiPatch) -> Welded:
    """Take common control points, weights and knots for the two sides of interfaces that differ by rounding only."""
    welded, point_gaps, notes = _weld_points(multipatch)
    common = _common_knots(welded.topology)
    weights, weight_gaps, weight_notes = _weld_weights(multipatch)
    patches = welded.patches
    if common.knots is not None or weights is not None:
        knots = [patch.knots for patch in patches] if common.knots is None else common.knots
        weights = [patch.weights for patch in patches] if weights is None else weights
        patches = tuple(
            Patch._trusted(k, patch.degrees, patch.control_points, w)
            for patch, k, w in zip(patches, knots, weights, strict=True)
        )
    return Welded(welded, patches, point_gaps, common.gaps, weight_gaps, notes + weight_notes + common.notes)


def _weld_points(multipatch: MultiPatch) -> tuple[MultiPatch, list[float], list[str]]:
    gaps = _point_gaps(multipatch)
    if not any(gaps):
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


def _weld_weights(multipatch: MultiPatch) -> tuple[list[FloatArray | None] | None, list[float], list[str]]:
    """Weights of all patches with one for all that a control point has, None if all keep theirs; gaps; notes."""
    gaps = [0.0] * len(multipatch.interfaces)
    if not multipatch.is_rational:
        return None, gaps, []
    sides = [along(multipatch.patches, f) for f in multipatch.interfaces]
    # Of the larger one, for ratios may overflow.
    apart = [float((np.abs(a - b) / np.maximum(a, b)).max()) for a, b in sides]
    # Sides whose weights are the same up to a factor are the same curve already.
    found = [i for i, (a, b) in enumerate(sides) if apart[i] > 0.0 and not _proportional(a, b)]
    for i in found:
        gaps[i] = apart[i]
    # Where a factor is not one there is no common mean.
    if not found or max(apart) > WELD_ULPS * EPS:
        return None, gaps, []
    weights = _mean_weights(multipatch)
    welded = [
        None if patch.weights is None else _frozen(weights[numbers])
        for patch, numbers in zip(multipatch.patches, multipatch.topology.points, strict=True)
    ]
    notes = [
        f"interface {multipatch.interfaces[i].name}: the weights of the two sides differ by rounding ({gaps[i]:.2g}); "
        "the outcome is for their common mean"
        for i in found
    ]
    return welded, [0.0] * len(gaps), notes


def _proportional(a: FloatArray, b: FloatArray) -> bool:
    """Whether two rows of weights are the same up to a factor, exactly."""
    x, y = Fraction(float(a[0])), Fraction(float(b[0]))
    return all(Fraction(s) * y == Fraction(t) * x for s, t in zip(a.tolist(), b.tolist(), strict=True))


def _mean_weights(multipatch: MultiPatch) -> FloatArray:
    """A weight for every shared control point: the mean over its patches; one where a patch is polynomial."""
    topology, patches = multipatch.topology, multipatch.patches
    numbers = np.concatenate([n.ravel() for n in topology.points])
    values = np.concatenate(
        [(np.ones(patch.shape) if patch.weights is None else patch.weights).ravel() for patch in patches]
    )
    ones = np.concatenate([np.full(patch.shape, patch.weights is None).ravel() for patch in patches])
    count = np.bincount(numbers, minlength=topology.n_points)
    mean = np.bincount(numbers, values, topology.n_points) / count
    mean[numbers[ones]] = 1.0
    # A point of one patch, or of equal weights, keeps its bits.
    low, high = np.full(topology.n_points, np.inf), np.full(topology.n_points, -np.inf)
    np.minimum.at(low, numbers, values)
    np.maximum.at(high, numbers, values)
    return np.where(low == high, low, mean)


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
