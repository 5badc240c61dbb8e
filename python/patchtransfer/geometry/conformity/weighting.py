"""Weights of rational patches made to agree where that changes no geometry."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from ...numeric.arrays import FloatArray
from ...numeric.components import components
from ..basis import in_range
from ..patch import Patch
from ..sides import Interface

__all__ = ["along", "unproportional", "with_common_weights"]

#: Weights that differ by this part of themselves are the same but for rounding.
SAME_WEIGHT = 1e-12


def with_common_weights(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> tuple[list[Patch], list[str]]:
    """Patches with comparable weights along interfaces, and sentences on what changed.

    All weights of a patch are scaled by a factor where those of its neighbour's side are that many times its own, but
    for some digits; polynomial patches count as ones with weights of one. Exact multiples describe the same side and
    are left as they are, in parts of the model that have nothing else.
    """
    patches, notes = list(patches), list[str]()
    a, b = (np.array(x, np.int64) for x in ([f.patch_a for f in interfaces], [f.patch_b for f in interfaces]))
    part = components(len(patches), a, b)
    concerned = {int(part[f.patch_a]) for f in interfaces if unproportional(*along(patches, f))}
    beside: dict[int, list[Interface]] = {}
    for f in interfaces:
        if part[f.patch_a] in concerned:
            beside.setdefault(f.patch_a, []).append(f)
            beside.setdefault(f.patch_b, []).append(f)
    seen = {k for k in beside if patches[k].weights is None}
    queue = sorted(seen)
    for first in sorted(beside):
        if first not in seen:
            seen.add(first)
            queue.append(first)
        while queue:
            k = queue.pop(0)
            for f in beside[k]:
                m = f.patch_b if k == f.patch_a else f.patch_a
                if m in seen:
                    continue
                seen.add(m)
                queue.append(m)
                own, other = along(patches, f) if k == f.patch_a else along(patches, f)[::-1]
                notes += _scale(patches, m, float((own / other).mean()))
    return patches, notes


def _scale(patches: list[Patch], k: int, factor: float) -> list[str]:
    patch = patches[k]
    if patch.weights is None or abs(factor - 1) <= SAME_WEIGHT:
        return []
    with np.errstate(over="ignore"):
        weights = patch.weights * factor
    if not in_range(weights):
        return []
    patches[k] = Patch(patch.knots, patch.degrees, patch.control_points, weights)
    return [f"patch {k}: weights scaled by {factor:.6g}"]


def unproportional(a: FloatArray, b: FloatArray) -> float:
    """By what part of themselves weights differ that are the same up to a factor; 0 for exact multiples only."""
    if np.array_equal(a, b):
        return 0.0
    ratio = a / b
    apart = float(np.abs(ratio / ratio.mean() - 1).max())
    if apart > SAME_WEIGHT:
        return apart
    x, y = Fraction(float(a[0])), Fraction(float(b[0]))
    exact = all(Fraction(s) * y == Fraction(t) * x for s, t in zip(a.tolist(), b.tolist(), strict=True))
    return 0.0 if exact else max(apart, float(np.finfo(float).eps))


def along(patches: Sequence[Patch], f: Interface) -> tuple[FloatArray, FloatArray]:
    """Weights along the two sides of an interface, in the sense of the first; ones for polynomial patches."""
    first, second = (
        np.ones(len(side.of(patches[k].control_points))) if (w := patches[k].weights) is None else side.of(w)
        for k, side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b))
    )
    return first, second[::-1] if f.reversed else second
