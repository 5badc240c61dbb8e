"""The correspondence of a source that was divided for its target: as it was, with the joints that cuts have made."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..geometry.curve import BSplineCurve
from ..geometry.outline import Outline
from ..geometry.splitting import Cuts, Origin, SplitModel
from ..geometry.topology import BoundarySide
from ..numeric.arrays import FloatArray, among
from ..registration.free_joints import joints_to_corners, warped
from ..registration.lacking_joints import LackingJoint, lacking_joints
from ..registration.register import LoopRegistration, Registration
from ..registration.same_curves import as_side
from ..registration.with_loops import with_loops
from .divisions import Division

__all__ = ["onto_split", "with_near_joints_moved"]

#: A free joint nearer to a corner than this part of its side moves there: no cut is needed.
NEAR_JOINT = 0.15
#: Joints that were made for other targets are not handed to corners farther away than this part of a side.
FARTHEST = 0.5
#: Arc lengths that differ by less than this part of the loop are one.
SAME_PLACE = 1e-9


def with_near_joints_moved(registration: Registration, single: Sequence[Sequence[bool]]) -> Registration:
    """The correspondence with free joints moved to corners near by, where several corners share a side, too.

    The same object if there are none.
    """
    loops = []
    for loop, alone in zip(registration.loops, single, strict=True):
        anchors = joints_to_corners(
            loop.anchors, loop.source, loop.target, loop.features[:, 0], np.asarray(alone, bool), NEAR_JOINT
        )
        loops.append(loop if anchors is loop.anchors else replace(loop, anchors=anchors))
    same = all(a is b for a, b in zip(loops, registration.loops, strict=True))
    return registration if same else with_loops(registration, loops)


def onto_split(
    registration: Registration, tolerance: float, division: Division, outlines: Sequence[Outline]
) -> Registration:
    """The same correspondence with a split source: corners without joints get those that the cuts have made.

    Parameters
    ----------
    registration : Registration
        With the source as it was.
    tolerance : float
        See `lacking_joints`.
    division : Division
    outlines : sequence of Outline
        Of the split source, loop by loop.
    """
    before, cuts, split = division[:3]
    lacking: dict[int, list[LackingJoint]] = defaultdict(list)
    for corner in lacking_joints(registration, tolerance):
        lacking[corner.loop].append(corner)
    whole = {part: side for side, own in split.parts.items() for part in own}
    place = {(side.patch, side.side): (k, i) for k, loop in enumerate(before.loops) for i, side in enumerate(loop)}
    loops = []
    for sides, outline in zip(split.multipatch.topology.loops, outlines, strict=True):
        places = [place.get(whole.get((part.patch, part.side), (-1, part.side))) for part in sides]
        k = next(at[0] for at in places if at is not None)
        loop = registration.loops[k]
        pairs = _pairs(loop, before.loops[k], cuts, lacking[k])
        anchors = _with_pairs(loop, pairs)
        features = np.concatenate([loop.features, pairs])
        starts = [
            _start(loop.source, at[1], before.loops[k][at[1]], part, split.origin[part.patch])
            if at is not None
            else _joint_at(loop.source, outline.curves[j].start)
            for j, (part, at) in enumerate(zip(sides, places, strict=True))
        ]
        moved = _moved(replace(loop, anchors=anchors, features=features), np.array(starts), outline)
        own = [
            None if at is None or not loop.own else _own(loop, at[1], before.loops[k][at[1]], part, split, curve)
            for part, at, curve in zip(sides, places, outline.curves, strict=True)
        ]
        moved = replace(moved, own=tuple(own) if any(curve is not None for curve in own) else ())
        loops.append(_evened(moved, [j for j, at in enumerate(places) if at is None]))
    return with_loops(registration, loops)


def _pairs(
    loop: LoopRegistration, sides: Sequence[BoundarySide], cuts: Cuts, lacking: Sequence[LackingJoint]
) -> FloatArray:
    """Arc lengths (source, target) of cuts and the corners that they are for, side by side in order."""
    pairs = []
    for i in sorted({corner.side for corner in lacking}):
        corners = [corner for corner in lacking if corner.side == i]
        side, curve = sides[i], loop.source.curves[i]
        at = np.array(cuts.get((side.patch, side.side.axis), ()))
        # A reversed curve has its knots mirrored in its domain.
        at = sum(curve.domain) - at[::-1] if side.reversed else at
        # The sharpest ones, where there are not enough joints.
        sharp = sorted(sorted(corners, key=lambda c: -abs(c.turn))[: len(at)], key=lambda c: c.parameter)
        chosen = _in_order(np.array([corner.parameter for corner in sharp]), at)
        s = loop.source.arc_length(i, at[chosen])
        far = FARTHEST * (curve.domain[1] - curve.domain[0])
        pairs += [
            (float(x), corner.at)
            for x, t, corner in zip(s, at[chosen], sharp, strict=True)
            if abs(t - corner.parameter) <= far
        ]
    return np.array(pairs).reshape(-1, 2)


def _in_order(wanted: FloatArray, offered: FloatArray) -> NDArray[np.int64]:
    """Indices of offered places for the wanted ones, both increasing, that are nearest in sum."""
    n, m = len(wanted), len(offered)
    cost = np.zeros((n + 1, m + 1))
    cost[1:, 0] = np.inf
    for i in range(n):
        for j in range(m):
            cost[i + 1, j + 1] = min(cost[i + 1, j], cost[i, j] + abs(wanted[i] - offered[j]))
    chosen = np.empty(n, np.int64)
    i, j = n, m
    while i > 0:
        if cost[i, j] < cost[i, j - 1]:
            i -= 1
            chosen[i] = j - 1
        j -= 1
    return chosen


def _with_pairs(loop: LoopRegistration, pairs: FloatArray) -> FloatArray:
    """Anchors with these pairs, all joints where they are, and what is between them in its proportions."""
    if not len(pairs):
        return loop.anchors
    joints = loop.source.joints[:-1]
    images = loop.joints
    at = images[0] + np.mod(pairs[:, 1] - images[0], loop.target.length)
    rows = np.concatenate([np.column_stack([joints, images[:-1]]), np.column_stack([pairs[:, 0], at])])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    closing = rows[0, 1] + loop.target.length
    old = np.append(loop.to_target(rows[:, 0]), closing)
    return warped(loop.anchors, loop.source, loop.target, old, np.append(rows[:, 1], closing), rows)


def _start(outline: Outline, i: int, side: BoundarySide, part: BoundarySide, origin: Origin) -> float:
    """Arc length, on the outline as it was, where a side of the split outline starts."""
    return float(outline.arc_length(i, np.array(_range(outline.curves[i], side, part, origin)[:1]))[0])


def _range(curve: BSplineCurve, side: BoundarySide, part: BoundarySide, origin: Origin) -> tuple[float, float]:
    """The parameters of a side's curve between which a side of the split outline is."""
    low, high = (origin.u, origin.v)[part.side.axis]
    return (sum(curve.domain) - high, sum(curve.domain) - low) if side.reversed else (low, high)


def _own(
    loop: LoopRegistration, i: int, side: BoundarySide, part: BoundarySide, split: SplitModel, curve: BSplineCurve
) -> BSplineCurve | None:
    """The part of a side's own curve that is on a side of the split outline."""
    own = loop.own[i]
    return None if own is None else as_side(own.restrict(*_range(own, side, part, split.origin[part.patch])), curve)


def _joint_at(outline: Outline, point: FloatArray) -> float:
    """Arc length of the joint at a point."""
    starts = np.array([curve.start for curve in outline.curves])
    return float(outline.joints[int(np.hypot(*(starts - point).T).argmin())])


def _evened(loop: LoopRegistration, sides: Sequence[int]) -> LoopRegistration:
    """The correspondence in even proportions along sides that were laid bare: what was matched there is gone."""
    if not sides:
        return loop
    joints = loop.source.joints
    side = np.searchsorted(joints, loop.anchors[:, 0], side="right") - 1
    gone = among(side, sides) & ~among(loop.anchors[:, 0], joints)
    rows = np.concatenate([loop.anchors[~gone], np.column_stack([joints, loop.joints])])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return replace(loop, anchors=rows[np.diff(rows[:, 0], prepend=-1.0) > 0])


def _moved(loop: LoopRegistration, starts: FloatArray, outline: Outline) -> LoopRegistration:
    """The correspondence of a loop with an outline of the same curve that starts elsewhere and has more joints.

    `starts` are where its sides start on the loop as it is. Arc lengths in the middle of curves are approximate, so it
    takes all of them.
    """
    length = loop.source.length
    joints = np.append(starts[0] + np.mod(starts - starts[0], length), starts[0] + length)

    def shifted(rows: FloatArray) -> FloatArray:
        turns, s = np.divmod(rows[:, 0] - starts[0], length)
        # A joint is at its very arc length, and the last one is the first.
        gap = abs(starts[0] + s[:, None] - joints)
        nearest = gap.argmin(axis=1)
        at_joint = gap.min(axis=1) < SAME_PLACE * length
        s = np.where(at_joint, outline.joints[nearest], np.interp(starts[0] + s, joints, outline.joints))
        turns += s == outline.length
        s[s == outline.length] = 0.0
        return np.column_stack([s, rows[:, 1] - turns * loop.target.length])

    rows = shifted(loop.anchors[:-1])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    rows = rows[np.diff(rows[:, 0], prepend=-1.0) > 0]
    closing = rows[:1] + np.array([outline.length, loop.target.length])
    anchors, features = np.concatenate([rows, closing]), shifted(loop.features)
    return replace(loop, source=outline, anchors=anchors, features=features, own=())
