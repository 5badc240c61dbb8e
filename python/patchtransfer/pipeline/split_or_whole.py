"""Of two results, one with the source split and one with the source as it is: which to take, and what to say."""

from __future__ import annotations

from collections.abc import Sequence

from .result import TransferResult, corners_in_words

__all__ = ["better", "split_note", "vain_note"]


def better(split: TransferResult, whole: TransferResult) -> bool:
    """Whether the split source has done better: certified first, then on the target, then nearer to it."""

    def rank(result: TransferResult) -> tuple[bool, bool, float]:
        certified = result.certificate.injective
        return certified, not result.missed, -result.boundary_error if certified else 0.0

    return rank(split) > rank(whole)


def split_note(corners: Sequence[tuple[float, float]], before: int, after: int) -> str:
    """What splitting has done."""
    return f"the source was split, {before} -> {after} patches, {_at(corners)}"


def vain_note(corners: Sequence[tuple[float, float]], split: TransferResult) -> str:
    """Why a split was given up."""
    reached = "misses the target more" if split.certificate.injective else "has no certified map"
    return f"splitting the source {_at(corners)} was given up: the split source {reached} ({split.certificate.status})"


def _at(corners: Sequence[tuple[float, float]]) -> str:
    if not corners:
        return "where other targets need it"
    return f"at {corners_in_words(corners)} of the target"
