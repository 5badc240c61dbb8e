"""Sides that coincide, or nearly, and are not glued: in words, with the command that mends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...numeric.arrays import FloatArray
from ..mending import OTHER_CURVE, conform_command, short
from ..patch import Patch
from ..sides import Interface
from ..tolerances import diameter, exact
from .overlaps import Overlap, SideOf, overlaps, whole_pairs

__all__ = ["NAMED_GAP", "OF_THICKNESS", "WIDE_GAP", "Coincidence", "between_parts", "coincidences", "widest"]

#: Gaps up to this part of the model's diameter, and the thickness of the patches, are named: sides of printed models
#: that were meant to meet are within a thousandth of it. More is as likely a slit.
NAMED_GAP = 1e-3
#: ... and up to this part where the boundary crosses itself between the sides, or the model falls into parts: sides
#: that were fitted one by one.
WIDE_GAP = 2e-2
#: Both sides move by half of the gap that is closed between them, so it may be as large as the patches are thick.
OF_THICKNESS = 1.0


class Coincidence(NamedTuple):
    """Sides of which a model should make one, and does not.

    Attributes
    ----------
    text : str
        What they are, and the command that mends it.
    a, b : tuple of (patch, Side)
    gap : float
    ends : (4, 2) array
        Of the two sides.
    """

    text: str
    a: SideOf
    b: SideOf
    gap: float
    ends: FloatArray


def coincidences(
    patches: Sequence[Patch], interfaces: Sequence[Interface], part: float = NAMED_GAP
) -> list[Coincidence]:
    """All pairs of sides outside of interfaces that coincide, or are apart by less than the patches' thickness.

    Parameters
    ----------
    patches : sequence of Patch
    interfaces : sequence of Interface
    part : float
        Of the model's diameter, up to which a gap is named.
    """
    glued = {side for f in interfaces for side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b))}
    size = diameter(patches)
    found = overlaps(patches, glued, part * size, OF_THICKNESS)
    pairs = whole_pairs(found)
    taken = {side for pair in pairs for side in (pair.a, pair.b)}
    pairs += [pair for pair in found if not (taken & {pair.a, pair.b})]
    rounding = exact(patches)
    named = []
    for pair in sorted(pairs, key=lambda pair: (pair.a, pair.b, pair.range_a)):
        ends = np.concatenate([side.of(patches[k].control_points)[[0, -1]] for k, side in (pair.a, pair.b)])
        named.append(Coincidence(describe(pair, rounding), pair.a, pair.b, pair.gap, ends))
    return named


def widest(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> float:
    """Largest gap above rounding between sides that could be one; 0 if there is none."""
    gaps = [c.gap for c in coincidences(patches, interfaces, WIDE_GAP)]
    return max((gap for gap in gaps if gap > exact(patches)), default=0.0)


def between_parts(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> str:
    """Why a model falls into parts, and what to do: as the end of a message."""
    found = [c.text for c in coincidences(patches, interfaces, WIDE_GAP)]
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return f": {found[0]}{more}" if found else " (are interfaces missing?); take them one by one"


def describe(pair: Overlap, rounding: float) -> str:
    """One line on two sides; gaps above `rounding` are told."""
    apart = pair.gap > rounding
    a, b = (f"patch {k} {side.name.lower()}" for k, side in (pair.a, pair.b))
    gap = f"are {short(pair.gap)} apart (gap)"
    if not pair.same_speed:
        return (
            f"{a} and {b} coincide{' nearly' if apart else ''}, but their parameters run along it at different speeds, "
            f"which no knot insertion mends; {OTHER_CURVE}"
        )
    if pair.whole:
        text = f"{a} and {b} {gap if apart else 'coincide'}"
        differences = _differences(pair)
        text += f"; {differences}" if differences else ""
    else:
        parts = [
            f"{name} from {low:.6g} to {high:.6g}" if (low, high) != (0.0, 1.0) else name
            for name, (low, high) in ((a, pair.range_a), (b, pair.range_b))
        ]
        text = f"{parts[0]} and {parts[1]} (T-junction) {gap if apart else 'coincide'}"
    return f"{text}; run `{conform_command(pair.gap if apart else 0.0)}`"


def _differences(pair: Overlap) -> str:
    (p, m), (q, n) = pair.parts_a, pair.parts_b
    differences = []
    if p != q:
        differences.append(f"degrees differ: {p} and {q}")
    if m != n:
        differences.append(f"knots differ: {m} and {n} spans")
    elif not pair.same_knots and p == q:
        differences.append(f"knots differ: {m} and {n} spans, but not the same ones")
    return ", ".join(differences)
