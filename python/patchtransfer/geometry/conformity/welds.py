"""Gaps along interfaces closed: both sides move to their mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...numeric.arrays import FloatArray, IntArray
from ..combinatorics import identify
from ..mending import short
from ..patch import Patch
from ..sides import Interface
from ..tolerances import exact
from .weighting import along, unproportional

__all__ = ["gaps", "welded"]


#: Weights that differ by more than this part are not the same in other digits.
OTHER_WEIGHTS = 1e-3


def gaps(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> list[float]:
    """Largest difference of control points along each interface, of weights by the size of the side.

    Infinite where weights differ so much that the sides are other curves, or run at other speeds.
    """
    found = []
    for f in interfaces:
        a, b = f.side_a.of(patches[f.patch_a].control_points), f.side_b.of(patches[f.patch_b].control_points)
        gap = float(np.abs(a - (b[::-1] if f.reversed else b)).max())
        part = unproportional(*along(patches, f))
        found.append(max(gap, part * float(np.ptp(a, axis=0).max())) if part <= OTHER_WEIGHTS else np.inf)
    return found


def welded(
    patches: Sequence[Patch], interfaces: Sequence[Interface], weld: float
) -> tuple[list[Patch], float, list[str]]:
    """Patches with the same numbers on both sides of interfaces whose gap is at most `weld`, or rounding.

    Returns
    -------
    patches : list of Patch
    moved : float
        Farthest distance that a control point moved.
    notes : list of str
        Gaps above rounding that were closed.
    """
    rounding = exact(patches)
    sizes = gaps(patches, interfaces)
    closed = [f for f, gap in zip(interfaces, sizes, strict=True) if gap <= max(weld, rounding)]
    numbers, count = identify([patch.shape for patch in patches], closed)
    flat = np.concatenate([n.ravel() for n in numbers])
    points = _means(np.concatenate([patch.control_points.reshape(-1, 2) for patch in patches]), flat, count)
    # Exact multiples are one side already; there is no mean of them.
    alike = [f for f in closed if not _multiples(*along(patches, f))]
    weight_numbers, weight_count = identify([patch.shape for patch in patches], alike)
    common = _common_weights(patches, np.concatenate([n.ravel() for n in weight_numbers]), weight_count)
    made, shifts = [], []
    for patch, n, w in zip(patches, numbers, weight_numbers, strict=True):
        new = Patch(patch.knots, patch.degrees, points[n], None if patch.weights is None else common[w])
        shifts.append(_shift(patch, new))
        made.append(patch if new == patch else new)
    notes = [
        f"interface {f.name}: gap of {short(gap)} closed, both sides moved by at most "
        f"{short(max(shifts[f.patch_a], shifts[f.patch_b]))}"
        for f, gap in zip(interfaces, sizes, strict=True)
        if rounding < gap <= weld
    ]
    if 0.0 < max(shifts) <= rounding:
        notes.append(f"sides that differed by rounding made equal, moved by at most {short(max(shifts))}")
    return made, max(shifts), notes


def _common_weights(patches: Sequence[Patch], numbers: IntArray, count: int) -> FloatArray:
    """A weight for each number: the mean, but one where a polynomial patch has it, which has no other."""
    every = [np.ones(patch.shape) if patch.weights is None else patch.weights for patch in patches]
    common = _means(np.concatenate([w.reshape(-1, 1) for w in every]), numbers, count)[:, 0]
    ones = np.concatenate([np.full(patch.shape, patch.weights is None).ravel() for patch in patches])
    common[numbers[ones]] = 1.0
    return np.asarray(common)


def _multiples(a: FloatArray, b: FloatArray) -> bool:
    return unproportional(a, b) == 0.0 and a[0] != b[0]


def _shift(before: Patch, after: Patch) -> float:
    """How far a point moves at most, nearly."""
    far = float(np.hypot(*(after.control_points - before.control_points).transpose(2, 0, 1)).max())
    if before.weights is None or after.weights is None:
        return far
    size = float(np.ptp(after.control_points.reshape(-1, 2), axis=0).max())
    return max(far, float(np.abs(after.weights / before.weights - 1).max()) * size)


def _means(values: FloatArray, numbers: IntArray, count: int) -> FloatArray:
    """Mean of the values (m, d) of each number (n, d); where all agree to the bit, that value."""
    total, times = np.zeros((count, values.shape[1])), np.zeros((count, 1))
    np.add.at(total, numbers, values)
    np.add.at(times, numbers, 1.0)
    first = np.empty_like(total)
    first[numbers[::-1]] = values[::-1]
    differ = np.zeros((count, values.shape[1]), bool)
    np.logical_or.at(differ, numbers, first[numbers] != values)
    return np.where(differ.any(axis=1, keepdims=True), total / times, first)
