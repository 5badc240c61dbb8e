"""Patches made to conform: cut at T-junctions, refined to common splines, gaps between their sides closed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...errors import InputError
from ...limits import MAX_PATCHES, at_most
from ..patch import Patch
from ..sides import Interface, Side
from ..tolerances import COINCIDENCE, diameter
from .coincidences import OF_THICKNESS
from .common_splines import with_common_splines
from .cutting import Pieces
from .overlaps import Overlap, SideOf, overlaps, whole_pairs
from .strip_cuts import SAME_CUT, along_strips
from .weighting import with_common_weights
from .welds import welded

__all__ = ["Conforming", "conforming"]

#: A gap moves the foot of a point along the side by about as much, from either side of the junction.
CUT_BY_GAP = 4.0
#: Every round cuts through strips, whose far ends may make new T-junctions. Cuts that go on run in a spiral.
MAX_ROUNDS = 100
#: ... as those do that make pieces thinner than this part of a patch, after as many rounds as halve it to that.
THIN, AFTER_ROUNDS = 1e-3, 10
#: A stated tolerance holds for a gap that is it but for the rounding of coordinates and of the number said.
LEEWAY = 1.0 + 1e-6


SPIRAL = "cutting at T-junctions does not come to an end (the cuts run in a spiral); make patch {} again in parts"


class Conforming(NamedTuple):
    """Patches that agree along interfaces.

    Attributes
    ----------
    patches : list of Patch
    interfaces : list of Interface
    origins : list of int
        Of every patch the one it was cut from; first pieces keep their number.
    parts : dict of (patch, Side) to lists of (patch, Side)
        Of every side as it was, its parts in order along it.
    moved : float
        How far the control point that moved most did.
    notes : list of str
        What was done.
    """

    patches: list[Patch]
    interfaces: list[Interface]
    origins: list[int]
    parts: dict[SideOf, list[SideOf]]
    moved: float
    notes: list[str]


def conforming(
    patches: Sequence[Patch],
    interfaces: Sequence[Interface],
    weld: float,
) -> Conforming:
    """Make patches agree exactly along all sides that coincide within rounding, or within `weld`.

    Parameters
    ----------
    patches : sequence of Patch
    interfaces : sequence of Interface
        Known ones. More are found.
    weld : float
        Gaps up to this length are closed.
    """
    patches, interfaces = list(patches), list(interfaces)
    parts = {(k, side): [(k, side)] for k in range(len(patches)) for side in Side}
    given, origins, notes = patches, list(range(len(patches))), list[str]()
    for turn in range(MAX_ROUNDS):
        glued = {side for f in interfaces for side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b))}
        found = _coinciding(patches, glued, weld * LEEWAY)
        new = [Interface(*pair.a, *pair.b, pair.reversed) for pair in whole_pairs(found)]
        interfaces += new
        notes += [f"{_two(f)} glued" for f in new]
        # A side that is glued whole is not cut where, by a smaller gap, another one of its ends would be.
        whole = {side for f in new for side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b))}
        cuts = _cuts(patches, interfaces, [pair for pair in found if not whole & {pair.a, pair.b}])
        if not cuts:
            break
        pieces = Pieces(patches, cuts)
        at_most(len(pieces.patches), MAX_PATCHES, "patches after cutting at T-junctions", "split the model")
        notes += _cut_sentences(pieces, cuts)
        interfaces = pieces.glued(interfaces)
        parts = {side: [piece for part in own for piece in pieces.on(part)] for side, own in parts.items()}
        origins = [origins[k] for k in pieces.origins]
        patches = pieces.patches
        if turn >= AFTER_ROUNDS and (thin := _too_thin(given, patches, origins)) is not None:
            raise InputError(SPIRAL.format(thin))
    else:
        raise InputError(SPIRAL.format(origins[min(k for k, _ in cuts)]))
    patches, refined = with_common_splines(patches, interfaces)
    patches, weighted = with_common_weights(patches, interfaces)
    patches, moved, closed = welded(patches, interfaces, weld * LEEWAY)
    return Conforming(patches, interfaces, origins, parts, moved, [*notes, *refined, *weighted, *closed])


def _coinciding(patches: Sequence[Patch], glued: set[SideOf], weld: float) -> list[Overlap]:
    """Sides that are one by the rules for interfaces, or within `weld`, the closest first."""
    found = overlaps(patches, glued, COINCIDENCE * diameter(patches))
    if weld > 0:
        found += overlaps(patches, glued, weld, OF_THICKNESS)
    return sorted(set(found))


def _too_thin(given: Sequence[Patch], patches: Sequence[Patch], origins: Sequence[int]) -> int | None:
    """A patch of which a piece is a sliver."""
    for patch, k in zip(patches, origins, strict=True):
        for own, whole in zip(patch.knots, given[k].knots, strict=True):
            if np.ptp(own) < THIN * np.ptp(whole):
                return k
    return None


def _two(f: Interface) -> str:
    return f"patch {f.patch_a} {f.side_a.name.lower()} and patch {f.patch_b} {f.side_b.name.lower()}"


def _cuts(
    patches: Sequence[Patch], interfaces: Sequence[Interface], found: Sequence[Overlap]
) -> dict[tuple[int, int], list[float]]:
    """Where patches are to be cut, by (patch, axis), in their own knots: through whole strips."""
    wanted: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for pair in found:
        if not pair.same_speed:
            continue
        for (k, side), ends in ((pair.a, pair.range_a), (pair.b, pair.range_b)):
            extent = float(np.ptp(side.of(patches[k].control_points), axis=0).max())
            uncertain = max(SAME_CUT, CUT_BY_GAP * pair.gap / extent)
            inner = [(uncertain, t) for t in ends if uncertain < t < 1 - uncertain]
            wanted.setdefault((k, side.axis), []).extend(inner)
    return along_strips(patches, interfaces, wanted, _distinct) if wanted else {}


def _distinct(wanted: list[tuple[float, float]], knots: Sequence[float]) -> list[float]:
    """Places of cuts, one where several are the same within their uncertainty: at a knot, or at the surest."""
    places: list[float] = []
    for uncertain, t in sorted(wanted):
        if all(abs(t - other) > uncertain for other in places):
            near = [s for s in knots if abs(s - t) <= uncertain]
            places.append(min(near, key=lambda s: abs(s - t)) if near else t)
    return places


def _cut_sentences(pieces: Pieces, cuts: dict[tuple[int, int], list[float]]) -> list[str]:
    notes = []
    for k in sorted({k for k, _ in cuts}):
        numbers = [str(new) for new, old in enumerate(pieces.origins) if old == k]
        lines = [f"{'uv'[a]} = {', '.join(f'{t:.6g}' for t in cuts[k, a])}" for a in (0, 1) if (k, a) in cuts]
        notes.append(f"patch {k} split at {' and '.join(lines)} into patches {', '.join(numbers)}")
    return notes
