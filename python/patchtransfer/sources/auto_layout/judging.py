"""Layouts judged by what comes of them: the certified patches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.outline import Outline
from ...pipeline.result import TransferResult
from .assembly import AbstractLayout

__all__ = ["Candidate", "score", "unmet"]

#: Mean scaled Jacobian that a patch more has to bring.
PATCH = {"few": 3.5e-3, "quality": 1e-3}
#: Weight of the minimum beside the mean, and the part of what the outline's corners allow that is enough: a minimum
#: beyond it buys no patches.
MINIMUM = 0.3
ENOUGH = {"few": 0.85, "quality": 1.0}
#: Price of a boundary error beyond the tolerance, and of every part of the diameter that it is beyond: one that meets
#: the outline is taken first, whatever its angles.
MISSED, MISS = 0.5, 20.0
#: A corner where a patch degenerates although the outline is smooth there is worse than any angle.
DEGENERATE = 1.0


@dataclass(frozen=True, eq=False)
class Candidate:
    """A layout that was tried.

    Attributes
    ----------
    layout : AbstractLayout
    origin : str
        How it came about.
    result : TransferResult or None
        Its patches.
    score : float
        To compare; the larger the better.
    reason : str or None
        Why it cannot be taken.
    """

    layout: AbstractLayout
    origin: str
    result: TransferResult | None
    score: float
    reason: str | None = None

    def to_dict(self) -> dict[str, object]:
        """For the report."""
        quality = None if self.result is None else self.result.quality.scaled_jacobian
        return {
            "patches": len(self.layout.quads),
            "origin": self.origin,
            "status": None if self.result is None else self.result.certificate.status,
            "scaled_jacobian": None if quality is None else {"min": quality.min, "mean": quality.mean},
            "corner_bound": None if self.result is None else self.result.corner_bound,
            "boundary_error": None if self.result is None else self.result.boundary_error,
            "score": self.score if self.reason is None else None,
            "reason": self.reason,
        }


def score(result: TransferResult, prefer: str, outlines: Sequence[Outline], fit_tolerance: float) -> float:
    """How good a certified result is: mean and minimum scaled Jacobian, few patches, a boundary that is met."""
    quality, patches = result.quality.scaled_jacobian, len(result.multipatch.patches)
    enough = ENOUGH[prefer] * _attainable(outlines)
    minimum = min(1.0, quality.min / enough) if enough > 0 else 0.0
    beyond = result.boundary_error - fit_tolerance
    miss = MISSED + MISS * beyond if beyond > 0 else 0.0
    degenerate = DEGENERATE if result.certificate.status != "certified" else 0.0
    return float(quality.mean + MINIMUM * minimum - PATCH[prefer] * patches - miss - degenerate)


def _attainable(outlines: Sequence[Outline]) -> float:
    """The least scaled Jacobian that the corners of an outline allow, whatever the numbers of patches there.

    Of k patches at an angle α one has at most sin(α / k). A layout's own bound would flatter those with bad numbers.
    """
    outer = int(np.argmax([abs(outline.area) for outline in outlines]))
    best = 1.0
    for k, outline in enumerate(outlines):
        left = (outline.area > 0) == (k == outer)
        turn = outline.turn(outline.corners[0])
        angle = np.pi - (turn if left else -turn)
        shares = np.sin(angle[:, None] / np.arange(1, 5))
        best = min([best, *shares.max(axis=1).tolist()])
    return best


def unmet(
    layout: AbstractLayout,
    outlines: Sequence[Outline],
    max_patches: int | None,
    corner_patches: Mapping[tuple[int, int], int] | None,
) -> str | None:
    """Which demand of the user a layout does not meet: merged singularities and convex pieces know of none."""
    patches = len(layout.quads)
    if max_patches is not None and patches > max_patches:
        return f"{patches} patches where max_patches is {max_patches}; allow more"
    for (loop, rank), wanted in (corner_patches or {}).items():
        outline = outlines[loop]
        on = np.flatnonzero(layout.boundary_loop == loop)
        away = abs(layout.boundary_s[on] - outline.corners[0][rank])
        v = layout.boundary_vertices[on[np.argmin(np.minimum(away, outline.length - away))]]
        if layout.valence[v] != wanted:
            return f"{layout.valence[v]} patches at corner {rank} of loop {loop} where corner_patches is {wanted}"
    return None
