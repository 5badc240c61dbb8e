"""Which sides of patches are glued: found from coinciding control points, or stated and checked.

Two sides are the same if no control point is farther from its partner than rounding explains. How far that is depends
on the patches: six digits of a large model are more than a thin patch is thick. So a gap must be small against the
model, as written files demand, and against the thickness of every patch that gluing it would deform: of the two, and
of those that touch the ends of the sides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..numeric.arrays import FloatArray
from .basis import reverse_knots
from .patch import Patch
from .sides import CORNERS, Interface, Side
from .tolerances import OF_THICKNESS, point_tree, scaled, thickness, thinnest, tolerances

__all__ = ["check_interfaces", "infer_interfaces"]

#: Sides that are compared with a side, those with the nearest middles. In a valid model one coincides; files with
#: thousands of copies of a patch must not take thousands of comparisons a side.
NEAREST = 16


class _Sides(NamedTuple):
    """Sides of patches, four a patch in the order of `Side`: control points, and what tells them apart."""

    points: list[FloatArray]
    middles: FloatArray
    """(n, 4): mean of the end points, mean of all control points; neither depends on the sense."""
    thickness: FloatArray
    """(n,): of the patch."""


def infer_interfaces(patches: Sequence[Patch], tolerance: float | None = None) -> tuple[Interface, ...]:
    """Find interfaces from sides whose control points coincide.

    The closest sides are glued first. A gap counts as rounding up to 1e-5 of the model's diameter, and up to half the
    thickness (area by circumference, or a shorter side) of the patches that it would be taken from; so the sides of a
    thin patch are not glued to each other.

    Parameters
    ----------
    patches : sequence of Patch
    tolerance : float, optional
        Largest distance of coinciding control points; default 1e-5 of the model's diameter.

    Returns
    -------
    tuple of Interface
        In the order of the patches.
    """
    nets, unit = scaled(patches)
    largest, rounding = tolerances(nets)
    largest = largest if tolerance is None else tolerance / unit
    thick = np.array([thickness(net, rounding) for net in nets])
    sides = _sides(nets, thick)
    corners = np.array([net[corner] for net in nets for corner in CORNERS])
    tree = point_tree(corners)
    found: list[Interface] = []
    used: set[int] = set()
    for gap, i, j, backwards in sorted(_coinciding(sides, largest, rounding)):
        if i in used or j in used:
            continue
        if i // 4 == j // 4 and not gap < OF_THICKNESS * thick[i // 4]:
            continue
        if gap > rounding:
            ends = np.concatenate([sides.points[i][[0, -1]], sides.points[j][[0, -1]]])
            if gap > OF_THICKNESS * thinnest(tree, ends, 2 * gap, thick):
                continue
        used |= {i, j}
        found.append(Interface(i // 4, Side(i % 4 + 1), j // 4, Side(j % 4 + 1), backwards))
    return tuple(sorted(found, key=lambda f: (f.patch_a, f.side_a)))


def check_interfaces(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> None:
    """Raise `InputError` on interfaces that do not fit the patches, naming both sides.

    Gaps may be as large as `infer_interfaces` bridges.
    """
    points = np.concatenate([p.control_points.reshape(-1, 2) for p in patches])
    largest, rounding = tolerances([points])
    used: set[tuple[int, Side]] = set()
    for f in interfaces:
        name = f"interface {f.name}"
        for k, side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b)):
            if not 0 <= k < len(patches):
                raise InputError(f"{name}: there is no patch {k}")
            if (k, side) in used:
                raise InputError(f"{name}: {side.name.lower()} of patch {k} is in more than one interface")
            used.add((k, side))
        a, b = patches[f.patch_a], patches[f.patch_b]
        _check_knots(name, f, a, b)
        points_b = f.side_b.of(b.control_points)
        gap = np.abs(f.side_a.of(a.control_points) - (points_b[::-1] if f.reversed else points_b)).max()
        # The thickness is asked for only where something differs: most sides are equal to the bit.
        if gap > 0 and (gap > rounding or f.patch_a == f.patch_b):
            nets, unit = scaled((a, b))
            thin = unit * OF_THICKNESS * min(thickness(net, rounding / unit) for net in nets)
            tolerance = min(largest, thin)
            if gap > tolerance:
                what = "" if tolerance == largest else f", half the thickness of patch {_thinner(f, nets)}"
                raise InputError(
                    f"{name}: control points are {gap:.3g} apart (tolerance {tolerance:.3g}{what}); mend the file, or "
                    "leave the interfaces out to have them inferred"
                )


def _check_knots(name: str, f: Interface, a: Patch, b: Patch) -> None:
    axis_a, axis_b = f.side_a.axis, f.side_b.axis
    knots_b = reverse_knots(b.knots[axis_b]) if f.reversed else b.knots[axis_b]
    knots_a, length = a.knots[axis_a], np.ptp(a.knots[axis_a])
    if a.degrees[axis_a] != b.degrees[axis_b] or len(knots_a) != len(knots_b):
        raise InputError(f"{name}: degrees or knots differ along it; make the patches conform first")
    if np.abs((knots_a - knots_a[0]) / length - (knots_b - knots_b[0]) / np.ptp(knots_b)).max() > 1e-9:
        raise InputError(f"{name}: knots differ along it; make the patches conform first")


def _thinner(f: Interface, nets: Sequence[FloatArray]) -> int:
    return min(zip(nets, (f.patch_a, f.patch_b), strict=True), key=lambda pair: thickness(pair[0], 0.0))[1]


def _sides(nets: Sequence[FloatArray], thick: FloatArray) -> _Sides:
    points = [side.of(net) for net in nets for side in Side]
    middles = np.array([[*(p[0] + p[-1]) / 2, *p.mean(axis=0)] for p in points])
    return _Sides(points, middles, np.repeat(thick, 4))


def _coinciding(sides: _Sides, largest: float, rounding: float) -> Iterator[tuple[float, int, int, bool]]:
    """Pairs of sides that may be one by the thickness of their own patches: gap, sides, whether backwards."""
    reach = np.maximum(np.minimum(largest, OF_THICKNESS * sides.thickness), rounding)
    nearest = min(NEAREST, len(sides.points))
    _, neighbours = point_tree(sides.middles).query(sides.middles, nearest, p=np.inf, distance_upper_bound=reach.max())
    # Missing neighbours have the number n.
    pairs = {
        (min(i, j), max(i, j))
        for i, row in enumerate(np.asarray(neighbours).reshape(-1, nearest).tolist())
        for j in row
        if j != i and j < len(sides.points) and len(sides.points[i]) == len(sides.points[j])
    }
    for i, j in pairs:
        a, b = sides.points[i], sides.points[j]
        gap, backwards = min((float(np.abs(a - b).max()), False), (float(np.abs(a - b[::-1]).max()), True))
        # A side that is a point has nothing to glue.
        if gap <= min(reach[i], reach[j]) and np.ptp(a, axis=0).max() > max(2 * gap, rounding):
            yield gap, i, j, backwards
