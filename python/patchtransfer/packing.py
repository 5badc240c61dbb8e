"""Curves and patches as one block of numbers, for pickles.

Results come from an executor's processes by the hundred, and pickling many small arrays one by one takes several times
as long as all the numbers in them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod
from typing import Any

import numpy as np

from .splines import BSplineCurve, FloatArray, Patch

__all__ = ["PackedCurves", "PackedPatches", "pack_curves", "pack_patches", "unpack_curves", "unpack_patches"]

Shapes = tuple[tuple[int, ...] | None, ...]
#: Degrees of the curves; shapes of their arrays (None where there are no weights) and the numbers in them.
PackedCurves = tuple[tuple[int, ...], Shapes, bytes]
#: The same of patches, with two degrees each.
PackedPatches = tuple[tuple[tuple[int, int], ...], Shapes, bytes]


def pack_curves(curves: Sequence[BSplineCurve]) -> PackedCurves:
    """Plain values that `unpack_curves` makes equal curves of."""
    return tuple([c.degree for c in curves]), *_pack(
        [a for c in curves for a in (c.knots, c.control_points, c.weights)]
    )


def unpack_curves(packed: PackedCurves) -> tuple[BSplineCurve, ...]:
    """The curves again."""
    degrees, shapes, numbers = packed
    arrays = _unpack(shapes, numbers)
    # Arguments are evaluated from left to right, in the order the arrays were packed.
    return tuple([BSplineCurve._trusted(next(arrays), p, next(arrays), next(arrays)) for p in degrees])


def pack_patches(patches: Sequence[Patch]) -> PackedPatches:
    """Plain values that `unpack_patches` makes equal patches of."""
    return tuple([p.degrees for p in patches]), *_pack(
        [a for p in patches for a in (*p.knots, p.control_points, p.weights)]
    )


def unpack_patches(packed: PackedPatches) -> tuple[Patch, ...]:
    """The patches again."""
    degrees, shapes, numbers = packed
    arrays = _unpack(shapes, numbers)
    return tuple([Patch._trusted((next(arrays), next(arrays)), p, next(arrays), next(arrays)) for p in degrees])


def _pack(arrays: Sequence[FloatArray | None]) -> tuple[Shapes, bytes]:
    shapes = tuple([None if a is None else a.shape for a in arrays])
    return shapes, b"".join([a.tobytes() for a in arrays if a is not None])


def _unpack(shapes: Shapes, numbers: bytes) -> Iterator[Any]:
    # Read-only, for the bytes are.
    flat, end = np.frombuffer(numbers), 0
    for shape in shapes:
        if shape is None:
            yield None
            continue
        start, end = end, end + prod(shape)
        yield flat[start:end].reshape(shape)
