"""Sides that are the target's own curves: nothing is fitted there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.basis import parts_of_spans
from ..geometry.curve import BSplineCurve
from ..geometry.outline import Outline, hausdorff
from ..numeric.arrays import FloatArray
from ..registration.register import LoopRegistration
from ..registration.same_curves import own_points

__all__ = ["distance", "with_own"]

#: Points of a span whose distance from the target is measured.
PER_SPAN = 16


def with_own(
    loops: Sequence[LoopRegistration], counts: Sequence[int], points: FloatArray, errors: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Control points and errors where sides are the target's own curves: those of the curves, and none."""
    if not any(loop.own for loop in loops):
        return points, errors
    points, errors = points.copy(), errors.copy()
    first, side = np.cumsum(counts) - counts, 0
    for loop in loops:
        n = len(loop.source.curves)
        for i, own in enumerate(loop.own):
            if own is not None:
                at = first[side + i]
                points[at : at + counts[side + i]] = own_points(own, loop.source.curves[i])
                errors[side + i] = 0.0
        for i in range(n if loop.own else 0):
            # One point for both curves that meet at a joint: that of the exact one.
            before, at = side + (i - 1) % n, first[side + i]
            end = first[before] + counts[before] - 1
            if loop.own[i] is not None:
                points[end] = points[at]
            elif loop.own[i - 1] is not None:
                points[at] = points[end]
        side += n
    return points, errors


def distance(curves: Sequence[BSplineCurve], loop: LoopRegistration) -> float:
    """Two-sided Hausdorff distance of a loop's fitted sides from its target.

    Where all sides are the target's own curves it is the largest distance across the target's tangents: feet, found to
    half the digits, count by the square of how far beside the nearest point they are then.
    """
    if not loop.own or any(own is None for own in loop.own):
        return hausdorff(Outline(curves), loop.target)
    x = np.concatenate([curve(parts_of_spans(curve.knots, PER_SPAN)) for curve in curves])
    feet = loop.target.evaluate(loop.target.nearest(x)[0])
    off = x - feet[:, :2]
    return float(abs(off[:, 0] * feet[:, 3] - off[:, 1] * feet[:, 2]).max())
