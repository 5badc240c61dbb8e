"""Why boundary loops touch or cross: sides that should be one and are not glued."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.conformity.coincidences import NAMED_GAP, WIDE_GAP, Coincidence, coincidences
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Side

__all__ = ["unglued"]

#: Meetings are found to this part of the model's diameter.
NEAR = 1e-6

#: Two sides (patch, Side) of the boundary, and the point where they meet.
MeetingOf = tuple[tuple[int, Side], tuple[int, Side], tuple[float, float]]


def unglued(multipatch: MultiPatch, meetings: Sequence[MeetingOf]) -> tuple[list[str], set[int]]:
    """Pairs of sides that should be glued, in words, and the meetings (positions) that they explain.

    Wide gaps count only where the boundary meets itself between their sides.
    """
    found = coincidences(multipatch.patches, multipatch.interfaces, WIDE_GAP) if multipatch.boundaries else []
    size = multipatch.diameter
    explains = [{i for i, met in enumerate(meetings) if _is_between(met, pair, size)} for pair in found]
    counted = [i for i, pair in enumerate(found) if explains[i] or pair.gap <= NAMED_GAP * size]
    return [found[i].text for i in counted], set().union(*(explains[i] for i in counted))


def _is_between(met: MeetingOf, pair: Coincidence, size: float) -> bool:
    a, b, point = met
    if {a, b} == {pair.a, pair.b}:
        return True
    return bool((np.abs(pair.ends - point).max(axis=1) <= 2 * pair.gap + NEAR * size).any())
