"""Corners on an existing correspondence: pairs between anchors, and snapping."""

from __future__ import annotations

import numpy as np

from ..geometry.outline import Outline
from ..geometry.slivers import drawn_corners
from ..numeric.arrays import FloatArray, IntArray
from .sampled_boundary import image_of

__all__ = ["close_turn", "corners_between", "snap_corners"]

#: A source corner is moved onto a target corner within this fraction of the loop's length.
CORNER_SNAP = 2e-3
#: Corresponding corners turn by angles that differ by less than this.
CORNER_DIFFERENCE = np.radians(50.0)


def corners_between(anchors: FloatArray, source: Outline, target: Outline) -> FloatArray:
    """Add the corners between landmarks where both arcs have equally many, turning alike, in order."""
    s, turn_s, arc_s = _corners_inside(anchors[:, 0], source)
    if len(s) == 0:
        return anchors
    t, turn_t, arc_t = _corners_inside(anchors[:, 1], target)
    n = len(anchors) - 1
    equal = np.bincount(arc_s, minlength=n) == np.bincount(arc_t, minlength=n)
    i, j = np.flatnonzero(equal[arc_s]), np.flatnonzero(equal[arc_t])
    equal[arc_s[i[abs(turn_s[i] - turn_t[j]) >= CORNER_DIFFERENCE]]] = False
    i, j = i[equal[arc_s[i]]], j[equal[arc_t[j]]]
    rows = np.concatenate([anchors[:-1], np.column_stack([s[i], t[j]])])
    return close_turn(rows, source, target, anchors)


def _corners_inside(ends: FloatArray, outline: Outline) -> tuple[FloatArray, FloatArray, IntArray]:
    """Arc lengths, turning angles and arcs of the corners that are not next to an end of their arc, in order."""
    at, turn = drawn_corners(outline)
    if len(at) == 0:
        return at, turn, np.empty(0, np.int64)
    at = ends[0] + np.mod(at - ends[0], outline.length)
    order = np.argsort(at)
    at, turn = at[order], turn[order]
    arc = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(ends) - 2)
    near = CORNER_SNAP * outline.length
    inside = (at > ends[arc] + near) & (at < ends[arc + 1] - near)
    return at[inside], turn[inside], arc[inside]


def snap_corners(anchors: FloatArray, source: Outline, target: Outline) -> FloatArray:
    """Add anchors where a source corner lands next to a target corner that turns the same way.

    An anchor at the corner itself gives way to it: landmarks are known to that accuracy only.
    """
    s, turn_s = drawn_corners(source)
    t, turn_t = drawn_corners(target)
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
