"""Splines of other programs, numbers and arrays of any kind, as patches and curves: planar, clamped, within bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.curve import BSplineCurve
from ..geometry.patch import Patch
from ..limits import MAX_ALONG, MAX_BOUNDARY_POINTS, MAX_DEGREE, TOO_LARGE, at_most, first_unusable
from ..numeric.arrays import FloatArray
from .loops import clamp

__all__ = ["curve_of", "numbers", "patch_of"]


def numbers(values: ArrayLike, where: str) -> FloatArray:
    """An array of finite numbers whose squares do not overflow."""
    try:
        given = np.asarray(values)
    except (ValueError, TypeError, OverflowError):
        given = np.array("ragged")
    # Texts that look like numbers, truth values and objects are none.
    if given.dtype.kind not in "fiu":
        raise InputError(f"{where}: not an array of numbers; correct it")
    array = given.astype(np.float64)
    if (wrong := first_unusable(array)) is not None:
        raise InputError(f"{where}: {array.flat[wrong]:g} is NaN, infinite or {TOO_LARGE}; correct it")
    return array


def patch_of(
    where: str,
    degrees: Sequence[object],
    knots: Sequence[ArrayLike],
    points: ArrayLike,
    weights: ArrayLike | None,
    first_fastest: bool,
) -> Patch:
    """A patch from a list of control points, one a row.

    Parameters
    ----------
    where : str
        Of what, for messages.
    degrees : pair of int
    knots : pair of arrays
        They need not be clamped.
    points : (n, 2) or (n, 3) array
        In space z must be 0.
    weights : (n,) array or None
    first_fastest : bool
        Whether u or v runs fastest in the list.
    """
    p, k = _bases(where, degrees, knots, 2)
    counts = [len(x) - d - 1 for x, d in zip(k, p, strict=True)]
    at_most(max(counts), MAX_ALONG, f"control points in one direction of {where}", "coarsen it")
    h = _homogeneous(where, counts[0] * counts[1], points, weights)
    net = h.reshape(*counts[::-1], -1).swapaxes(0, 1) if first_fastest else h.reshape(*counts, -1)
    for axis in (0, 1):
        k[axis], net = _clamped(where, k[axis], p[axis], net, axis)
    x, w = _parts(net, weights is not None)
    try:
        return Patch(k, p, x, w)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def curve_of(
    where: str, degree: object, knots: ArrayLike, points: ArrayLike, weights: ArrayLike | None
) -> BSplineCurve:
    """A curve; the parameters are those of `patch_of`."""
    p, k = _bases(where, [degree], [knots], 1)
    count = len(k[0]) - p[0] - 1
    at_most(count, MAX_BOUNDARY_POINTS, f"control points of {where}", "coarsen it")
    k[0], h = _clamped(where, k[0], p[0], _homogeneous(where, count, points, weights), 0)
    x, w = _parts(h, weights is not None)
    try:
        return BSplineCurve(k[0], p[0], x, w)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _bases(
    where: str, degrees: Sequence[object], knots: Sequence[ArrayLike], directions: int
) -> tuple[list[int], list[FloatArray]]:
    if len(degrees) != directions or len(knots) != directions:
        raise InputError(f"{where}: {len(degrees)} degrees and {len(knots)} knot vectors; {directions} are needed")
    p, k = [], []
    for degree, given in zip(degrees, knots, strict=True):
        if not isinstance(degree, (int, np.integer)) or isinstance(degree, bool) or degree < 1:
            raise InputError(f"{where}: degree {str(degree)[:30]} is not supported; it must be 1 or more")
        at_most(int(degree), MAX_DEGREE, f"as degree of {where}", "lower it")
        vector = numbers(given, f"{where}: knots")
        if vector.ndim != 1 or len(vector) < 2 * degree + 2:
            raise InputError(f"{where}: {vector.size} knots are too few for degree {degree}; {2 * degree + 2} needed")
        if (np.diff(vector) < 0).any():
            raise InputError(f"{where}: the knots decrease at number {int(np.argmax(np.diff(vector) < 0)) + 2}")
        if not vector[degree] < vector[-degree - 1]:
            raise InputError(f"{where}: the knots span nothing; correct them")
        p.append(int(degree))
        k.append(vector)
    return p, k


def _homogeneous(where: str, count: int, points: ArrayLike, weights: ArrayLike | None) -> FloatArray:
    """Points (count, 2), with their weights in a third column if there are any; not multiplied with them."""
    x = numbers(points, f"{where}: control points")
    if x.ndim != 2 or x.shape[1] not in (2, 3):
        raise InputError(
            f"{where}: control points of shape {x.shape} are not planar; only models in the plane are read"
        )
    if len(x) != count:
        raise InputError(f"{where}: {len(x)} control points, its knots and degrees need {count}")
    if x.shape[1] == 3 and (x[:, 2] != 0).any():
        raise InputError(f"{where}: lies in space (z is not 0); only models in the plane are supported")
    if weights is None:
        return x[:, :2]
    w = numbers(weights, f"{where}: weights").ravel()
    if len(w) != count:
        raise InputError(f"{where}: {len(w)} weights for {count} control points")
    if (w <= 0).any():
        raise InputError(f"{where}: weight {w.min():g} is not positive; correct it")
    return np.column_stack([x[:, :2], w])


def _clamped(
    where: str, knots: FloatArray, degree: int, values: FloatArray, axis: int
) -> tuple[FloatArray, FloatArray]:
    """Knots and values, untouched to the bit where they are clamped already."""
    if knots[degree] == knots[0] and knots[-degree - 1] == knots[-1]:
        return knots, values
    h = np.moveaxis(values, axis, 0).copy()
    rational = h.shape[-1] == 3
    if rational:
        h[..., :2] *= h[..., 2:]
    knots, h = clamp(knots, degree, h)
    if rational:
        h = np.concatenate([h[..., :2] / h[..., 2:], h[..., 2:]], axis=-1)
    return knots, np.moveaxis(h, 0, axis)


def _parts(values: FloatArray, rational: bool) -> tuple[FloatArray, FloatArray | None]:
    return values[..., :2], values[..., 2] if rational else None
