"""Where sides that no interface glues coincide, wholly or partly: what keeps a model from conforming.

Two sides that run along each other do so from one end of either to another, so it is enough to look which ends lie on
which sides. The pieces between are compared in a common spline space: with other knots or another degree they are the
same curve if their control points agree there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...numeric.arrays import FloatArray, IntArray, distinct
from ..areas import enclosed_areas, sides_around
from ..basis import knot_spans
from ..curve import BSplineCurve
from ..interfaces import SAME_KNOT
from ..patch import Patch
from ..sides import CORNERS, Side
from ..tolerances import OF_THICKNESS, point_tree, scaled, thickness, thinnest, tolerances
from .nearest import nearest_on_curve

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

__all__ = ["Overlap", "SideOf", "missing_knots", "overlaps", "whole_pairs"]

#: Points on a piece for which another one is looked through when control points differ.
PROBES = 9

SideOf = tuple[int, Side]


class Overlap(NamedTuple):
    """Two sides, or pieces of them, that coincide.

    Attributes
    ----------
    gap : float
        Largest difference of the control points in a common spline space, of weights by the size of the piece.
    a, b : tuple of (patch, Side)
    end_gap : float
        Distance of the pieces' ends: what others that meet there would be moved by.
    range_a, range_b : tuple of float
        First and last parameter of the piece, from 0 to 1 along the side.
    reversed : bool
        Whether the pieces run in opposite directions.
    same_speed : bool
        Whether the points at equal parts of the pieces coincide; else only the curves do.
    parts_a, parts_b : tuple of int
        Degree and number of knot spans of the pieces.
    same_knots : bool
        Whether their knots agree as they are, in the sense of the pieces.
    """

    gap: float
    a: SideOf
    b: SideOf
    end_gap: float
    range_a: tuple[float, float]
    range_b: tuple[float, float]
    reversed: bool
    same_speed: bool
    parts_a: tuple[int, int]
    parts_b: tuple[int, int]
    same_knots: bool

    @property
    def whole(self) -> bool:
        """Whether the sides coincide from end to end."""
        return self.range_a == self.range_b == (0.0, 1.0)


class _Free(NamedTuple):
    """Sides in no interface."""

    names: list[SideOf]
    curves: list[BSplineCurve]
    reach: FloatArray
    """How far from each another side may be."""


def overlaps(
    patches: Sequence[Patch], glued: Collection[SideOf], limit: float, part: float = OF_THICKNESS
) -> list[Overlap]:
    """Find sides that coincide and are not glued, the closest first.

    Parameters
    ----------
    patches : sequence of Patch
    glued : collection of (patch, Side)
        Sides that are left out.
    limit : float
        Largest gap; rounding always counts.
    part : float
        Of the patches' thickness, up to which a gap counts. Sides that move to their mean may take all of it: a
        straight patch's own opposite sides are twice it apart.
    """
    nets, unit = scaled(patches)
    _, rounding = tolerances(nets)
    free = _free_sides(patches, nets, glued, limit / unit, part, rounding)
    neighbours = _Neighbours(patches, nets, rounding)
    found = []
    for i, j, pair in _coinciding(free):
        k, m = pair.a[0], pair.b[0]
        if k == m and not pair.gap < OF_THICKNESS * thickness(nets[k], rounding):
            continue
        if neighbours.on_the_same_side(pair):
            continue
        ends = np.array([point for c in (free.curves[i], free.curves[j]) for point in (c.start, c.end)])
        if pair.end_gap > rounding and pair.end_gap > part * neighbours.thinnest(ends, 2 * pair.end_gap):
            continue
        found.append(pair._replace(gap=pair.gap * unit, end_gap=pair.end_gap * unit))
    return sorted(found)


class _Neighbours:
    """Where patches lie; found only when it is asked for, for in most models no sides coincide unglued."""

    def __init__(self, patches: Sequence[Patch], nets: Sequence[FloatArray], rounding: float) -> None:
        self._patches, self._nets, self._rounding = tuple(patches), nets, rounding

    @cached_property
    def _mirrored(self) -> IntArray:
        """Whether patches are left-handed."""
        return np.asarray(enclosed_areas(self._patches, sides_around(self._patches), len(self._patches)) < 0, np.int64)

    def on_the_same_side(self, pair: Overlap) -> bool:
        """Whether two patches overlap beside their sides, instead of meeting there."""
        # With its patch on the left, a side runs against its parameter or not.
        against = [(side in (Side.NORTH, Side.WEST)) != bool(self._mirrored[k]) for k, side in (pair.a, pair.b)]
        return (against[0] != against[1]) == pair.reversed

    @cached_property
    def _known(self) -> tuple[cKDTree, FloatArray]:
        thick = np.array([thickness(net, self._rounding) for net in self._nets])
        return point_tree(np.array([net[corner] for net in self._nets for corner in CORNERS])), thick

    def thinnest(self, ends: FloatArray, radius: float) -> float:
        """Smallest thickness of those with a corner near one of the points."""
        tree, thick = self._known
        return thinnest(tree, ends, radius, thick)


def whole_pairs(found: Sequence[Overlap]) -> list[Overlap]:
    """Those that an interface can glue, no side twice: from end to end at the same speed, the closest first."""
    used: set[SideOf] = set()
    pairs = []
    for pair in found:
        if pair.whole and pair.same_speed and not used & {pair.a, pair.b}:
            used |= {pair.a, pair.b}
            pairs.append(pair)
    return pairs


def _free_sides(
    patches: Sequence[Patch],
    nets: Sequence[FloatArray],
    glued: Collection[SideOf],
    limit: float,
    part: float,
    rounding: float,
) -> _Free:
    names, curves, reach = [], [], []
    for k, (patch, net) in enumerate(zip(patches, nets, strict=True)):
        open_sides = [side for side in Side if (k, side) not in glued]
        own = max(min(limit, part * thickness(net, rounding)), rounding) if open_sides else 0.0
        for side in open_sides:
            points = side.of(net)
            # A side that is a point has nothing to glue.
            if not np.ptp(points, axis=0).max() > 2 * own:
                continue
            weights = None if patch.weights is None else side.of(patch.weights)
            axis = side.axis
            names.append((k, side))
            curves.append(BSplineCurve._trusted(patch.knots[axis], patch.degrees[axis], points, weights))
            reach.append(own)
    return _Free(names, curves, np.array(reach))


def _incidences(free: _Free) -> dict[tuple[int, int], dict[int, tuple[float, ...]]]:
    """Ends on sides: by the numbers of (side, other side), the other's ends (0, 1) with parameters from 0 to 1."""
    found: dict[tuple[int, int], dict[int, tuple[float, ...]]] = defaultdict(dict)
    if not free.curves:
        return found
    ends = np.array([point for c in free.curves for point in (c.start, c.end)])
    order = np.argsort(ends[:, 0], kind="stable")
    sorted_x = ends[order, 0]
    for i, curve in enumerate(free.curves):
        low = curve.control_points.min(axis=0) - free.reach[i]
        high = curve.control_points.max(axis=0) + free.reach[i]
        near = order[np.searchsorted(sorted_x, low[0]) : np.searchsorted(sorted_x, high[0], side="right")]
        near = near[(ends[near, 1] >= low[1]) & (ends[near, 1] <= high[1]) & (near // 2 != i)]
        reach = np.minimum(free.reach[i], free.reach[near // 2])
        at_end = np.array([np.abs(ends[near] - end).max(axis=1) <= reach for end in (curve.start, curve.end)])
        for e, first, last in zip(near, *at_end, strict=True):
            if first or last:
                found[i, e // 2][e % 2] = tuple(t for t, here in ((0.0, first), (1.0, last)) if here)
        inner = ~at_end.any(axis=0)
        if inner.any():
            t, distance = nearest_on_curve(curve, ends[near[inner]])
            fractions = (t - curve.knots[0]) / (curve.knots[-1] - curve.knots[0])
            for e, f, lies_on in zip(near[inner], fractions, distance <= reach[inner], strict=True):
                if lies_on and 0 < f < 1:
                    found[i, e // 2][e % 2] = (float(f),)
    return found


def _coinciding(free: _Free) -> Iterator[tuple[int, int, Overlap]]:
    """Two sides (numbers), and how they coincide."""
    on = _incidences(free)
    for i, j in sorted({(min(pair), max(pair)) for pair in on}):
        on_i, on_j = on.get((i, j), {}), on.get((j, i), {})
        at_i = {t for ts in on_i.values() for t in ts} | {float(end) for end in on_j}
        at_j = {t for ts in on_j.values() for t in ts} | {float(end) for end in on_i}
        found = [
            pair
            for range_i in _ranges(free, i, at_i)
            for range_j in _ranges(free, j, at_j)
            if (pair := _compared(free, i, j, range_i, range_j)) is not None
        ]
        # The whole of a closed side coincides with a closed other one, but from another start.
        found = [pair for pair in found if pair.same_speed] or found[:1]
        yield from ((i, j, pair) for pair in ([pair for pair in found if pair.whole] or found))


def _ranges(free: _Free, i: int, at: set[float]) -> list[tuple[float, float]]:
    """Pieces of a side between places where ends meet it."""
    places = sorted(at)
    if len(places) < 2:
        return []
    whole = (places[0], places[-1])
    closed = np.abs(free.curves[i].start - free.curves[i].end).max() <= free.reach[i]
    # Where a closed side begins, it also ends, and a piece may lie to either hand.
    return [whole, *pairwise(places)] if closed and len(places) > 2 else [whole]


def _compared(
    free: _Free, i: int, j: int, range_i: tuple[float, float], range_j: tuple[float, float]
) -> Overlap | None:
    """The two pieces if they coincide."""
    a, b = _piece(free.curves[i], *range_i), _piece(free.curves[j], *range_j)
    reach = float(min(free.reach[i], free.reach[j]))
    # Sides that only touch.
    if min(np.ptp(c.control_points, axis=0).max() for c in (a, b)) <= 2 * reach:
        return None
    gap, backwards = min((_difference(a, b), False), (_difference(a, b.reversed()), True))
    b = b.reversed() if backwards else b
    same_speed = gap <= reach
    if not same_speed:
        probes = np.linspace(*a.domain, PROBES * len(a.control_points))
        _, distance = nearest_on_curve(b, a(probes))
        gap = float(distance.max())
        if not gap <= reach:
            return None
    parts = [(c.degree, len(knot_spans(c.knots)) - 1) for c in (a, b)]
    same_knots = not any(len(_lacking(*pair)) for pair in ((a, b), (b, a)))
    names = free.names[i], free.names[j]
    end_gap = float(max(np.abs(a.start - b.start).max(), np.abs(a.end - b.end).max()))
    return Overlap(gap, *names, end_gap, range_i, range_j, backwards, same_speed, parts[0], parts[1], same_knots)


def _piece(curve: BSplineCurve, low: float, high: float) -> BSplineCurve:
    if (low, high) == (0.0, 1.0):
        return curve
    return curve.restrict(*(_parameter(curve, part) for part in (low, high)))


def _parameter(curve: BSplineCurve, part: float) -> float:
    """The parameter at a part of the domain; a knot's own value where one is."""
    first, last = curve.domain
    t = first + part * (last - first)
    nearest = float(curve.knots[np.abs(curve.knots - t).argmin()])
    return nearest if abs(nearest - t) <= SAME_KNOT * (last - first) else t


def _difference(a: BSplineCurve, b: BSplineCurve) -> float:
    """Largest difference of control points in a common spline space; of weights too, by the size of the curve."""
    a, b = _with_degree(a, b.degree), _with_degree(b, a.degree)
    a, b = _with_knots_of(a, b), _with_knots_of(b, a)
    if len(a.control_points) != len(b.control_points):
        # Knots so close that they count as one here and as two there.
        return np.inf
    gap = float(np.abs(a.control_points - b.control_points).max())
    if a.weights is None and b.weights is None:
        return gap
    v, w = (c.homogeneous()[:, 2] for c in (a, b))
    # A common factor of the weights changes nothing. By logarithms, for ratios may overflow.
    ratio = np.log(v) - np.log(w)
    apart = float(np.expm1(min(float(np.abs(ratio - ratio.mean()).max()), 1.0)))
    return max(gap, apart * float(np.ptp(a.control_points, axis=0).max()))


def _with_degree(curve: BSplineCurve, degree: int) -> BSplineCurve:
    return curve.elevate(degree - curve.degree) if degree > curve.degree else curve


def _with_knots_of(curve: BSplineCurve, other: BSplineCurve) -> BSplineCurve:
    """The curve with the other's knots inserted that it lacks."""
    new = _lacking(curve, other)
    return curve.insert_knots(new) if len(new) else curve


def _lacking(curve: BSplineCurve, other: BSplineCurve) -> FloatArray:
    """Knots of the other that a curve lacks, in its own parameters."""
    (a, b), (c, d) = curve.domain, other.domain
    # Fractions first: the ratio of two domains may overflow.
    return missing_knots(curve.knots, a + (other.knots - c) / (d - c) * (b - a), curve.degree)


def missing_knots(knots: FloatArray, wanted: FloatArray, degree: int) -> FloatArray:
    """Inner knots of `wanted` that `knots`, on the same domain, lack; those within rounding of one take its value.

    None becomes more than `degree` fold.
    """
    tolerance = SAME_KNOT * (knots[-1] - knots[0])
    own = distinct(knots)
    inner = wanted[(wanted > knots[0] + tolerance) & (wanted < knots[-1] - tolerance)]
    # Groups of knots that are one, each with the value that it has already, or that of its first.
    groups = np.split(inner, np.flatnonzero(np.diff(inner) > tolerance) + 1) if len(inner) else []
    new: list[float] = []
    for group in groups:
        nearest = float(own[np.abs(own - group[0]).argmin()])
        value = nearest if abs(nearest - group[0]) <= tolerance else float(group[0])
        there = int((np.abs(knots - group[0]) <= tolerance).sum())
        new += [value] * (min(len(group), degree) - there)
    return np.array(new)
