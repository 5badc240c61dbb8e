"""Curves and patches as one block of numbers, for pickles.

Results come from an executor's processes by the hundred, and pickling many small arrays one by one takes several times
as long as all the numbers in them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod

import numpy as np

from .splines import BSplineCurve, FloatArray, Patch

__all__ = ["PackedCurves", "PackedPatches", "pack_curves", "pack_patches", "unpack_curves", "unpack_patches"]

Shapes = tuple[tuple[int, ...], ...]
#: Degree and whether there are weights, of every curve; shapes of the arrays, and their numbers.
PackedCurves = tuple[tuple[tuple[int, bool], ...], Shapes, bytes]
#: The same of patches, with two degrees each.
PackedPatches = tuple[tuple[tuple[tuple[int, int], bool], ...], Shapes, bytes]


def pack_curves(curves: Sequence[BSplineCurve]) -> PackedCurves:
    """Plain values that `unpack_curves` makes equal curves of."""
    arrays = [
        (c.knots, c.control_points) if c.weights is None else (c.knots, c.control_points, c.weights) for c in curves
    ]
    return tuple([(c.degree, c.weights is not None) for c in curves]), *_pack(arrays)


def unpack_curves(packed: PackedCurves) -> tuple[BSplineCurve, ...]:
    """The curves again."""
    kinds, shapes, numbers = packed
    arrays = _unpack(shapes, numbers)
    # Arguments are evaluated from left to right, in the order the arrays were packed.
    return tuple(
        [
            BSplineCurve._trusted(next(arrays), degree, next(arrays), next(arrays) if rational else None)
            for degree, rational in kinds
        ]
    )


def pack_patches(patches: Sequence[Patch]) -> PackedPatches:
    """Plain values that `unpack_patches` makes equal patches of."""
    arrays = [
        (*p.knots, p.control_points) if p.weights is None else (*p.knots, p.control_points, p.weights) for p in patches
    ]
    return tuple([(p.degrees, p.weights is not None) for p in patches]), *_pack(arrays)


def unpack_patches(packed: PackedPatches) -> tuple[Patch, ...]:
    """The patches again."""
    kinds, shapes, numbers = packed
    arrays = _unpack(shapes, numbers)
    return tuple(
        [
            Patch._trusted((next(arrays), next(arrays)), degrees, next(arrays), next(arrays) if rational else None)
            for degrees, rational in kinds
        ]
    )


def _pack(groups: Sequence[Sequence[FloatArray]]) -> tuple[Shapes, bytes]:
    arrays = [array for group in groups for array in group]
    return tuple([array.shape for array in arrays]), b"".join([array.tobytes() for array in arrays])


def _unpack(shapes: Shapes, numbers: bytes) -> Iterator[FloatArray]:
    # Read-only, for the bytes are.
    flat, end = np.frombuffer(numbers), 0
    for shape in shapes:
        start, end = end, end + prod(shape)
        yield flat[start:end].reshape(shape)
