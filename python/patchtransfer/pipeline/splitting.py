"""A source split where the target has corners that no joint takes: where to cut, and the correspondence afterwards.

A side of a patch cannot follow a corner in its middle. A cut through the whole strip of patches behind it makes a joint
there, without changing the source's geometry. A strip that is not closed has a boundary side at either end, so a cut
serves a corner at both.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.conformity.strip_cuts import along_strips
from ..geometry.outline import Outline
from ..geometry.splitting import Cuts, Origin, SplitModel
from ..geometry.topology import BoundarySide, Topology
from ..numeric.arrays import FloatArray
from ..registration.free_joints import joints_to_corners, warped
from ..registration.lacking_joints import LackingJoint, lacking_joints
from ..registration.missed_corners import missed_corners, missed_warnings
from ..registration.register import LoopRegistration, Registration

__all__ = ["Division", "SourceSplit", "onto_split", "strip_cuts", "with_near_joints_moved"]

#: A free joint nearer to a corner than this part of its side moves there: no cut is needed.
NEAR_JOINT = 0.15
#: Corners at the two ends of a strip, or of several targets, share a cut where their places differ by less.
TOGETHER = 0.1
#: Pieces are at least this part of a strip wide, if there is room.
LEAST_WIDTH = 0.05
#: Joints that were made for other targets are not handed to corners farther away than this part of a side.
FARTHEST = 0.5
#: Cuts go through a knot of the source that is this near.
NEAR_KNOT = 0.02
#: Places of cuts are whole multiples of this: they, and what is left of a side, are exact numbers then, so that knots
#: agree to the bit where patches run against each other.
GRID = 2.0**-20
#: Arc lengths that differ by less than this part of the loop are one.
SAME_PLACE = 1e-9

#: A side of the source and a number of a target; the strip's cuts are for such.
_End = tuple[int, int, int]


@dataclass(frozen=True)
class SourceSplit:
    """How a source was split, so that corners of targets have joints.

    Attributes
    ----------
    corners : tuple of (x, y)
        Corners of the target, or of all targets that a plan was split for, that had no joint.
    origin : tuple of Origin
        Of every patch of the result, the patch of the source that it is, or was cut from, and which part.
    """

    corners: tuple[tuple[float, float], ...]
    origin: tuple[Origin, ...]

    @property
    def cuts(self) -> tuple[tuple[int, int, float], ...]:
        """Where patches of the source were cut, (patch, axis, parameter): u = parameter for axis 0."""
        ends: dict[tuple[int, int], set[float]] = defaultdict(set)
        for origin in self.origin:
            ends[origin.patch, 0].update(origin.u)
            ends[origin.patch, 1].update(origin.v)
        return tuple((k, axis, t) for (k, axis), at in sorted(ends.items()) for t in sorted(at)[1:-1])

    def __repr__(self) -> str:
        before = len({origin.patch for origin in self.origin})
        return f"<SourceSplit: {before} -> {len(self.origin)} patches for {len(self.corners)} corners>"

    def to_dict(self) -> dict[str, object]:
        """Plain values for JSON: corners, cuts, origin."""
        return {
            "corners": [list(corner) for corner in self.corners],
            "cuts": [{"patch": k, "axis": axis, "parameter": t} for k, axis, t in self.cuts],
            "origin": [origin.to_dict() for origin in self.origin],
        }


class Division(NamedTuple):
    """A source's topology, how it was cut, and what came of it."""

    before: Topology
    cuts: Cuts
    model: SplitModel

    def report(self, corners: Sequence[tuple[float, float]], older: SourceSplit | None) -> SourceSplit:
        """What to tell of it; `older` is how the source had been split itself."""
        origin = self.model.origin
        if older is not None:
            origin = tuple(o.within(self.before.patches[o.patch], older.origin[o.patch]) for o in origin)
            corners = (*older.corners, *corners)
        return SourceSplit(tuple(corners), origin)


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
    return registration if same else _with_loops(registration, loops)


def _with_loops(registration: Registration, loops: Sequence[LoopRegistration]) -> Registration:
    """The registration with other loops, and what it says of the corners that they miss."""
    old = registration.missed_corners
    stale = {line for k in range(len(loops)) for line in missed_warnings([c for c in old if c.loop == k])}
    warnings, missed, unit = [line for line in registration.warnings if line not in stale], [], loops[0].target.diameter
    for k, loop in enumerate(loops):
        of_loop = missed_corners(loop.source, loop.target, loop.anchors, k, unit)
        warnings += missed_warnings(of_loop)
        missed += of_loop
    return replace(registration, loops=tuple(loops), warnings=tuple(warnings), missed_corners=tuple(missed))


def strip_cuts(lacking: Sequence[Sequence[LackingJoint]], topology: Topology) -> Cuts:
    """Where to cut a source, so that corners of one target, or of several, get joints.

    Parameters
    ----------
    lacking : sequence of sequences of LackingJoint
        Of every target.
    topology : Topology
        Of the source.
    """
    wanted: dict[tuple[int, int], list[tuple[_End, float]]] = defaultdict(list)
    for number, corners in enumerate(lacking):
        for corner in corners:
            side = topology.loops[corner.loop][corner.side]
            low, high = topology.patches[side.patch].knots[side.side.axis][[0, -1]].tolist()
            x = (corner.parameter - low) / (high - low)
            end = (number, side.patch, int(side.side))
            wanted[side.patch, side.side.axis].append((end, 1 - x if side.reversed else x))
    return along_strips(topology.patches, topology.interfaces, wanted, _places)


def _places(wanted: list[tuple[_End, float]], knots: list[float]) -> list[float]:
    """Places of a strip's cuts: one for each corner of a side, shared with corners elsewhere near by."""
    groups: list[dict[_End, float]] = []
    for end, x in sorted(wanted, key=lambda pair: (pair[1], pair[0])):
        if groups and end not in groups[-1] and x - min(groups[-1].values()) <= TOGETHER:
            groups[-1][end] = x
        else:
            groups.append({end: x})
    places = np.array([np.mean(list(group.values())) for group in groups])
    n = len(places)
    width = min(LEAST_WIDTH, 0.5 / (n + 1))
    # Apart from the end before, then from the one after: there is room for all.
    steps = width * np.arange(1, n + 1)
    places = np.maximum.accumulate(np.maximum(places, width) - steps) + steps
    room = 1 - width * np.arange(n, 0, -1)
    places = np.minimum(places, room)
    own = np.unique(knots)
    if len(own):
        nearest = own[abs(places[:, None] - own).argmin(axis=1)]
        near = min(NEAR_KNOT, width / 3)
        at_knot = abs(nearest - places) <= near
        return [float(k) if at else _on_grid(x) for k, at, x in zip(nearest, at_knot, places, strict=True)]
    return [_on_grid(x) for x in places]


def _on_grid(x: float) -> float:
    return float(round(x / GRID) * GRID)


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
    before, cuts, split = division
    lacking: dict[int, list[LackingJoint]] = defaultdict(list)
    for corner in lacking_joints(registration, tolerance):
        lacking[corner.loop].append(corner)
    whole = {part: side for side, own in split.parts.items() for part in own}
    place = {(side.patch, side.side): (k, i) for k, loop in enumerate(before.loops) for i, side in enumerate(loop)}
    loops = []
    for own, outline in zip(split.multipatch.topology.loops, outlines, strict=True):
        k, _ = place[whole[own[0].patch, own[0].side]]
        loop = registration.loops[k]
        pairs = _pairs(loop, before.loops[k], cuts, lacking[k])
        anchors = _with_pairs(loop, pairs)
        features = np.concatenate([loop.features, pairs])
        starts = []
        for part in own:
            i = place[whole[part.patch, part.side]][1]
            starts.append(_start(loop.source, i, before.loops[k][i], part, split.origin[part.patch]))
        loops.append(_moved(replace(loop, anchors=anchors, features=features), np.array(starts), outline))
    return _with_loops(registration, loops)


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
    low, high = (origin.u, origin.v)[part.side.axis]
    t = sum(outline.curves[i].domain) - high if side.reversed else low
    return float(outline.arc_length(i, np.array([t]))[0])


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
    return replace(loop, source=outline, anchors=np.concatenate([rows, closing]), features=shifted(loop.features))
