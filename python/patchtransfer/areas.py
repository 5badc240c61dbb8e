"""Signed areas of polygons, and of patches by integrals along their sides."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from .multipatch import Side
from .splines import FloatArray, IntArray, Patch, collocation_matrix

__all__ = ["numbered", "polygon_area", "side_areas", "signed_areas"]


#: The sides of a right-handed patch counter-clockwise, and whether along or against their parameters.
AROUND = ((Side.SOUTH, 1.0), (Side.EAST, 1.0), (Side.NORTH, -1.0), (Side.WEST, -1.0))


def numbered(shapes: Sequence[tuple[int, int]]) -> list[IntArray]:
    """Numbers 0, 1, ... of the control points of patches of these shapes, patch by patch."""
    numbers, first = [], 0
    for m, n in shapes:
        numbers.append(first + np.arange(m * n).reshape(m, n))
        first += m * n
    return numbers


def polygon_area(points: FloatArray) -> float:
    """Signed area of a closed polygon (n, 2)."""
    # About a vertex: far from the origin the products would lose the area.
    x, y = (points - points[0]).T
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def signed_areas(patches: Sequence[Patch], kept: dict[str, Any] | None = None) -> FloatArray:
    """Signed areas of patches by the boundary integral ½∮ x dy - y dx, exact up to rounding.

    For a rational patch its sides' control polygon is taken, whose area has the same sign unless the sides bend
    strongly; the certificate checks the sign. `kept` is for what patches of the same shapes and knots have in common.
    """
    if any(patch.weights is not None for patch in patches):
        sides = [(patch, side, patch.control_points[0, 0]) for patch in patches for side, _ in AROUND]
        return np.asarray(side_areas(sides).reshape(-1, 4) @ [sign for _, sign in AROUND])
    kept = {} if kept is None else kept
    if "sides around patches" not in kept:
        kept["sides around patches"] = _sides_around(patches)
    control = np.concatenate([patch.control_points.reshape(-1, 2) for patch in patches])
    areas = np.zeros(len(patches))
    for form, owner, sign, entries, origin in kept["sides around patches"]:
        x, y = (control[entries] - control[origin][:, None]).transpose(2, 0, 1)
        areas += np.bincount(owner, sign * _half_integrals(x, y, form), len(patches))
    return areas


def _sides_around(patches: Sequence[Patch]) -> list[tuple[FloatArray, IntArray, FloatArray, IntArray, IntArray]]:
    """Sides of equal degree and knots together: matrix of `_area_form`, patches, signs, entries and origins.

    Entries number the control points patch by patch; the origin of a side is its patch's first one.
    """
    groups: dict[tuple[bytes, int], list[tuple[int, float, IntArray, int]]] = defaultdict(list)
    for k, (patch, entries) in enumerate(zip(patches, numbered([p.shape for p in patches]), strict=True)):
        for side, sign in AROUND:
            key = (patch.knots[side.axis].tobytes(), patch.degrees[side.axis])
            groups[key].append((k, sign, side.of(entries), int(entries[0, 0])))
    found = []
    for key, members in groups.items():
        owners, signs, sides, origins = zip(*members, strict=True)
        found.append((_area_form(*key), np.array(owners), np.array(signs), np.array(sides), np.array(origins)))
    return found


def _half_integrals(x: FloatArray, y: FloatArray, form: FloatArray) -> FloatArray:
    """½∫ x dy - y dx of curves with coordinates (k, n)."""
    return np.asarray(0.5 * (((x @ form) * y).sum(axis=1) - ((y @ form) * x).sum(axis=1)))


def side_areas(sides: Sequence[tuple[Patch, Side, FloatArray]]) -> FloatArray:
    """½∫ x dy - y dx along sides of patches in the sense of their parameters, each about an origin."""
    areas = np.empty(len(sides))
    groups: dict[tuple[bytes, int], list[int]] = defaultdict(list)
    for k, (patch, side, origin) in enumerate(sides):
        if patch.weights is None:
            groups[patch.knots[side.axis].tobytes(), patch.degrees[side.axis]].append(k)
        else:
            x, y = (side.of(patch.control_points) - origin).T
            areas[k] = 0.5 * (x[:-1] @ y[1:] - y[:-1] @ x[1:])
    for key, members in groups.items():
        points = np.array([sides[k][1].of(sides[k][0].control_points) for k in members])
        x, y = (points - np.array([sides[k][2] for k in members])[:, None]).transpose(2, 0, 1)
        areas[members] = _half_integrals(x, y, _area_form(*key))
    return areas


@lru_cache(maxsize=256)
def _area_form(knot_bytes: bytes, degree: int) -> FloatArray:
    """Matrix of ∫ N_i N_j' dt."""
    knots = np.frombuffer(knot_bytes)
    breaks = np.unique(knots)
    t, w = np.polynomial.legendre.leggauss(degree)
    half = np.diff(breaks)[:, None] / 2
    nodes, weights = (breaks[:-1, None] + half * (t + 1)).ravel(), (half * w).ravel()
    return np.asarray(
        (collocation_matrix(knots, degree, nodes).T * weights) @ collocation_matrix(knots, degree, nodes, 1)
    )
