"""A source with more knots where interfaces are not C1, and what is said of the share that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..fitting.refinement import Knot
from ..geometry.multipatch import MultiPatch
from ..measure.smooth_spans import InterfaceSpans, c1_share, obstacles, share_of, smooth_spans
from .inside import SLID_BACK, SLID_BACK_FOR_DILATATION, attempt
from .options import Run
from .refined import Finer, finer, refined_note
from .result import TransferResult

__all__ = ["rough_middles", "smoothed"]

#: Below this share of C1 a transfer says so.
LOW_SHARE = 0.5
#: Obstacles that a message names.
NAMED = 3
#: Rounds of knot insertion at most; each halves spans that are not C1.
ROUNDS = 8


def rough_middles(mp: MultiPatch, wanted: float) -> list[Knot]:
    """Knots that halve spans that are not C1, the longest first, as many as the wanted share may need.

    Half a span becomes C1, for what stops it lies at one of its ends.
    """
    interfaces = smooth_spans(mp)
    total = sum(float(spans.lengths.sum()) for spans in interfaces)
    rough = [
        (float(spans.lengths[k]), index, k)
        for index, spans in enumerate(interfaces)
        if spans.lowest_degree > 1
        for k in np.flatnonzero(~spans.smooth).tolist()
    ]
    lacking = (wanted - c1_share(interfaces)) * total
    knots: list[Knot] = []
    for length, index, k in sorted(rough, key=lambda entry: (-entry[0], *entry[1:])):
        if lacking <= 0:
            break
        lacking -= length / 2
        f, breaks = mp.interfaces[index], interfaces[index].breaks
        knots.append((f.patch_a, f.side_a.axis, float(breaks[k] + breaks[k + 1]) / 2))
    return knots


def smoothed(result: TransferResult, now: Finer, run: Run) -> TransferResult:
    """Insert knots where interfaces are not C1, until as much of them is as was asked for, and say so.

    The boundary stays: nothing is fitted or slid anew. Without such a wish it is only said where little is C1.
    """
    wanted = run.options.c1_share
    if wanted is None:
        return result.with_warnings(_low_share_note(result.multipatch))
    best, count, why = result, 0, f"{ROUNDS} rounds of knots did not suffice"
    for _ in range(ROUNDS):
        if share_of(best.multipatch) >= wanted:
            break
        with run.clock("refinement") as stage:
            knots = rough_middles(best.multipatch, wanted)
            if not knots or run.budget.expired():
                why = "patches of degree 1 have no rows" if not knots else "the search was ended"
                break
            now = now.refine(knots, now.registered._replace(registration=best.registration))
            target, _ = finer(best.multipatch, None, knots, 1)
            stage.found = f"{len(knots)} spans of interfaces halved, {target.topology.n_points} control points"
        fitted = best.fitted.with_curves(now.boundary.curves(target.topology.coordinates))
        found = attempt(now.registered, fitted, [], now.boundary, now.interior, run, legs=False)
        if not found.certificate.injective:
            why = "with more knots no certified map was found"
            break
        best, count = replace(found, sliding=best.sliding), count + len(knots)
    share = share_of(best.multipatch)
    # What was said of joints is still so; all else is said anew of the finer map.
    notes = [text for text in result.warnings if count and text in (SLID_BACK, SLID_BACK_FOR_DILATATION)]
    if count:
        note = refined_note(
            f"for C1 across patches, knots in {count} spans of interfaces", result.multipatch, best.multipatch
        )
        notes.append(f"{note}; C1 on {share:.2f} of the interfaces' length")
    if share < wanted:
        notes.append(
            f"c1_share={wanted:g} is not reached: C1 on {share:.2f} of the interfaces' length; not at "
            f"{_places(smooth_spans(best.multipatch))}; {why}"
        )
    return best.with_warnings(notes)


def _low_share_note(mp: MultiPatch) -> list[str]:
    """That little is C1, and the option that helps."""
    share = share_of(mp)
    if share >= LOW_SHARE:
        return []
    spans = smooth_spans(mp)
    return [
        f"C1 across patches holds on {share:.2f} of the interfaces' length only, not at {_places(spans)}: "
        "c1_share=0.9 (--c1-share 0.9) inserts knots until it holds on 0.9"
    ]


def _places(spans: Sequence[InterfaceSpans]) -> str:
    return ", ".join(f"{reason} ({part:.2g})" for reason, part in list(obstacles(spans).items())[:NAMED])
