"""splinepy, and gustaf, which draws its splines.

Sides are numbered as in G+Smo, but from 0; ``u`` runs fastest in control points. A `splinepy.Multipatch` says of each
side which other one it is glued to, or the negative number of the boundary that it belongs to, -1 unless set.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..errors import InputError, InputWarning
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import Interface, Side
from ..io.foreign import patch_of
from ..libraries import library
from ..numeric.arrays import IntArray
from .sequences import listed

__all__ = ["from_splinepy", "to_splinepy"]

#: What a boundary is called that is known by its number only.
NUMBERED = "boundary "


def from_splinepy(splines: Any) -> MultiPatch:
    """See `MultiPatch.from_splinepy`."""
    glued = hasattr(splines, "patches")
    # A Multipatch has control points, too.
    alone = not glued and hasattr(splines, "control_points")
    given = [splines] if alone else listed(splines.patches if glued else splines, "a spline of splinepy")
    patches = [_patch(spline, f"spline {k}") for k, spline in enumerate(given)]
    if not glued:
        return MultiPatch(patches)
    table = np.asarray(splines.interfaces)
    return MultiPatch(patches, _interfaces(patches, table), labels=_labels(table))


def _patch(spline: Any, where: str) -> Patch:
    try:
        degrees, points = np.asarray(spline.degrees).tolist(), np.asarray(spline.control_points)
        rational = bool(spline.is_rational)
        if spline.has_knot_vectors:
            knots = [np.asarray(knots, dtype=np.float64) for knots in spline.knot_vectors]
        else:
            knots = [np.repeat([0.0, 1.0], p + 1) for p in degrees]
    except AttributeError as error:
        raise InputError(f"{where}: not a spline of splinepy ({error}); pass splines or a Multipatch") from None
    if len(degrees) != 2:
        raise InputError(f"{where}: has {len(degrees)} parameters; only planar patches, with 2, are supported")
    return patch_of(where, degrees, knots, points, np.asarray(spline.weights) if rational else None, first_fastest=True)


def _interfaces(patches: Sequence[Patch], table: IntArray) -> list[Interface]:
    found = []
    for face, other in enumerate(table.ravel().tolist()):
        # Each interface is there twice.
        if other > face:
            (a, s), (b, t) = divmod(face, 4), divmod(other, 4)
            side_a, side_b = Side(s + 1), Side(t + 1)
            x, y = side_a.of(patches[a].control_points), side_b.of(patches[b].control_points)
            backwards = len(x) == len(y) and np.abs(x - y[::-1]).max() < np.abs(x - y).max()
            found.append(Interface(a, side_a, b, side_b, bool(backwards)))
    return found


def _labels(table: IntArray) -> dict[str, list[tuple[int, int]]]:
    """Sides by the numbers of their boundaries but -1, which all have at first."""
    numbers = sorted({-int(n) for n in table[table < -1]})
    return {
        f"{NUMBERED}{n}": [(int(k), int(side) + 1) for k, side in zip(*np.nonzero(table == -n), strict=True)]
        for n in numbers
    }


def to_splinepy(mp: MultiPatch) -> Any:
    """See `MultiPatch.to_splinepy`."""
    splinepy = library("splinepy", user="to_splinepy")
    table = np.full((len(mp), 4), -1, np.int64)
    for f in mp.interfaces:
        a, b = 4 * f.patch_a + f.side_a - 1, 4 * f.patch_b + f.side_b - 1
        table.flat[a], table.flat[b] = b, a
    _mark(table, mp)
    return splinepy.Multipatch([_spline(splinepy, patch) for patch in mp], table)


def _mark(table: IntArray, mp: MultiPatch) -> None:
    """Give labelled sides the numbers of boundaries, and say which."""
    numbers, taken = _numbers(mp.sides), []
    for name, number in numbers.items():
        for k, side in mp.sides[name]:
            if table[k, side - 1] == -1:
                table[k, side - 1] = -number
            else:
                taken.append(f"{name!r} of patch {k} {side.name.lower()}")
    names = [f"{name!r} is {number}" for name, number in numbers.items() if name != f"{NUMBERED}{number}"]
    if names:
        warnings.warn(f"splinepy numbers boundaries: {', '.join(names)}", InputWarning, stacklevel=5)
    if taken:
        what = f"splinepy has one number a side, of the boundary only; left out: {', '.join(taken)}"
        warnings.warn(what, InputWarning, stacklevel=5)


def _numbers(names: Iterable[str]) -> dict[str, int]:
    """Numbers of boundaries from 2: those that names were made of, others in turn."""
    numbers = {name: _number(name) for name in names}
    free = (n for n in range(2, 3 + 2 * len(numbers)) if n not in numbers.values())
    return {name: next(free) if number is None else number for name, number in numbers.items()}


def _number(name: str) -> int | None:
    digits = name.removeprefix(NUMBERED)
    known = name == NUMBERED + digits and digits.isdecimal() and len(digits) < 10 and int(digits) > 1
    return int(digits) if known else None


def _spline(splinepy: Any, patch: Patch) -> Any:
    fields = {
        "degrees": list(patch.degrees),
        "knot_vectors": [knots.tolist() for knots in patch.knots],
        "control_points": patch.control_points.swapaxes(0, 1).reshape(-1, 2),
    }
    if patch.weights is None:
        return splinepy.BSpline(**fields)
    return splinepy.NURBS(**fields, weights=patch.weights.T.reshape(-1, 1))
