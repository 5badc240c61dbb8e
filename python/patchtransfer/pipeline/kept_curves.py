"""Sides that are the target's own curves, or joints where shapes match: which of the two results is taken."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike

from .options import Run
from .posed import Registered
from .result import TransferResult

__all__ = ["kept_or_loose"]

#: Part of the work for the target's own curves, where joints may have to be placed otherwise after that.
KEPT = 0.5
LOOSE = (
    "sides are not the target's own curves, though they have their degree, knots and weights: with joints at the "
    "curves' ends no certified map was found"
)


def kept_or_loose(
    search: Callable[[Registered, ArrayLike | None, Run], TransferResult],
    registered: Registered,
    landmarks: ArrayLike | None,
    run: Run,
) -> TransferResult:
    """The result with the target's own curves, if there are any; without where only that is certified."""
    if registered.loose is None:
        return search(registered, landmarks, run)
    kept = search(registered, landmarks, run.part(KEPT))
    if kept.certificate.injective or run.budget.expired():
        return kept
    loose = search(registered._replace(registration=registered.loose, loose=None), landmarks, run)
    return loose.with_warnings([LOOSE]) if loose.certificate.injective else kept
