"""Landmarks: pairs of corresponding boundary points, read, placed on the loops and checked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..geometry.outline import Outline
from ..numeric.arrays import FloatArray, frozen_array

__all__ = ["landmark_anchors", "pair_by_landmarks", "place_landmarks", "read_landmark_rows"]

#: Landmarks, and handles of a deformation, farther from the boundary than this fraction of the diameter are refused.
SNAP_DISTANCE = 0.01
#: Landmarks closer than this fraction of the loop are the same point.
SAME_POINT = 1e-9


def read_landmark_rows(landmarks: ArrayLike | None) -> FloatArray:
    """Landmark rows (r, 4), r = 0 for None, also from pairs of points; `InputError` on another shape, NaN or text."""
    if landmarks is None:
        return np.empty((0, 4))
    rows = frozen_array(landmarks, "landmarks")
    if rows.size == 0:
        return np.empty((0, 4))
    if rows.shape[1:] not in ((4,), (2, 2)):
        raise InputError(
            "landmarks must have shape (r, 4) = xs, ys, xt, yt, or be pairs (source point, target point), got "
            f"{rows.shape}"
        )
    return rows.reshape(-1, 4)


def place_landmarks(rows: FloatArray, source: Sequence[Outline], target: Sequence[Outline]) -> NDArray[np.void]:
    """Loop and arc length of every landmark on both boundaries; `row` keeps the number for messages."""
    kind = np.dtype([("row", int), ("source_loop", int), ("s", float), ("target_loop", int), ("t", float)])
    placed = np.zeros(len(rows), kind)
    placed["row"] = np.arange(len(rows))
    for name, outlines, loop, at, columns in (
        ("source", source, "source_loop", "s", slice(0, 2)),
        ("target", target, "target_loop", "t", slice(2, 4)),
    ):
        if len(rows) == 0:
            break
        diameter = outlines[0].diameter
        found = [outline.nearest(rows[:, columns]) for outline in outlines]
        distance = np.array([d for _, d in found])
        best = distance.argmin(axis=0)
        worst = int(distance.min(axis=0).argmax())
        if distance[best[worst], worst] > SNAP_DISTANCE * diameter:
            raise InputError(
                f"landmark row {worst + 1}: ({rows[worst, columns][0]:g}, {rows[worst, columns][1]:g}) is "
                f"{distance[best[worst], worst]:.3g} off the {name} boundary (allowed: {SNAP_DISTANCE:.0%} of the "
                f"diameter, {SNAP_DISTANCE * diameter:.3g}); check the coordinates and the columns xs,ys,xt,yt"
            )
        placed[loop] = best
        placed[at] = np.array([s for s, _ in found])[best, np.arange(len(rows))]
    return placed


def pair_by_landmarks(placed: NDArray[np.void]) -> dict[int, int]:
    """Target loop of every source loop that landmarks pair, and of the outer loop."""
    partner = {0: 0}
    for row, k, t in placed[["row", "source_loop", "target_loop"]].tolist():
        if partner.setdefault(k, t) != t or any(other != k and partner[other] == t for other in partner):
            raise InputError(
                f"landmark row {row + 1} pairs source loop {k} with target loop {t}, other rows (or the "
                "outer loops) pair them differently; a loop has one partner"
            )
    return partner


def landmark_anchors(placed: NDArray[np.void], source: Outline, target: Outline, loop: int) -> FloatArray:
    """Sorted landmark positions on a loop, a full turn; `InputError` when their order is reversed or crossing."""
    placed = placed[np.argsort(placed["s"], kind="stable")]
    s, t = placed["s"], placed["t"]
    t = t[0] + np.mod(t - t[0], target.length)
    anchors = np.column_stack([np.append(s, s[0] + source.length), np.append(t, t[0] + target.length)])
    steps = anchors[1:] - anchors[:-1]
    if (steps > SAME_POINT * np.array([source.length, target.length])).all():
        return anchors
    _raise_disorder(s, t, placed["row"] + 1, source, target, loop)
    return anchors


def _raise_disorder(
    s: FloatArray, t: FloatArray, row: NDArray[np.int64], source: Outline, target: Outline, loop: int
) -> None:
    """Raise `InputError` naming the rows that are one point, run backwards or cross."""
    for where, position, length in (("source", s, source.length), ("target", t, target.length)):
        around = np.mod(position, length)
        order = np.argsort(around, kind="stable")
        # The gap from the last to the first counts too: rounding puts a loop's start at either end.
        gaps = np.diff(around[order], append=around[order[0]] + length)
        if len(gaps) > 1 and gaps.min() <= SAME_POINT * length:
            i = int(gaps.argmin())
            first, second = sorted((int(row[order[i]]), int(row[order[(i + 1) % len(order)]])))
            raise InputError(
                f"landmark rows {first} and {second} are the same point of the {where} boundary (loop {loop}); "
                "remove one"
            )
    if len(s) > 2 and (np.diff(np.roll(t, -1)[:-1]) < 0).all():
        raise InputError(
            f"landmark rows {', '.join(map(str, row))} run backwards along target loop {loop}: the target is a mirror "
            "image of the source; --mirror auto (mirror='auto') mirrors the source for it"
        )
    for i in range(1, len(s)):
        if t[i] < t[i - 1]:
            raise InputError(
                f"landmark rows {row[i - 1]} and {row[i]} cross: along loop {loop} they come in one order on the "
                "source and in the other on the target"
            )
