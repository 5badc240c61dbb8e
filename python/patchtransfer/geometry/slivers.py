"""Slivers: what is smaller than the resolution of a drawing and was not drawn, though its ends turn like corners."""

from __future__ import annotations

import math

import numpy as np

from ..numeric.arrays import FloatArray
from .outline import CORNER, Outline

__all__ = ["RESOLUTION", "SHARE", "TURNS_BACK", "drawn_corners"]

#: What is smaller (relative to the diameter) can be a slip of rounding: half of the smallest feature that is kept.
RESOLUTION = 5e-4
#: A sliver or a gap is at most this share of the edges that it lies between.
SHARE = 0.1
#: An outline that turns by more over a short edge has an end there, as thick as the edge is long.
TURNS_BACK = math.radians(150.0)


def drawn_corners(outline: Outline) -> tuple[FloatArray, FloatArray]:
    """Corners of a loop, with those at the ends of a sliver as the one that they make together, or none.

    A loop that was cleaned when it was read has no slivers; others may.

    Returns
    -------
    at, turn : (n,) arrays
        Arc lengths, increasing, and turning angles (radians): `outline.corners` where there are no slivers. The corner
        that a sliver is stands at its sharpest end that turns the same way.
    """
    at, turn = outline.corners
    gap = np.diff(at, append=at[:1] + outline.length)
    short = gap <= RESOLUTION * outline.diameter
    if not short.any() or short.all():
        return at, turn
    keep, merged = np.ones(len(at), bool), turn.copy()
    n = len(at)
    for first in np.flatnonzero(short & ~np.roll(short, 1)).tolist():
        run = [first]
        while short[run[-1]]:
            run.append((run[-1] + 1) % n)
        total = float(gap[run[:-1]].sum())
        # From before to after: between, the outline may turn round and back.
        net = math.remainder(turn[run].sum(), 2 * math.pi)
        beside = min(gap[run[0] - 1], gap[run[-1]])
        if total > min(RESOLUTION * outline.diameter, SHARE * beside) or abs(net) > TURNS_BACK:
            continue
        keep[run] = False
        if abs(net) > CORNER:
            sharpest = max(run, key=lambda i: turn[i] * np.sign(net))
            keep[sharpest], merged[sharpest] = True, net
    return at[keep], merged[keep]
