"""Spikes: places where an outline runs back over itself, out and in again or forth and back on one straight line.

A slip of drawing programs, when they join or simplify pieces. There is nothing on one side of it or the other, so that
it encloses nothing; and no injective map has such an outline.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..geometry.curve import BSplineCurve
from ..numeric.arrays import FloatArray
from .loops import with_ends

__all__ = ["without_spikes"]

#: Legs nearer to each other (relative to the diameter) are one: what rounding to seven digits leaves between them.
WIDTH = 1e-6
#: Part of the legs' length that they may be apart: shorter legs at an angle are a sliver's.
SLOPE = 1e-2
#: Longer ones (relative to the diameter) may be meant, as a crack.
LENGTH = 1e-2


def without_spikes(
    loop: Sequence[BSplineCurve], size: float
) -> tuple[list[BSplineCurve], list[tuple[float, FloatArray]]]:
    """The loop without its spikes, whose legs are straight, and their lengths and tips.

    Parameters
    ----------
    loop : sequence of BSplineCurve
        Closed.
    size : float
        Its diameter.
    """
    curves = list(loop)
    found: list[tuple[float, FloatArray]] = []
    i = 0
    while i < len(curves) and len(curves) > 3:
        following = (i + 1) % len(curves)
        kept = _cut(curves[i], curves[following], size)
        if kept is None:
            i += 1
            continue
        tip, there, back = curves[i].end, curves[i], curves[following]
        found.append((min(_chord(there), _chord(back)), tip))
        curves[i], curves[following] = kept[0], kept[1]  # type: ignore[assignment]
        curves = [curve for curve in curves if curve is not None]
        # The legs of a spike may have several pieces.
        i = max(i - 1, 0)
    if not found:
        return curves, found
    joined = [with_ends(a, a.start, b.start) for a, b in pairwise([*curves, curves[0]])]
    return joined, found


def _cut(
    there: BSplineCurve, back: BSplineCurve, size: float
) -> tuple[BSplineCurve | None, BSplineCurve | None] | None:
    """What is left of two curves if they are the legs of a spike; None if they are not."""
    out, home = there.end - there.start, back.end - back.start
    far, near = float(np.hypot(*out)), float(np.hypot(*home))
    if min(far, near) > LENGTH * size or min(far, near) == 0 or float(out @ home) >= 0:
        return None
    width = WIDTH * size
    if not (_straight(there, width) and _straight(back, width)):
        return None
    longer, shorter = (out, home) if far > near else (home, out)
    apart = abs(longer[0] * shorter[1] - longer[1] * shorter[0]) / float(np.hypot(*longer))
    if apart > min(width, SLOPE * min(far, near)):
        return None
    if abs(far - near) <= width:
        return None, None
    if far > near:
        return _line(there.start, back.end), None
    return None, _line(there.start, back.end)


def _straight(curve: BSplineCurve, width: float) -> bool:
    """Whether a curve goes straight on from its start to its end."""
    chord = curve.end - curve.start
    length = float(np.hypot(*chord))
    along = (curve.control_points - curve.start) @ chord / length
    beside = (curve.control_points - curve.start) @ np.array([-chord[1], chord[0]]) / length
    return bool((np.diff(along) >= -width).all() and np.abs(beside).max() <= width)


def _line(start: FloatArray, end: FloatArray) -> BSplineCurve:
    return BSplineCurve([0.0, 0.0, 1.0, 1.0], 1, [start, end])


def _chord(curve: BSplineCurve) -> float:
    return float(np.hypot(*(curve.end - curve.start)))
