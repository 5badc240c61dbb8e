"""Ears: patches that hang on one other, by one side. A model without some has the same geometry elsewhere."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

from .multipatch import MultiPatch
from .patch import Patch
from .sides import Interface, Side
from .splitting import Origin, SplitModel
from .topology import Topology

__all__ = ["Ear", "ears", "nothing_lost", "without_patches"]


class Ear(NamedTuple):
    """A patch with three sides on the boundary.

    Attributes
    ----------
    patch : int
    loop, side : int
        Its first side on the boundary, as the loop passes it; two more follow.
    """

    patch: int
    loop: int
    side: int


def ears(topology: Topology) -> list[Ear]:
    """All ears of a model of several patches."""
    found = []
    for k, sides in enumerate(topology.loops):
        if len(sides) < 4:
            continue
        for i, side in enumerate(sides):
            three = [sides[(i + j) % len(sides)].patch for j in range(3)]
            beside = (sides[i - 1].patch, sides[(i + 3) % len(sides)].patch)
            if three == [side.patch] * 3 and side.patch not in beside:
                found.append(Ear(side.patch, k, i))
    return found


def nothing_lost(multipatch: MultiPatch, patch: int) -> bool:
    """Whether nothing that a file says is of this patch only: labels of its sides, blocks."""
    labelled = {k for sides in multipatch.sides.values() for k, _ in sides}
    return not multipatch.blocks and patch not in labelled


def without_patches(multipatch: MultiPatch, gone: Collection[int]) -> SplitModel:
    """The model without some patches; their sides have no parts in the outcome, their neighbours' are bare."""
    kept = [k for k in range(len(multipatch)) if k not in gone]
    number = {k: i for i, k in enumerate(kept)}
    interfaces = [
        Interface(number[f.patch_a], f.side_a, number[f.patch_b], f.side_b, f.reversed)
        for f in multipatch.interfaces
        if f.patch_a in number and f.patch_b in number
    ]
    labels = {name: [(number[k], side) for k, side in sides if k in number] for name, sides in multipatch.sides.items()}
    patches: Sequence[Patch] = [multipatch.patches[k] for k in kept]
    left = MultiPatch(patches, interfaces, [multipatch.ids[k] for k in kept], labels, multipatch.blocks)
    origin = tuple(Origin(k, *multipatch.patches[k].domain) for k in kept)
    parts = {(k, side): [(number[k], side)] if k in number else [] for k in range(len(multipatch)) for side in Side}
    return SplitModel(left, origin, parts, [])
