"""Which patch points lie in, and at which parameters: many at once, in the compiled core."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._core import Locator
from ..errors import InputError
from ..numeric.arrays import FloatArray, IntArray

__all__ = ["locate"]

#: Points between two looks at Ctrl-C: some tenths of a second.
BLOCK = 2**18


def locate(
    locator: Locator, points: ArrayLike, tolerance: float, diameter: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """As `MultiPatch.locate`; `tolerance` is relative to `diameter`."""
    if not tolerance >= 0:
        raise InputError(f"tolerance = {tolerance}: a number from 0 on is needed")
    try:
        x = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"points to locate: not an array of numbers ({error})") from None
    if x.ndim == 0 or x.shape[-1] != 2:
        raise InputError(f"points to locate must have shape (..., 2), got {x.shape}")
    shape, x = x.shape[:-1], x.reshape(-1, 2)
    wrong = ~np.isfinite(x).all(axis=1)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise InputError(f"points to locate: point {k} is ({x[k, 0]}, {x[k, 1]}); leave it out")
    patch = np.empty(len(x), dtype=np.int64)
    u, v = np.empty(len(x)), np.empty(len(x))
    for start in range(0, len(x), BLOCK):
        part = slice(start, start + BLOCK)
        patch[part], u[part], v[part] = locator.locate(x[part], tolerance * diameter)
    return patch.reshape(shape), u.reshape(shape), v.reshape(shape)
