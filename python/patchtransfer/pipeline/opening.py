"""Corners of a source that lie on smooth places of a target: which, and the source without them.

A patch that fills such a corner alone is degenerate there, whatever the inside. Where the corners are those of a patch
that hangs on one other, a serif's, the target lacks what the patch is, and the source is taken without it. Elsewhere
the corner is opened: two patches that share it are not degenerate.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ..geometry.ears import ears, nothing_lost
from ..geometry.multipatch import MultiPatch
from ..geometry.opened_corner import open_corners
from ..geometry.splitting import SplitModel
from ..geometry.topology import Topology
from ..proof.certificate import certify
from ..registration.register import Registration

__all__ = ["opened", "smooth_corners", "superfluous_ears"]

#: A corner is opened where the target turns by less: there det J is at most a quarter of the product of the speeds.
STRAIGHT = math.radians(15.0)
#: Neighbours are not cut any more where a source would get more than this many times its patches, or this many: every
#: corner cuts two strips, which cross those of others.
GROWTH, FEW = 3, 20


def smooth_corners(
    registration: Registration, topology: Topology, single: Sequence[Sequence[bool]]
) -> list[tuple[int, int]]:
    """Corners (patch, corner) of single patches that lie on smooth places of the target."""
    found = []
    for loop, sides, alone in zip(registration.loops, topology.loops, single, strict=True):
        turn = loop.target.turn(loop.joints[:-1])
        for i in np.flatnonzero(np.asarray(alone) & (turn < STRAIGHT)).tolist():
            ends = sides[i].side.of(np.array([[0, 2], [1, 3]]))
            found.append((sides[i].patch, int(ends[-1 if sides[i].reversed else 0])))
    return found


def superfluous_ears(registration: Registration, source: MultiPatch, valence: Sequence[Sequence[int]]) -> list[int]:
    """Patches that hang on one other and whose free corners both lie on smooth places of the target.

    Not if something is matched to what is between, if the source's file says something of the patch, or if one patch
    would be left at a smooth place.

    Parameters
    ----------
    registration : Registration
    source : MultiPatch
    valence : loops of int
        How many patches meet at each joint.
    """
    found: list[int] = []
    for ear in ears(source.topology):
        loop, patches = registration.loops[ear.loop], valence[ear.loop]
        n = len(patches)
        turn = loop.target.turn(loop.joints[:-1])
        begin, first, second, end = (ear.side + j for j in range(4))
        smooth = all(abs(turn[j % n]) < STRAIGHT for j in (first, second))
        left = all(patches[j % n] > 2 or turn[j % n] >= STRAIGHT for j in (begin, end))
        joints = np.append(loop.source.joints, loop.source.joints[1:] + loop.source.length)
        inside = np.mod(loop.features[:, 0] - joints[begin], loop.source.length)
        bare = not ((inside > 0) & (inside < joints[end] - joints[begin])).any()
        if smooth and left and bare and nothing_lost(source, ear.patch):
            found.append(ear.patch)
    # One that hangs on another goes first; a model of nothing else stays.
    pairs = [(f.patch_a, f.patch_b) for f in source.interfaces]
    beside = {b for a, b in pairs if a in found} | {a for a, b in pairs if b in found}
    return [patch for patch in found if patch not in beside]


def opened(multipatch: MultiPatch, corners: Iterable[tuple[int, int]]) -> SplitModel | None:
    """The source with corners opened; None if there are none, or not all can be, for then patches stay degenerate.

    Neighbours are cut as long as the source does not get far more patches by it.
    """
    model: SplitModel | None = None
    left = list(corners)
    most = max(GROWTH * len(multipatch), FEW)
    while left:
        before = multipatch if model is None else model.multipatch
        places = [corner if model is None else model.piece_at(*corner) for corner in left]
        # What patches have most of first: cuts may part the corners of others.
        patch = max(dict.fromkeys(at[0] for at in places), key=[at[0] for at in places].count)
        ends = [at[1] for at in places if at[0] == patch]
        made = open_corners(before, patch, ends)
        if made is None or len(made.multipatch) > most or not certify(made.multipatch).injective:
            made = open_corners(before, patch, ends, cutting=False)
        if made is None or not certify(made.multipatch).injective:
            return None
        model = made if model is None else model.then(made)
        left = [corner for corner, at in zip(left, places, strict=True) if at[0] != patch]
    return model
