"""Of two results, one with the source split and one with the source as it is: which to take, and what to say."""

from __future__ import annotations

from collections.abc import Sequence

from .divisions import SourceSplit
from .result import NAMED, TransferResult, corners_in_words

__all__ = ["better", "split_note", "vain_note"]


def better(split: TransferResult, whole: TransferResult) -> bool:
    """Whether the split source has done better: certified first, then on the target, then nearer to it."""

    def rank(result: TransferResult) -> tuple[bool, bool, float]:
        certified = result.certificate.injective
        return certified, not result.missed, -result.boundary_error if certified else 0.0

    return rank(split) > rank(whole)


def split_note(split: SourceSplit, handed: Sequence[tuple[float, float]], after: int) -> str:
    """What splitting has done: to `after` patches, with joints handed to corners of the target."""
    before = len({origin.patch for origin in split.origin}) + len(split.dropped)
    told = [f"the source was split, {before} -> {after} patches"]
    if handed or not (split.opened or split.dropped):
        told[0] += f", {_at(handed)}"
    if split.dropped:
        told.append(f"left out is what the target lacks, {_listed('patch', [str(k) for k in split.dropped])}")
    if split.opened:
        corners = _listed("corner", [f"{corner} of patch {patch}" for patch, corner in split.opened])
        told.append(f"two patches meet where {corners} would lie on a smooth place")
    return "; ".join(told)


def _listed(what: str, names: Sequence[str]) -> str:
    """Some of them, the first by name."""
    plural = {"patch": "patches", "corner": "corners"}[what] if len(names) > 1 else what
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{plural} {', '.join(names[:NAMED])}{more}"


def vain_note(split: TransferResult) -> str:
    """Why a split was given up."""
    reached = "misses the target more" if split.certificate.injective else "has no certified map"
    corners = () if split.split is None else split.split.corners
    return f"splitting the source {_at(corners)} was given up: the split source {reached} ({split.certificate.status})"


def _at(corners: Sequence[tuple[float, float]]) -> str:
    if not corners:
        return "where other targets or smooth places need it"
    return f"at {corners_in_words(corners)} of the target"
