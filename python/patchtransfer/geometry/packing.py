"""Curves and patches as one block of numbers, for pickles.

Results come from an executor's processes by the hundred, and pickling many small arrays one by one takes several times
as long as all the numbers in them. Each tuple or list in a pickle costs the garbage collector, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..numeric.arrays import FloatArray
from .curve import BSplineCurve
from .patch import Patch

__all__ = ["PackedCurves", "PackedPatches", "pack_curves", "pack_patches", "unpack_curves", "unpack_patches"]

#: Degree, numbers of control points and of coordinates, and whether there are weights, curve after curve; all numbers.
PackedCurves = tuple[tuple[int, ...], bytes]
#: The same of patches: both degrees, both numbers of control points, and whether there are weights.
PackedPatches = tuple[tuple[int, ...], bytes]


def pack_curves(curves: Sequence[BSplineCurve]) -> PackedCurves:
    """Plain values that `unpack_curves` makes equal curves of."""
    sizes: list[int] = []
    arrays: list[FloatArray] = []
    for c in curves:
        sizes += (c.degree, *c.control_points.shape, c.weights is not None)
        arrays += (c.knots, c.control_points) if c.weights is None else (c.knots, c.control_points, c.weights)
    return tuple(sizes), b"".join([a.tobytes() for a in arrays])


def unpack_curves(packed: PackedCurves) -> tuple[BSplineCurve, ...]:
    """The curves again."""
    sizes, numbers = packed
    # Read-only, for the bytes are.
    flat, at = np.frombuffer(numbers), 0
    curves = []
    four = iter(sizes)
    for degree, n, d, rational in zip(four, four, four, four, strict=True):
        points = at + n + degree + 1
        end = points + n * d
        weights = flat[end : end + n] if rational else None
        curves.append(BSplineCurve._trusted(flat[at:points], degree, flat[points:end].reshape(n, d), weights))
        at = end + n * rational
    return tuple(curves)


def pack_patches(patches: Sequence[Patch]) -> PackedPatches:
    """Plain values that `unpack_patches` makes equal patches of."""
    sizes: list[int] = []
    arrays: list[FloatArray] = []
    for p in patches:
        sizes += (*p.degrees, *p.control_points.shape[:2], p.weights is not None)
        arrays += (*p.knots, p.control_points) if p.weights is None else (*p.knots, p.control_points, p.weights)
    return tuple(sizes), b"".join([a.tobytes() for a in arrays])


def unpack_patches(packed: PackedPatches) -> tuple[Patch, ...]:
    """The patches again."""
    sizes, numbers = packed
    flat, at = np.frombuffer(numbers), 0
    patches = []
    five = iter(sizes)
    for p, q, n, m, rational in zip(five, five, five, five, five, strict=True):
        v = at + n + p + 1
        points = v + m + q + 1
        end = points + 2 * n * m
        weights = flat[end : end + n * m].reshape(n, m) if rational else None
        patches.append(Patch._trusted((flat[at:v], flat[v:points]), (p, q), flat[points:end].reshape(n, m, 2), weights))
        at = end + n * m * rational
    return tuple(patches)
