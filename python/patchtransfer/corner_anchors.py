"""Corners on an existing correspondence: pairs between anchors, snapping, and corners that nothing is matched to."""

from __future__ import annotations

import itertools

import numpy as np

from .boundary_shape import corners, cyclic_gap, image_of
from .outline import Outline
from .splines import FloatArray

__all__ = ["close_turn", "corners_between", "missed_corners", "snap_corners"]

#: A source corner is moved onto a target corner within this fraction of the loop's length.
CORNER_SNAP = 2e-3
#: Corresponding corners turn by angles that differ by less than this.
CORNER_DIFFERENCE = np.radians(50.0)
#: Corners listed in warnings for each loop.
MAX_WARNINGS = 5


def corners_between(anchors: FloatArray, source: Outline, target: Outline) -> FloatArray:
    """Add the corners between landmarks where both arcs have equally many, turning alike, in order."""
    (s, turn_s), (t, turn_t) = corners(source), corners(target)
    rows = [anchors[:1]]
    for (s0, t0), (s1, t1) in itertools.pairwise(anchors):
        at_s, at_t = s0 + np.mod(s - s0, source.length), t0 + np.mod(t - t0, target.length)
        near_s, near_t = CORNER_SNAP * source.length, CORNER_SNAP * target.length
        inside_s = np.flatnonzero((at_s > s0 + near_s) & (at_s < s1 - near_s))
        inside_t = np.flatnonzero((at_t > t0 + near_t) & (at_t < t1 - near_t))
        i, j = inside_s[np.argsort(at_s[inside_s])], inside_t[np.argsort(at_t[inside_t])]
        if len(i) == len(j) and (abs(turn_s[i] - turn_t[j]) < CORNER_DIFFERENCE).all():
            rows.append(np.column_stack([at_s[i], at_t[j]]))
        rows.append(np.array([[s1, t1]]))
    return close_turn(np.concatenate(rows)[:-1], source, target, anchors)


def missed_corners(target: Outline, joints: FloatArray, k: int) -> list[str]:
    """Warnings on target corners off the images of the source's joints: its sides cannot follow them."""
    at, _ = corners(target)
    gap = cyclic_gap(at, np.mod(joints[:-1], target.length), target.length)
    missed = target.point(at[gap > CORNER_SNAP * target.length])
    return [
        f"boundary loop {k}: the target has a corner at ({x:.6g}, {y:.6g}) that no joint of the source is matched "
        "to; it will be rounded off (a landmark there helps if the source has such a corner)"
        for x, y in missed[:MAX_WARNINGS]
    ]


def snap_corners(anchors: FloatArray, source: Outline, target: Outline) -> FloatArray:
    """Add anchors where a source corner lands next to a target corner that turns the same way.

    An anchor at the corner itself gives way to it: landmarks are known to that accuracy only.
    """
    s, turn_s = corners(source)
    t, turn_t = corners(target)
    if len(s) == 0 or len(t) == 0:
        return anchors
    image = image_of(anchors, s)
    offset = t[None] - image[:, None]
    offset -= np.round(offset / target.length) * target.length
    offset[turn_s[:, None] * turn_t[None] < 0] = np.inf
    nearest = abs(offset).argmin(axis=1)
    shift = offset[np.arange(len(s)), nearest]
    close = abs(shift) < CORNER_SNAP * target.length
    rows = anchors[:-1]
    new = np.column_stack([s[close], (image + shift)[close]])
    # The anchor at the corner itself gives way to the corner.
    gap = abs(rows[:, None, 0] - new[None, :, 0]) if len(new) else np.full((len(rows), 1), np.inf)
    gap = np.minimum(gap, source.length - gap)
    merged = np.concatenate([rows[(gap > CORNER_SNAP * source.length).all(axis=1)], new])
    if len(merged) == 0:
        return anchors
    return close_turn(merged, source, target, anchors)


def close_turn(rows: FloatArray, source: Outline, target: Outline, fallback: FloatArray) -> FloatArray:
    """Sort anchors by source arc length and close the turn; `fallback` if the targets do not increase."""
    turns = np.floor(rows[:, 0] / source.length)
    rows = rows - np.outer(turns, [source.length, target.length])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    closed = np.concatenate([rows, rows[:1] + np.array([source.length, target.length])])
    if (np.diff(closed[:, 0]) <= 0).any() or (np.diff(closed[:, 1]) <= 0).any():
        return fallback
    return closed
