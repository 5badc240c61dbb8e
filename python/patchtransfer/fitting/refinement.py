"""Knot refinement of a source: the same geometry and conforming interfaces, with more control points where needed.

A knot inserted along a patch side must be inserted in the opposite side too, hence in the neighbour, and so on: in a
whole *strip* of patches. Beyond the paper, which takes the source's
knots as they are.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from ..geometry.basis import knot_spans
from ..geometry.curve import BSplineCurve
from ..geometry.outline import Outline
from ..geometry.patch import Patch
from ..geometry.strips import strips
from ..geometry.topology import BoundarySide, Topology
from ..numeric.arrays import FloatArray
from ..registration.register import Registration
from .fit import FittedBoundary

__all__ = ["insert_in_strips", "lone_spans", "missed_spans", "span_middles"]

#: A knot to insert: patch, axis of the knot vector, parameter.
Knot = tuple[int, int, float]

#: Samples per span where a fit is compared with its target.
SAMPLES_PER_SPAN = 12
#: Spans that miss the target by less than this part of the worst are left for the next round, at any tolerance.
NEARLY_WORST = 0.9
#: Knots of a strip closer than this part of its length are one.
SAME_KNOT = 1e-9


def insert_in_strips(
    topology: Topology, patches: Sequence[Patch], knots: Iterable[Knot], multiplicity: int = 1
) -> list[Patch]:
    """Insert knots, each in all patches of its strip.

    Parameters
    ----------
    topology : Topology
    patches : sequence of Patch
        The topology's patches, or others on the same knots (a reference map).
    knots : iterable of (patch, axis, parameter)
        Knots that the patch has already are inserted once more.
    multiplicity : int, default 1
        How often each is inserted.

    Returns
    -------
    list of Patch
        Interfaces stay conforming.
    """
    strip_of = {
        member: (index, against)
        for index, strip in enumerate(strips(topology))
        for member, against in strip.members.items()
    }
    positions: dict[int, list[float]] = defaultdict(list)
    for k, axis, t in knots:
        a, b = topology.patches[k].knots[axis][[0, -1]]
        strip, against = strip_of[k, axis]
        x = (t - a) / (b - a)
        positions[strip].append(1 - x if against else x)
    refined = []
    for k, patch in enumerate(patches):
        for axis in (0, 1):
            strip, against = strip_of[k, axis]
            x = np.sort(positions[strip])
            x = x[np.diff(x, prepend=-1.0) > SAME_KNOT]
            a, b = patch.knots[axis][[0, -1]]
            x = np.repeat(np.sort(1 - x) if against else x, multiplicity)
            patch = patch.insert_knots(axis, a + (b - a) * x)
        refined.append(patch)
    return refined


def span_middles(patches: Sequence[Patch]) -> list[Knot]:
    """The middle of every knot span of every patch, in both directions."""
    middles = []
    for k, patch in enumerate(patches):
        for axis in (0, 1):
            breaks = knot_spans(patch.knots[axis])
            middles += [(k, axis, float(t)) for t in (breaks[:-1] + breaks[1:]) / 2]
    return middles


def lone_spans(patches: Sequence[Patch]) -> list[Knot]:
    """The middle of every direction of a patch that has a single span."""
    return [(k, axis, t) for k, axis, t in span_middles(patches) if len(knot_spans(patches[k].knots[axis])) == 2]


def missed_spans(
    registration: Registration,
    fitted: FittedBoundary,
    sides: Sequence[Sequence[BoundarySide]],
    tolerance: float,
) -> list[Knot]:
    """Middles of the boundary spans where fit and target are farther apart than the tolerance.

    Parameters
    ----------
    registration : Registration
    fitted : FittedBoundary
        Its fit.
    sides : loops of BoundarySide
        What the fitted curves belong to (``topology.loops``).
    tolerance : float
        Largest distance, in either direction, relative to the target's diameter.

    Returns
    -------
    list of (patch, axis, parameter)
        Ready for `insert_in_strips`; with at least the worst span, whatever the tolerance.
    """
    diameter = registration.loops[0].target.diameter
    compared = []
    for loop, fits in zip(registration.loops, fitted.loops, strict=True):
        curves = [fit.curve for fit in fits]
        outline = Outline(curves)
        # Where the fit is off the target, and where the target is off the fit (a part that is cut short).
        own = np.concatenate([outline.arc_length(i, _samples(curve)) for i, curve in enumerate(curves)])
        _, distance = loop.target.nearest(outline.point(own))
        feet, missed = outline.nearest(loop.target.polygon(max(2 * len(own), 512)))
        compared.append((outline, np.concatenate([own, feet]), np.concatenate([distance, missed])))
    worst = max(float(distance.max()) for _, _, distance in compared)
    limit = min(tolerance * diameter, NEARLY_WORST * worst)
    knots: set[Knot] = set()
    for (outline, at, distance), of_loop in zip(compared, sides, strict=True):
        for i, t in {_span_at(outline, float(s)) for s in at[distance > limit]}:
            side, (a, b) = of_loop[i], outline.curves[i].domain
            knots.add((side.patch, side.side.axis, a + b - t if side.reversed else t))
    return sorted(knots)


def _samples(curve: BSplineCurve) -> FloatArray:
    """Parameters inside every span."""
    breaks = knot_spans(curve.knots)
    inside = (np.arange(SAMPLES_PER_SPAN) + 0.5) / SAMPLES_PER_SPAN
    return np.asarray((breaks[:-1, None] + np.diff(breaks)[:, None] * inside).ravel())


def _span_at(outline: Outline, s: float) -> tuple[int, float]:
    """Curve that the arc length falls on, and the middle of the span."""
    i = int(np.clip(np.searchsorted(outline.joints, s, side="right") - 1, 0, len(outline.curves) - 1))
    breaks = knot_spans(outline.curves[i].knots)
    lengths = outline.arc_length(i, breaks)
    j = int(np.clip(np.searchsorted(lengths, s, side="right") - 1, 0, len(breaks) - 2))
    return i, float((breaks[j] + breaks[j + 1]) / 2)
