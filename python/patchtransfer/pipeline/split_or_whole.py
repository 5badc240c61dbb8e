"""The source split for a target, or as it is: what is tried, which result is taken, and what to say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Protocol, Self

from numpy.typing import ArrayLike

from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..registration.lacking_joints import LackingJoint, lacking_joints
from .divisions import Division, SourceSplit, without
from .opening import smooth_corners, superfluous_ears
from .options import Run
from .posed import Registered
from .result import NAMED, TransferResult, corners_in_words
from .source_boundary import SourceBoundary

__all__ = ["split_or_whole"]

#: Part of the work for a source that was divided for its target, where another way to divide it, or none, comes after,
#: and for the source as it is.
DIVIDED, WHOLE = 0.4, 0.5


class Divisible(Protocol):
    """What of a `TransferPlan` is needed here."""

    source: MultiPatch
    split: SourceSplit | None
    reference: Sequence[Patch] | None
    _welded: MultiPatch
    _boundary: SourceBoundary

    def _searched(self, registered: Registered, landmarks: ArrayLike | None, run: Run) -> TransferResult: ...
    def _with_near_joints_moved(self, registered: Registered) -> Registered: ...
    def _onto_split(self, registered: Registered, run: Run) -> Registered: ...
    def _split(self, lacking: Sequence[Sequence[LackingJoint]]) -> Self: ...
    def _opened(self, corners: Sequence[tuple[int, int]]) -> Self: ...
    def _divided(self, division: Division | None) -> Self: ...


def split_or_whole(plan: Divisible, registered: Registered, landmarks: ArrayLike | None, run: Run) -> TransferResult:
    """The result with joints at all corners of the target, and no corner of a patch on a smooth place of it.

    Without, where that does better.
    """
    near = plan._with_near_joints_moved(registered)
    best: TransferResult | None = None
    # Joints that may not be moved to corners near by leave these to cuts.
    for start in (near,) if near is registered else (near, registered):
        for divided, posed in _divisions(plan, start, run):
            if divided is plan and start is registered:
                continue
            split = divided._searched(posed, landmarks, run.part(DIVIDED))
            if divided.split is not None and divided is not plan:
                split = split.with_warnings([split_note(divided.split, posed.handed, len(divided.source))])
            if split.succeeded:
                return split
            best = split if best is None or better(split, best) else best
    if best is None:
        return plan._searched(registered, landmarks, run)
    as_it_is = replace(run.part(WHOLE), options=replace(run.options, split="never"))
    whole = plan._searched(registered, landmarks, as_it_is)
    if better(best, whole):
        return best
    return replace(whole.with_warnings([vain_note(best)]), split_in_vain=True)


def _divisions(whole: Divisible, start: Registered, run: Run) -> Iterator[tuple[Divisible, Registered]]:
    """Plans for the source split for one target, and the correspondence: the best, then those that do less."""
    plan = whole._split([lacking_joints(start.registration, run.options.fit_tolerance)])
    posed = start if plan is whole else plan._onto_split(start, run)
    bare, onto = plan, posed
    while gone := superfluous_ears(onto.registration, bare._welded, bare._boundary.valence):
        bare = bare._divided(without(bare._welded, bare.reference, gone))
        onto = bare._onto_split(onto, run)
    fanned = bare._opened(smooth_corners(onto.registration, bare._welded.topology, bare._boundary.single))
    if fanned is not bare:
        yield fanned, fanned._onto_split(onto, run)
    if bare is not plan:
        yield bare, onto
    yield plan, posed


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
