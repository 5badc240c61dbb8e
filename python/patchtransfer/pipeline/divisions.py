"""A source divided for its targets: cut where they have corners that no joint takes, corners opened, patches left out.

A side of a patch cannot follow a corner in its middle. A cut through the whole strip of patches behind it makes a joint
there, without changing the source's geometry. A strip that is not closed has a boundary side at either end, so a cut
serves a corner at both. `opening` tells which corners are opened and which patches left out.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry.conformity.strip_cuts import along_strips
from ..geometry.ears import without_patches
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.splitting import Cuts, Origin, SplitModel, split_model, split_patches
from ..geometry.topology import Topology
from ..registration.lacking_joints import LackingJoint
from .opening import opened

__all__ = ["Division", "SourceSplit", "cut", "divided_again", "with_corners_opened", "without"]

#: Corners at the two ends of a strip, or of several targets, share a cut where their places differ by less.
TOGETHER = 0.1
#: Pieces are at least this part of a strip wide, if there is room.
LEAST_WIDTH = 0.05
#: Cuts go through a knot of the source that is this near.
NEAR_KNOT = 0.02
#: Places of cuts are whole multiples of this: they, and what is left of a side, are exact numbers then, so that knots
#: agree to the bit where patches run against each other.
GRID = 2.0**-20

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
        Of every patch of the result, the patch of the source that it is, or was cut from, and which part: of the three
        at an opened corner the smallest ranges that they lie in.
    opened : tuple of (patch, corner)
        Corners of the source that one patch filled and that lie on smooth places of targets: two patches share them.
    dropped : tuple of int
        Patches of the source that the result has none of, for the target lacks the feature that they are.
    """

    corners: tuple[tuple[float, float], ...]
    origin: tuple[Origin, ...]
    opened: tuple[tuple[int, int], ...] = ()
    dropped: tuple[int, ...] = ()

    @property
    def cuts(self) -> tuple[tuple[int, int, float], ...]:
        """Where patches of the source were cut, (patch, axis, parameter): u = parameter for axis 0."""
        ends: dict[tuple[int, int], set[float]] = defaultdict(set)
        for origin in self.origin:
            ends[origin.patch, 0].update(origin.u)
            ends[origin.patch, 1].update(origin.v)
        return tuple((k, axis, t) for (k, axis), at in sorted(ends.items()) for t in sorted(at)[1:-1])

    def __repr__(self) -> str:
        before = len({origin.patch for origin in self.origin}) + len(self.dropped)
        opened = f", {len(self.opened)} opened" if self.opened else ""
        return f"<SourceSplit: {before} -> {len(self.origin)} patches for {len(self.corners)} corners{opened}>"

    def to_dict(self) -> dict[str, object]:
        """Plain values for JSON: corners, cuts, origin, opened, dropped."""
        return {
            "corners": [list(corner) for corner in self.corners],
            "cuts": [{"patch": k, "axis": axis, "parameter": t} for k, axis, t in self.cuts],
            "origin": [origin.to_dict() for origin in self.origin],
            "opened": [{"patch": patch, "corner": corner} for patch, corner in self.opened],
            "dropped": list(self.dropped),
        }


class Division(NamedTuple):
    """A source's topology, how it was cut, and what came of it and of its reference.

    `corners` are those of targets that it was cut for; `opened` and `dropped` which corners were opened or patches left
    out instead.
    """

    before: Topology
    cuts: Cuts
    model: SplitModel
    reference: Sequence[Patch] | None
    corners: tuple[tuple[float, float], ...] = ()
    opened: tuple[tuple[int, int], ...] = ()
    dropped: tuple[int, ...] = ()

    def report(self, older: SourceSplit | None) -> SourceSplit:
        """What to tell of it; `older` is how the source had been split itself."""
        origin, corners, opened, dropped = self.model.origin, self.corners, self.opened, self.dropped
        if older is not None:
            origin = tuple(o.within(self.before.patches[o.patch], older.origin[o.patch]) for o in origin)
            corners = (*older.corners, *corners)
            opened = (*older.opened, *((older.origin[patch].patch, corner) for patch, corner in opened))
            left = {o.patch for o in origin}
            whole = dict.fromkeys(older.origin[patch].patch for patch in dropped)
            dropped = (*older.dropped, *(patch for patch in whole if patch not in left))
        return SourceSplit(tuple(corners), origin, opened, dropped)


def cut(
    source: MultiPatch, reference: Sequence[Patch] | None, lacking: Sequence[Sequence[LackingJoint]]
) -> Division | None:
    """A source cut through its strips, so that corners of targets that lack joints, target by target, get them."""
    cuts = strip_cuts(lacking, source.topology)
    corners = dict.fromkeys(corner.point for corners in lacking for corner in corners)
    return _cut_at(source, reference, cuts, tuple(corners)) if cuts else None


def _cut_at(
    source: MultiPatch, reference: Sequence[Patch] | None, cuts: Cuts, corners: tuple[tuple[float, float], ...]
) -> Division:
    reference = reference and split_patches(reference, source.interfaces, cuts)
    return Division(source.topology, cuts, split_model(source, cuts), reference, corners)


def with_corners_opened(
    source: MultiPatch, reference: Sequence[Patch] | None, corners: Sequence[tuple[int, int]]
) -> Division | None:
    """A source with these corners opened for a second patch; None if they cannot be.

    A reference has no patches for them.
    """
    model = opened(source, corners) if reference is None else None
    return None if model is None else Division(source.topology, {}, model, None, opened=tuple(corners))


def without(source: MultiPatch, reference: Sequence[Patch] | None, patches: Sequence[int]) -> Division:
    """A source without some of its patches."""
    reference = reference and [one for k, one in enumerate(reference) if k not in patches]
    return Division(source.topology, {}, without_patches(source, patches), reference, dropped=tuple(patches))


def divided_again(source: MultiPatch, reference: Sequence[Patch] | None, division: Division) -> Division | None:
    """The mirror image of a source divided as the source was."""
    if division.opened:
        return with_corners_opened(source, reference, division.opened)
    if division.dropped:
        return without(source, reference, division.dropped)
    return _cut_at(source, reference, division.cuts, division.corners)


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
