"""Signed areas of polygons, and of patches and loops by integrals along sides."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .._core import gauss
from ..numeric.arrays import FloatArray, IntArray, distinct
from ..numeric.dense import product
from .basis import collocation_matrix
from .patch import Patch
from .rational import rational_basis
from .sides import Side

__all__ = [
    "SideGroup",
    "area_form",
    "enclosed_areas",
    "group_sides",
    "numbered",
    "polygon_area",
    "rational_area_form",
    "sides_around",
]


#: The sides of a right-handed patch counter-clockwise, and whether along or against their parameters.
AROUND = ((Side.SOUTH, 1.0), (Side.EAST, 1.0), (Side.NORTH, -1.0), (Side.WEST, -1.0))


#: Gauss nodes a span for quotients: areas of arcs of 120 degrees are exact to rounding.
QUOTIENT_NODES = 24
#: Coordinates whose products neither overflow nor underflow where it matters.
SQUARES = (2.0**-200, 2.0**200)


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
    return float(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


class SideGroup(NamedTuple):
    """Sides of patches with one area form `form`: their owners, signs, control points and origins.

    `entries` (k, n) and `origins` (k,) number the control points patch by patch.
    """

    form: FloatArray
    owners: IntArray
    signs: FloatArray
    entries: IntArray
    origins: IntArray


def group_sides(patches: Sequence[Patch], sides: Iterable[tuple[int, int, Side, float, int]]) -> list[SideGroup]:
    """Group sides by degree and knots: rows (owner, patch, side, sign, origin) for `enclosed_areas`."""
    numbers = numbered([patch.shape for patch in patches])
    groups: dict[tuple[bytes, int, bool], list[tuple[int, float, IntArray, int]]] = defaultdict(list)
    for owner, k, side, sign, origin in sides:
        patch = patches[k]
        key = (patch.knots[side.axis].tobytes(), patch.degrees[side.axis], patch.weights is not None)
        groups[key].append((owner, sign, side.of(numbers[k]), origin))
    found = []
    for (knots, degree, rational), members in groups.items():
        owners, signs, entries, origins = (np.array(column) for column in zip(*members, strict=True))
        form = np.eye(entries.shape[1], k=1) if rational else area_form(knots, degree)
        found.append(SideGroup(form, owners, signs, entries, origins))
    return found


def enclosed_areas(patches: Sequence[Patch], groups: Sequence[SideGroup], n: int) -> FloatArray:
    """Signed areas by ½∮ x dy - y dx of `n` owners of sides: exact up to rounding, or of rational sides' polygons.

    In units of the coordinates squared, or of a power of two where these squares would over- or underflow.
    """
    control = np.concatenate([patch.control_points.reshape(-1, 2) for patch in patches])
    size = float(np.abs(control).max())
    if not SQUARES[0] < size < SQUARES[1]:
        control = np.ldexp(control, -int(np.frexp(size)[1]))
    areas = np.zeros(n)
    for form, owners, signs, entries, origins in groups:
        x, y = both = (control[entries] - control[origins][:, None]).transpose(2, 0, 1)
        with_x, with_y = product(both, form)
        areas += np.bincount(owners, signs * 0.5 * (with_x * y - with_y * x).sum(axis=1), n)
    return areas


def sides_around(patches: Sequence[Patch]) -> list[SideGroup]:
    """The sides of the patches counter-clockwise, owned by them: the same for patches of the same shapes and knots."""
    origins = [int(numbers[0, 0]) for numbers in numbered([patch.shape for patch in patches])]
    return group_sides(patches, [(k, k, side, sign, at) for k, at in enumerate(origins) for side, sign in AROUND])


@lru_cache(maxsize=256)
def area_form(knot_bytes: bytes, degree: int) -> FloatArray:
    """Matrix of ∫ N_i N_j' dt."""
    knots = np.frombuffer(knot_bytes)
    nodes, weights = _on_spans(knots, *gauss(degree))
    return np.asarray(
        product(collocation_matrix(knots, degree, nodes).T * weights, collocation_matrix(knots, degree, nodes, 1))
    )


@lru_cache(maxsize=256)
def rational_area_form(knot_bytes: bytes, degree: int, weight_bytes: bytes) -> FloatArray:
    """Matrix of ∫ R_i R_j' dt of the basis functions with weights."""
    knots = np.frombuffer(knot_bytes)
    nodes, weights = _on_spans(knots, *np.polynomial.legendre.leggauss(QUOTIENT_NODES))
    value, slope = rational_basis(knots, degree, np.frombuffer(weight_bytes), nodes)
    return np.asarray(product(value.T * weights, slope))


def _on_spans(knots: FloatArray, t: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of a rule on [-1, 1] on every knot span."""
    breaks = distinct(knots)
    half = np.diff(breaks)[:, None] / 2
    return (breaks[:-1, None] + half * (t + 1)).ravel(), (half * w).ravel()
