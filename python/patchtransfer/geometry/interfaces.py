"""Which sides of patches are glued: found from coinciding control points, or stated and checked.

Two sides are the same if no control point is farther from its partner than rounding explains. How far that is depends
on the patches: six digits of a large model are more than a thin patch is thick. So a gap must be small against the
model, as written files demand, and against the thickness of every patch that gluing it would deform: of the two, and
of those that touch the ends of the sides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import InputError
from ..numeric.arrays import FloatArray, IntArray
from .basis import reverse_knots
from .patch import Patch
from .sides import CORNERS, Interface, Side

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

__all__ = ["Misfit", "check_interfaces", "infer_interfaces", "misfits"]

#: Control points of one point may differ by this much, relative to the model's diameter: the last of six digits.
COINCIDENCE = 1e-5
#: ... and by this part of the thickness of the patches. A straight patch's own opposite sides are twice it apart.
OF_THICKNESS = 0.5
#: ... but always by this many units of roundoff of the largest coordinate: sides that were computed one by one.
ROUNDING_ULPS = 16.0
#: Sides that are compared with a side, those with the nearest middles. In a valid model one coincides; files with
#: thousands of copies of a patch must not take thousands of comparisons a side.
NEAREST = 16
#: Patch corners that are looked at around the end of a side: more than meet in any point of a valid model.
NEAREST_CORNERS = 64


class Misfit(NamedTuple):
    """An interface that does not fit its patches: its number, what is wrong ("names", "knots" or "gap"), and a line.

    `gap` is how far apart the sides are: their control points, or their ends where the knots differ.
    """

    number: int
    kind: str
    reason: str
    gap: float = 0.0


ADVICE = {
    "names": "; correct it",
    "knots": "; make the patches conform first",
    "gap": "; mend the file, or leave the interfaces out to have them inferred",
}


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
    nets, unit = _scaled(patches)
    largest, rounding = _tolerances(nets)
    largest = largest if tolerance is None else tolerance / unit
    thickness = np.array([_thickness(net, rounding) for net in nets])
    sides = _sides(nets, thickness)
    corners = np.array([net[corner] for net in nets for corner in CORNERS])
    tree = _tree(corners)
    found: list[Interface] = []
    used: set[int] = set()
    for gap, i, j, backwards in sorted(_coinciding(sides, largest, rounding)):
        if i in used or j in used:
            continue
        if i // 4 == j // 4 and not gap < OF_THICKNESS * thickness[i // 4]:
            continue
        if gap > rounding:
            ends = np.concatenate([sides.points[i][[0, -1]], sides.points[j][[0, -1]]])
            if gap > OF_THICKNESS * _thinnest(tree, ends, 2 * gap, thickness):
                continue
        used |= {i, j}
        found.append(Interface(i // 4, Side(i % 4 + 1), j // 4, Side(j % 4 + 1), backwards))
    return tuple(sorted(found, key=lambda f: (f.patch_a, f.side_a)))


def check_interfaces(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> None:
    """Raise `InputError` on interfaces that do not fit the patches, naming both sides.

    Gaps may be as large as `infer_interfaces` bridges.
    """
    for misfit in misfits(patches, interfaces):
        raise InputError(f"{misfit.reason}{ADVICE[misfit.kind]}")


def misfits(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> Iterator[Misfit]:
    """Interfaces that do not fit the patches, in their order."""
    points = np.concatenate([p.control_points.reshape(-1, 2) for p in patches])
    largest, rounding = _tolerances([points])
    used: set[tuple[int, Side]] = set()
    for i, f in enumerate(interfaces):
        stray = [k for k in (f.patch_a, f.patch_b) if not 0 <= k < len(patches)]
        sides = [(f.patch_a, f.side_a), (f.patch_b, f.side_b)]
        twice = [s for n, s in enumerate(sides) if s in used or s in sides[:n]]
        used |= set(sides)
        name = f"interface {f.name}"
        if stray:
            yield Misfit(i, "names", f"{name}: there is no patch {stray[0]}")
            continue
        if twice:
            k, side = twice[0]
            yield Misfit(i, "names", f"{name}: {side.name.lower()} of patch {k} is in more than one interface")
            continue
        a, b = patches[f.patch_a], patches[f.patch_b]
        if reason := _other_knots(f, a, b):
            yield Misfit(i, "knots", f"{name}: {reason}", _distance(f, a, b, ends_only=True))
        elif reason := _gap(f, a, b, largest, rounding):
            yield Misfit(i, "gap", f"{name}: {reason}", _distance(f, a, b))


def _gap(f: Interface, a: Patch, b: Patch, largest: float, rounding: float) -> str | None:
    """What parts the control points of two sides."""
    gap = _distance(f, a, b)
    # The thickness is asked for only where something differs: most sides are equal to the bit.
    if gap > 0 and (gap > rounding or f.patch_a == f.patch_b):
        nets, unit = _scaled((a, b))
        thin = unit * OF_THICKNESS * min(_thickness(net, rounding / unit) for net in nets)
        tolerance = min(largest, thin)
        if gap > tolerance:
            what = "" if tolerance == largest else f", half the thickness of patch {_thinner(f, nets)}"
            return f"control points are {gap:.3g} apart (tolerance {tolerance:.3g}{what})"
    return None


def _distance(f: Interface, a: Patch, b: Patch, ends_only: bool = False) -> float:
    """Largest distance of the control points of two sides."""
    points_a, points_b = f.side_a.of(a.control_points), f.side_b.of(b.control_points)
    points_b = points_b[::-1] if f.reversed else points_b
    kept = [0, -1] if ends_only else slice(None)
    return float(np.abs(points_a[kept] - points_b[kept]).max())


def _other_knots(f: Interface, a: Patch, b: Patch) -> str | None:
    """How degrees or knots of two sides differ."""
    axis_a, axis_b = f.side_a.axis, f.side_b.axis
    knots_b = reverse_knots(b.knots[axis_b]) if f.reversed else b.knots[axis_b]
    knots_a, length = a.knots[axis_a], np.ptp(a.knots[axis_a])
    if a.degrees[axis_a] != b.degrees[axis_b] or len(knots_a) != len(knots_b):
        return "degrees or knots differ along it"
    if np.abs((knots_a - knots_a[0]) / length - (knots_b - knots_b[0]) / np.ptp(knots_b)).max() > 1e-9:
        return "knots differ along it"
    return None


def _scaled(patches: Sequence[Patch]) -> tuple[list[FloatArray], float]:
    """Control points by a power of two of the largest coordinate: areas neither over- nor underflow."""
    size = max(float(np.abs(p.control_points).max()) for p in patches)
    # Kept off the ends of the range, where the power itself would overflow.
    unit = float(np.ldexp(1.0, int(np.clip(np.frexp(size)[1], -1000, 1000))))
    return [p.control_points / unit for p in patches], unit


def _tolerances(nets: Sequence[FloatArray]) -> tuple[float, float]:
    """Largest gap by the model's diameter, and the gap that rounding of its coordinates explains."""
    points = np.concatenate([net.reshape(-1, 2) for net in nets])
    diameter = float(np.linalg.norm(np.ptp(points, axis=0)))
    rounding = ROUNDING_ULPS * float(np.finfo(float).eps) * float(np.abs(points).max())
    return COINCIDENCE * diameter, rounding


def _thickness(net: FloatArray, rounding: float) -> float:
    """Area of a control net by its circumference, or the shortest side if that is less and no point.

    Moving a side by less than the former cannot take the area away, by less than the latter cannot turn the side.
    """
    a, b, c, d = net[:-1, :-1], net[1:, :-1], net[1:, 1:], net[:-1, 1:]
    area = 0.5 * float(sum(np.abs(_cross(q - p, r - p)).sum() for p, q, r in ((a, b, c), (a, c, d))))
    lengths = [float(np.hypot(*np.diff(side.of(net), axis=0).T).sum()) for side in Side]
    around = sum(lengths)
    if around == 0:
        return 0.0
    return min([area / around, *(length for length in lengths if length > rounding)])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _thinner(f: Interface, nets: Sequence[FloatArray]) -> int:
    return min(zip(nets, (f.patch_a, f.patch_b), strict=True), key=lambda pair: _thickness(pair[0], 0.0))[1]


def _sides(nets: Sequence[FloatArray], thickness: FloatArray) -> _Sides:
    points = [side.of(net) for net in nets for side in Side]
    middles = np.array([[*(p[0] + p[-1]) / 2, *p.mean(axis=0)] for p in points])
    return _Sides(points, middles, np.repeat(thickness, 4))


def _coinciding(sides: _Sides, largest: float, rounding: float) -> Iterator[tuple[float, int, int, bool]]:
    """Pairs of sides that may be one by the thickness of their own patches: gap, sides, whether backwards."""
    reach = np.maximum(np.minimum(largest, OF_THICKNESS * sides.thickness), rounding)
    nearest = min(NEAREST, len(sides.points))
    _, neighbours = _tree(sides.middles).query(sides.middles, nearest, p=np.inf, distance_upper_bound=reach.max())
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


def _tree(points: FloatArray) -> cKDTree:
    # Only models without a list of interfaces need it, and it takes as long to load as to check them.
    from scipy.spatial import cKDTree

    return cKDTree(points)


def _thinnest(tree: cKDTree, ends: FloatArray, radius: float, thickness: FloatArray) -> float:
    """Smallest thickness of the patches with a corner near one of the points."""
    nearest = min(NEAREST_CORNERS, tree.n)
    _, corners = tree.query(ends, nearest, p=np.inf, distance_upper_bound=radius)
    found: IntArray = np.unique(np.asarray(corners, dtype=np.int64))
    return float(thickness[found[found < tree.n] // 4].min())
