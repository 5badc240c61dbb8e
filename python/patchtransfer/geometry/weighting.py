"""Weights of rational patches made to agree where that changes no geometry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..numeric.arrays import FloatArray
from ..numeric.components import components
from .patch import Patch
from .sides import Interface

__all__ = ["with_common_weights"]

#: Weights that differ by this part of themselves are the same but for rounding.
SAME_WEIGHT = 1e-12


def with_common_weights(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> tuple[list[Patch], list[str]]:
    """Patches with comparable weights along interfaces, and sentences on what changed.

    Patches with equal weights become polynomial if they are glued to polynomial ones; polynomial patches glued, over
    others perhaps, to truly rational ones get weights of one; and all weights of a patch are scaled by a factor where
    those of its neighbour's side are that many times its own.
    """
    patches, notes = list(patches), list[str]()
    a, b = (np.array(x, np.int64) for x in ([f.patch_a for f in interfaces], [f.patch_b for f in interfaces]))
    part = components(len(patches), a, b)
    for number in range(int(part.max()) + 1):
        members = np.flatnonzero(part == number)
        rational = [int(k) for k in members if patches[k].weights is not None]
        if 0 < len(rational) < len(members):
            notes += _one_kind(patches, rational, members.tolist())
    notes += _rescaled(patches, interfaces)
    return patches, notes


def _one_kind(patches: list[Patch], rational: list[int], members: list[int]) -> list[str]:
    """Make a part's patches all polynomial, or all rational."""
    notes = []
    for k in rational:
        weights = patches[k].weights
        if weights is not None and np.ptp(weights) == 0.0:
            patches[k] = Patch(patches[k].knots, patches[k].degrees, patches[k].control_points)
            notes.append(f"patch {k}: its weights are all equal and were left out")
    if all(patches[k].weights is None for k in members):
        return notes
    ones = [k for k in members if patches[k].weights is None]
    for k in ones:
        patches[k] = _weighted(patches[k], np.ones(patches[k].shape))
    named = ", ".join(map(str, ones[:8])) + (", ..." if len(ones) > 8 else "")
    return [*notes, f"patch{'es' if len(ones) > 1 else ''} {named}: weights of one given, for neighbours are rational"]


def _rescaled(patches: list[Patch], interfaces: Sequence[Interface]) -> list[str]:
    """Scale weights patch by patch, each by the first neighbour reached."""
    beside: dict[int, list[int]] = {}
    for i, f in enumerate(interfaces):
        if patches[f.patch_a].weights is not None and patches[f.patch_b].weights is not None:
            beside.setdefault(f.patch_a, []).append(i)
            beside.setdefault(f.patch_b, []).append(i)
    notes, seen = [], set[int]()
    for first in sorted(beside):
        queue = [] if first in seen else [first]
        seen.add(first)
        for k in queue:
            for i in beside[k]:
                f = interfaces[i]
                own, other = along(patches, f)
                if k == f.patch_b:
                    own, other = other, own
                m = f.patch_b if k == f.patch_a else f.patch_a
                if m in seen:
                    continue
                seen.add(m)
                queue.append(m)
                factor = float((own / other).mean())
                weights = patches[m].weights
                if weights is not None and abs(factor - 1) > SAME_WEIGHT:
                    patches[m] = _weighted(patches[m], weights * factor)
                    notes.append(f"patch {m}: weights scaled by {factor:.6g}")
    return notes


def along(patches: Sequence[Patch], f: Interface) -> tuple[FloatArray, FloatArray]:
    """Weights along the two sides of an interface, in the sense of the first; ones for polynomial patches."""
    first, second = (
        np.ones(len(side.of(patches[k].control_points))) if (w := patches[k].weights) is None else side.of(w)
        for k, side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b))
    )
    return first, second[::-1] if f.reversed else second


def _weighted(patch: Patch, weights: FloatArray) -> Patch:
    return Patch(patch.knots, patch.degrees, patch.control_points, weights)
