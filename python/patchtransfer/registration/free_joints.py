"""Joints that nothing fixes go to the target's corners that no joint was matched to: a side cannot follow a corner."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.outline import Outline
from ..geometry.slivers import drawn_corners
from ..numeric.arrays import FloatArray, IntArray
from .corners import CORNER_SNAP, close_turn
from .sampled_boundary import cyclic_gap, image_of

__all__ = ["joints_to_corners", "warped"]

#: A joint moves by at most this part of the side's image that the corner lies on: a corner near the middle of a side
#: belongs to neither of its joints.
REACH = 0.4
#: A joint this near to a corner, relative to the loop's length, is at it.
AT_CORNER = 1e-9


def joints_to_corners(
    anchors: FloatArray,
    source: Outline,
    target: Outline,
    fixed: FloatArray,
    single: NDArray[np.bool_],
    crowded: float = 0.0,
) -> FloatArray:
    """Anchors with joints moved to corners, and what is between them along with them.

    A joint goes to the only such corner on one of its sides, the nearer one of two, unless it is at a corner already or
    fixed. One that a single patch fills goes to convex corners only.

    Parameters
    ----------
    anchors : (m + 1, 2) array
        See `LoopRegistration`.
    source, target : Outline
    fixed : (r,) array
        Arc lengths of points on the source that stay where they are: landmarks and matched corners.
    single : (n_joints,) array of bool
        Whether one patch alone meets the source's joint.
    crowded : float, default 0
        What part of a side's image a joint may move by to a corner that is not the only one there.
    """
    at, turn = drawn_corners(target)
    joints = source.joints[:-1]
    if len(at) == 0 or len(joints) < 2:
        return anchors
    image = image_of(anchors, joints)
    ends = np.append(image, image[0] + target.length)
    at = image[0] + np.mod(at - image[0], target.length)
    # A joint beside a corner leaves the corner's turn to its side as well.
    missed = cyclic_gap(at, np.mod(image, target.length), target.length) > AT_CORNER * target.length
    free = cyclic_gap(image, np.mod(at, target.length), target.length) > AT_CORNER * target.length
    if len(fixed):
        free &= cyclic_gap(joints, np.mod(fixed, source.length), source.length) > CORNER_SNAP * source.length
    moved = _moves(ends, at[missed], turn[missed], free, single, source.turn(joints), crowded)
    if not len(moved):
        return anchors
    k = moved[:, 0].astype(int)
    new = ends.copy()
    new[k] = moved[:, 1]
    new[-1] = new[0] + target.length
    return warped(anchors, source, target, ends, new, np.column_stack([joints[k], new[k]]))


def warped(
    anchors: FloatArray, source: Outline, target: Outline, old: FloatArray, new: FloatArray, pairs: FloatArray
) -> FloatArray:
    """Anchors with points of the target moved along it, and what is between two of them in its proportions.

    Parameters
    ----------
    anchors : (m + 1, 2) array
    source, target : Outline
    old, new : (n + 1,) arrays
        Arc lengths of the points, increasing over a full turn. If the new ones do not increase nothing is moved.
    pairs : (r, 2) array
        Pairs that become anchors themselves, in place of others next to them.
    """
    if (np.diff(new) <= 0).any():
        return anchors
    turns = np.floor((anchors[:, 1] - old[0]) / target.length)
    image = np.interp(anchors[:, 1] - turns * target.length, old, new) + turns * target.length
    rows = np.column_stack([anchors[:-1, 0], image[:-1]])
    apart = cyclic_gap(np.mod(rows[:, 0], source.length), pairs[:, 0], source.length) > CORNER_SNAP * source.length
    return close_turn(np.concatenate([rows[apart], pairs]), source, target, anchors)


def _moves(
    ends: FloatArray,
    at: FloatArray,
    turn: FloatArray,
    free: NDArray[np.bool_],
    single: NDArray[np.bool_],
    bend: FloatArray,
    crowded: float,
) -> FloatArray:
    """Rows (joint, place) of joints that go to corners; a joint that two corners want goes to the nearer one."""
    side: IntArray = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(ends) - 2)
    alone = np.bincount(side, minlength=len(ends) - 1)[side] == 1
    wanted: dict[int, tuple[float, float]] = {}
    for corner in range(len(at)):
        i, reach = int(side[corner]), REACH if alone[corner] else crowded
        length = ends[i + 1] - ends[i]
        for end in (i, i + 1):
            joint = end % (len(ends) - 1)
            distance = abs(at[corner] - ends[end])
            # Corners of the source turn as they do there; a reentrant corner needs two patches.
            alike = turn[corner] * bend[joint] >= 0 or abs(bend[joint]) < CORNER_SNAP
            if not free[joint] or not alike or (single[joint] and turn[corner] < 0) or distance > reach * length:
                continue
            place = at[corner] - (ends[end] - ends[joint])
            if joint not in wanted or distance < wanted[joint][0]:
                wanted[joint] = distance, place
    # One joint a corner: the nearer one.
    taken: dict[float, int] = {}
    for joint, (distance, place) in wanted.items():
        key = round(float(np.mod(place, ends[-1] - ends[0])), 12)
        if key not in taken or distance < wanted[taken[key]][0]:
            taken[key] = joint
    return np.array([[joint, wanted[joint][1]] for joint in taken.values()]).reshape(-1, 2)
