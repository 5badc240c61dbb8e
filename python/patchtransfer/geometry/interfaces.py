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
from .basis import knot_spans, reverse_knots
from .mending import conform_command
from .patch import Patch
from .sides import CORNERS, Interface, Side
from .tolerances import OF_THICKNESS, point_tree, scaled, thickness, thinnest, tolerances

__all__ = ["SAME_KNOT", "Misfit", "check_interfaces", "infer_interfaces", "misfits"]

#: Sides that are compared with a side, those with the nearest middles. In a valid model one coincides; files with
#: thousands of copies of a patch must not take thousands of comparisons a side.
NEAREST = 16
#: Knots are the same if they differ by less, with parameters mapped to [0, 1].
SAME_KNOT = 1e-9


class Misfit(NamedTuple):
    """An interface that does not fit its patches: its number, what is wrong ("names", "knots" or "gap"), and a line.

    `gap` is how far apart the sides are: their control points, or their ends where the knots differ. `meant`
    says whether that is less than the patches are thick: else the sides are hardly those that were meant.
    """

    number: int
    kind: str
    reason: str
    gap: float = 0.0
    meant: bool = True

    @property
    def advice(self) -> str:
        """What to do about it."""
        if self.kind == "names":
            return "correct it"
        if not self.meant:
            return "name the sides that meet, or leave the interfaces out to have them found"
        command = conform_command(self.gap if self.kind == "gap" else 0.0)
        return f"leave it out and run `{command}`, or take MultiPatch.conform"


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
    for misfit in misfits(patches, interfaces):
        raise InputError(f"{misfit.reason}; {misfit.advice}")


def misfits(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> Iterator[Misfit]:
    """Interfaces that do not fit the patches, in their order."""
    points = np.concatenate([p.control_points.reshape(-1, 2) for p in patches])
    largest, rounding = tolerances([points])
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
            gap = _distance(f, a, b, ends_only=True)
            yield Misfit(i, "knots", f"{name}: {reason}", gap, _meant(f, gap, a, b))
        elif reason := _gap(f, a, b, largest, rounding):
            gap = _distance(f, a, b)
            yield Misfit(i, "gap", f"{name}: {reason}", gap, _meant(f, gap, a, b))


def _gap(f: Interface, a: Patch, b: Patch, largest: float, rounding: float) -> str | None:
    """What parts the control points of two sides."""
    gap = _distance(f, a, b)
    # The thickness is asked for only where something differs: most sides are equal to the bit.
    if gap > 0 and (gap > rounding or f.patch_a == f.patch_b):
        nets, unit = scaled((a, b))
        thin = unit * OF_THICKNESS * min(thickness(net, rounding / unit) for net in nets)
        tolerance = min(largest, thin)
        if gap > tolerance:
            what = "" if tolerance == largest else f", half the thickness of patch {_thinner(f, nets)}"
            return f"control points are {gap:.3g} apart (tolerance {tolerance:.3g}{what})"
    return None


def _meant(f: Interface, gap: float, a: Patch, b: Patch) -> bool:
    """Whether two sides are nearer to each other than their patches are thick."""
    nets, unit = scaled((a, b))
    return f.patch_a != f.patch_b and gap <= unit * min(thickness(net, 0.0) for net in nets)


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
        return _differences(a, b, axis_a, axis_b)
    if np.abs((knots_a - knots_a[0]) / length - (knots_b - knots_b[0]) / np.ptp(knots_b)).max() > SAME_KNOT:
        return _differences(a, b, axis_a, axis_b)
    return None


def _differences(a: Patch, b: Patch, axis_a: int, axis_b: int) -> str:
    p, q = a.degrees[axis_a], b.degrees[axis_b]
    if p != q:
        return f"degrees differ: {p} and {q}"
    m, n = (len(knot_spans(patch.knots[axis])) - 1 for patch, axis in ((a, axis_a), (b, axis_b)))
    return f"knots differ: {m} and {n} spans" + (", but not the same ones" if m == n else "")


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
