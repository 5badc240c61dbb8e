"""Closed loops from loose curves: clamping, chaining by end points, snapping."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..geometry.basis import insert_knots
from ..geometry.curve import BSplineCurve
from ..numeric.arrays import FloatArray
from ..numeric.components import components

__all__ = ["TOLERANCE", "chain", "clamp", "close_loop", "diameter", "free_ends", "vertices"]

#: End points closer than this (relative to the diameter of all curves) are the same point.
TOLERANCE = 1e-6
#: Different end points that are looked at around each: two meet in a valid file. All pairs would be too many in one
#: whose thousands of curves meet in a point.
NEAREST = 16
#: Curves between the same two vertices that are compared with each other: two in a valid file.
COMPARED = 8


def clamp(knots: FloatArray, degree: int, coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Knots and coefficients (along the first axis) of the same spline with clamped ends, by knot insertion.

    The domain of an unclamped (for example periodic) knot vector t_0 .. t_{n+p} is [t_p, t_n].
    """
    for _ in range(2):
        if knots[degree] != knots[0]:
            x = knots[degree]
            missing = degree - int(np.count_nonzero(knots == x))
            knots, coefficients = insert_knots(knots, degree, coefficients, np.full(max(missing, 0), x))
            last = int(np.searchsorted(knots, x, side="right")) - 1
            knots = np.concatenate([np.full(degree + 1, x), knots[last + 1 :]])
            coefficients = coefficients[last - degree :]
        # The other end is the start of the reversed spline; negation is exact.
        knots, coefficients = -knots[::-1], coefficients[::-1]
    return knots, coefficients


def with_ends(curve: BSplineCurve, start: FloatArray, end: FloatArray) -> BSplineCurve:
    """Return the curve with its end points moved, itself if they are there already."""
    if np.array_equal(curve.start, start) and np.array_equal(curve.end, end):
        return curve
    points = curve.control_points.copy()
    points[0], points[-1] = start, end
    return BSplineCurve(curve.knots, curve.degree, points, curve.weights)


def close_loop(curves: Sequence[BSplineCurve]) -> list[BSplineCurve]:
    """Give consecutive curves of a loop end points that are equal to the bit."""
    first = curves[0].start
    starts = [first, *(curve.end for curve in curves[:-1])]
    ends = [*(curve.end for curve in curves[:-1]), first]
    return [with_ends(*each) for each in zip(curves, starts, ends, strict=True)]


def diameter(curves: Sequence[BSplineCurve]) -> float:
    """Diagonal of the bounding box of all control points."""
    return float(np.linalg.norm(np.ptp(np.concatenate([c.control_points for c in curves]), axis=0)))


def chain(names: Sequence[str], curves: Sequence[BSplineCurve], tolerance: float) -> list[list[BSplineCurve]]:
    """Sort curves of any order and sense into closed loops.

    Parameters
    ----------
    names : sequence of str
        What to call the curves in messages.
    curves : sequence of BSplineCurve
    tolerance : float
        Largest distance of end points that are the same; they are made equal to the bit.

    Returns
    -------
    list of loops
        In the order of their first curves, each in the sense of its first curve.

    Raises
    ------
    InputError
        Naming the curve that is open, without length, or there twice, or the curves that branch.
    """
    vertex = vertices(curves, tolerance)
    _check(names, curves, vertex, tolerance)
    at: dict[int, list[int]] = defaultdict(list)
    for i, (a, b) in enumerate(vertex):
        at[a].append(i)
        at[b].append(i)
    for v, meeting in at.items():
        if len(meeting) == 1:
            raise InputError(_open_message(names, curves, vertex, at, v, tolerance))
        if len(meeting) > 2:
            point = next(c.start if a == v else c.end for c, (a, b) in zip(curves, vertex, strict=True) if v in (a, b))
            who = ", ".join(names[i] for i in dict.fromkeys(meeting))
            raise InputError(f"{who} meet at ({point[0]:g}, {point[1]:g}); loops must not branch or touch")
    loops, used = [], [False] * len(curves)
    for first in range(len(curves)):
        if used[first]:
            continue
        loop, (start, v), i = [curves[first]], vertex[first], first
        used[first] = True
        while v != start:
            i = next(j for j in at[v] if j != i)
            used[i] = True
            forwards = vertex[i][0] == v
            loop.append(curves[i] if forwards else curves[i].reversed())
            v = vertex[i][1] if forwards else vertex[i][0]
        loops.append(close_loop(loop))
    return loops


def free_ends(curves: Sequence[BSplineCurve], tolerance: float) -> list[int]:
    """Ends where no other curve ends: 2 i is the start of curve i, 2 i + 1 its end."""
    ends = [v for pair in vertices(curves, tolerance) for v in pair]
    meeting = np.bincount(ends)
    return [e for e, v in enumerate(ends) if meeting[v] == 1]


def in_order(curves: Sequence[BSplineCurve], tolerance: float) -> bool:
    """Whether every curve ends where the next one starts."""
    ends = np.array([c.end for c in curves])
    starts = np.roll(np.array([c.start for c in curves]), -1, axis=0)
    return bool(np.linalg.norm(ends - starts, axis=1).max() <= tolerance)


def check_curves(names: Sequence[str], curves: Sequence[BSplineCurve], tolerance: float) -> None:
    """Raise `InputError` on curves without length and on curves that are there twice."""
    _check(names, curves, vertices(curves, tolerance), tolerance)


def vertices(curves: Sequence[BSplineCurve], tolerance: float) -> list[tuple[int, int]]:
    """Numbers of the start and end points, the same number for points that coincide."""
    ends = np.array([point for c in curves for point in (c.start, c.end)])
    places, which = np.unique(ends, axis=0, return_inverse=True)
    nearest = min(NEAREST, len(places))
    from scipy.spatial import cKDTree

    _, near = cKDTree(places).query(places, nearest, distance_upper_bound=np.nextafter(tolerance, np.inf))
    i, j = np.repeat(np.arange(len(places)), nearest), np.asarray(near).ravel()
    # Missing neighbours have the number n.
    i, j = i[j < len(places)], j[j < len(places)]
    labels = components(len(places), i, j)[which.ravel()].tolist()
    return list(zip(labels[::2], labels[1::2], strict=True))


def _check(
    names: Sequence[str], curves: Sequence[BSplineCurve], vertex: list[tuple[int, int]], tolerance: float
) -> None:
    groups: dict[tuple[int, ...], list[int]] = defaultdict(list)
    for i, curve in enumerate(curves):
        if np.linalg.norm(np.ptp(curve.control_points, axis=0)) <= tolerance:
            raise InputError(f"{names[i]} has no length; delete it")
        groups[tuple(sorted(vertex[i]))].append(i)
    for group in groups.values():
        for n, i in enumerate(group[:COMPARED]):
            for j in group[:n]:
                if any(_coincide(curves[j], c, tolerance) for c in (curves[i], curves[i].reversed())):
                    raise InputError(f"{names[i]} repeats {names[j]}; delete one of them")


def _coincide(a: BSplineCurve, b: BSplineCurve, tolerance: float) -> bool:
    t = np.linspace(0, 1, 4 * max(len(a.control_points), len(b.control_points)) + 1)
    (a0, a1), (b0, b1) = a.domain, b.domain
    return bool(np.abs(a(a0 + (a1 - a0) * t) - b(b0 + (b1 - b0) * t)).max() <= tolerance)


def _open_message(
    names: Sequence[str],
    curves: Sequence[BSplineCurve],
    vertex: list[tuple[int, int]],
    at: dict[int, list[int]],
    v: int,
    tolerance: float,
) -> str:
    """Say which curve is open, where, and how far the nearest other free end is."""
    free = [
        (w, i, point)
        for i, (c, (a, b)) in enumerate(zip(curves, vertex, strict=True))
        for w, point in ((a, c.start), (b, c.end))
        if len(at[w]) == 1
    ]
    _, i, point = next(f for f in free if f[0] == v)
    gaps = [(float(np.linalg.norm(q - point)), j) for w, j, q in free if w != v]
    where = f"{names[i]} is open at ({point[0]:g}, {point[1]:g})"
    if not gaps:
        return f"{where}: nothing else ends there; close the loop"
    gap, j = min(gaps)
    return f"{where}: the nearest free end, of {names[j]}, is {gap:.3g} away (tolerance {tolerance:.3g}); close the gap"
