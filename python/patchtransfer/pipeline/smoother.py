"""A source with more knots where interfaces are not C1, and what is said of the share that is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..fitting.refinement import Knot
from ..geometry.multipatch import MultiPatch
from ..measure.smooth_spans import InterfaceSpans, c1_share, obstacles, smooth_spans

__all__ = ["LOW_SHARE", "blocked_note", "low_share_note", "rough_middles", "share_of", "smoother_note"]

#: Below this share of C1 a transfer says so.
LOW_SHARE = 0.5
#: Obstacles that a message names.
NAMED = 3


def share_of(mp: MultiPatch) -> float:
    """The part of the interfaces' length that is C1."""
    return c1_share(smooth_spans(mp))


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


def smoother_note(knots: int, before: MultiPatch, after: MultiPatch, share: float) -> str:
    """That knots were inserted for smoothness."""
    return (
        f"the source was refined for C1 across patches: knots in {knots} spans of interfaces and the strips of patches "
        f"behind them, {before.topology.n_points} -> {after.topology.n_points} control points; C1 on {share:.2f} of "
        "the interfaces' length"
    )


def blocked_note(wanted: float, mp: MultiPatch, why: str) -> str:
    """That the share was not reached, and what stops it."""
    spans = smooth_spans(mp)
    return (
        f"c1_share={wanted:g} is not reached: C1 on {c1_share(spans):.2f} of the interfaces' length; not at "
        f"{_places(spans)}; {why}"
    )


def low_share_note(mp: MultiPatch) -> str | None:
    """That little is C1, and the option that helps; None where half of it and more is."""
    spans = smooth_spans(mp)
    share = c1_share(spans)
    if share >= LOW_SHARE:
        return None
    return (
        f"C1 across patches holds on {share:.2f} of the interfaces' length only, not at {_places(spans)}: "
        "c1_share=0.9 (--c1-share 0.9) inserts knots until it holds on 0.9"
    )


def _places(spans: Sequence[InterfaceSpans]) -> str:
    return ", ".join(f"{reason} ({part:.2g})" for reason, part in list(obstacles(spans).items())[:NAMED])
