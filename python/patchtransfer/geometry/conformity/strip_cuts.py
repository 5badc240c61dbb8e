"""Cuts through whole strips: where one patch is cut, all are that it shares the direction's knots with."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from ..patch import Patch
from ..sides import Interface
from ..strips import strips_of

__all__ = ["SAME_CUT", "along_strips"]

Tag = TypeVar("Tag", bound=Hashable)

#: Cuts nearer to a knot, or to each other, in units of the side's length, are made there: thinner spans are rounding.
SAME_CUT = 1e-8


def along_strips(
    patches: Sequence[Patch],
    interfaces: Sequence[Interface],
    wanted: Mapping[tuple[int, int], Sequence[tuple[Tag, float]]],
    choose: Callable[[list[tuple[Tag, float]], list[float]], list[float]],
) -> dict[tuple[int, int], list[float]]:
    """Where patches are to be cut, by (patch, axis), in their own knots and sorted: through whole strips.

    Parameters
    ----------
    patches : sequence of Patch
    interfaces : sequence of Interface
    wanted : mapping of (patch, axis) to pairs
        Of each cut something about it that `choose` wants to know, and its place from 0 to 1.
    choose : callable
        Takes what is wanted anywhere in a strip and its inner knots, both from 0 to 1 in the strip's sense; gives the
        places of its cuts.
    """
    cuts = {}
    for strip in strips_of(len(patches), interfaces):
        own = [(tag, 1 - t if flipped else t) for m, flipped in strip.members.items() for tag, t in wanted.get(m, ())]
        if not own:
            continue
        if strip.twisted:
            own += [(tag, 1 - t) for tag, t in own]
        knots = [_fractions(patches[k], axis, flipped) for (k, axis), flipped in strip.members.items()]
        places = choose(own, [t for ts in knots for t in ts])
        for (k, axis), flipped in strip.members.items() if places else ():
            cuts[k, axis] = sorted(_parameter(patches[k], axis, 1 - t if flipped else t) for t in places)
    return cuts


def _fractions(patch: Patch, axis: int, flipped: bool) -> list[float]:
    """Inner knots from 0 to 1, in the strip's sense."""
    knots = patch.knots[axis]
    t = (knots - knots[0]) / (knots[-1] - knots[0])
    inner = t[(t > SAME_CUT) & (t < 1 - SAME_CUT)]
    return list(1 - inner if flipped else inner)


def _parameter(patch: Patch, axis: int, fraction: float) -> float:
    """The parameter at a part of a direction; a knot's own value where one is."""
    knots = patch.knots[axis]
    t = float(knots[0] + fraction * (knots[-1] - knots[0]))
    nearest = float(knots[np.abs(knots - t).argmin()])
    return nearest if abs(nearest - t) <= SAME_CUT * (knots[-1] - knots[0]) else t
