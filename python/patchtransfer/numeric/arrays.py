"""Arrays of numbers: their types, read-only copies, bit-equality."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import product
from ..errors import InputError
from ..interruption import held_back

__all__ = ["FloatArray", "IntArray", "among", "distinct", "frozen_array", "same_bits"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

with held_back():
    # The core looks NumPy up at its first array, by Python code in which an interruption would be a panic.
    product(np.ones((1, 1, 1)), np.ones((1, 1, 1)))


def frozen_array(values: ArrayLike, what: str) -> FloatArray:
    """Return a read-only float64 copy of `values`; `InputError` if it has NaN, infinity or no numbers."""
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: not an array of numbers ({error})") from None
    if not np.isfinite(array).all():
        raise InputError(f"{what}: contains NaN or infinity")
    array.flags.writeable = False
    return array


def distinct(values: NDArray[Any]) -> NDArray[Any]:
    """The values (n,) in increasing order, each once: as `numpy.unique`, which loads NumPy's masked arrays for that."""
    found = np.sort(values, axis=None)
    first = np.ones(len(found), bool)
    first[1:] = found[1:] != found[:-1]
    return found[first]


def among(values: NDArray[Any], chosen: Iterable[Any]) -> NDArray[np.bool_]:
    """Which of the values (n,) are among the chosen: as `numpy.isin`, which loads NumPy's masked arrays for that."""
    known = np.sort(np.array(list(chosen), values.dtype))
    if not len(known):
        return np.zeros(len(values), bool)
    return np.asarray(known[np.searchsorted(known, values).clip(max=len(known) - 1)] == values)


def same_bits(a: Any, b: Any, names: tuple[str, ...]) -> bool:
    """Bit-equality of the named array attributes."""

    def flat(x: Any) -> list[FloatArray | None]:
        return list(x) if isinstance(x, tuple) else [x]

    for name in names:
        for x, y in zip(flat(getattr(a, name)), flat(getattr(b, name)), strict=True):
            if x is None or y is None:
                if x is not y:
                    return False
            elif not np.array_equal(x, y):
                return False
    degrees = ("degree", "degrees")
    return all(a.__dict__.get(name) == b.__dict__.get(name) for name in degrees)
