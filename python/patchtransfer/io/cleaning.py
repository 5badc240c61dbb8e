"""Slips of drawings, mended: slivers, spikes, gaps, specks, curves without length. Every change is told with its size.

A drawing has a resolution, the last digit that its numbers are rounded to: 0.01 on an icon of 24 units, 0.1 on one of
512, that is 2e-4 to 3e-4 of the diagonal, and rounding in both coordinates moves a point by 1.4 times as much. What
is smaller than that was not drawn. Fillets, chamfers and holes from 1e-3 of the diameter on were, and so were short
edges in a row, which sample a curve, short edges next to others not much longer, and the ends of slots and blunt
trailing edges, where the outline turns back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ..geometry.curve import BSplineCurve
from ..geometry.slivers import RESOLUTION, SHARE, TURNS_BACK
from ..numeric.arrays import FloatArray
from .loops import TOLERANCE, close_loop, diameter, free_ends, with_ends
from .spikes import without_spikes

__all__ = ["RESOLUTION", "absorb", "cleaned", "mended", "slivers"]

#: Curves shorter than this (relative to the diameter) have no length.
NEGLIGIBLE = 1e-9
#: Changes of a kind that are listed one by one.
LISTED = 10


def mended(
    names: Sequence[str], curves: Sequence[BSplineCurve], notes: list[str]
) -> tuple[list[str], list[BSplineCurve]]:
    """Loose curves as `loops.chain` wants them: without those that have no length, and with small gaps closed.

    Two free ends are joined, halfway, if they are each other's only one within the resolution, and no curve there is
    shorter than ten gaps.

    Parameters
    ----------
    names : sequence of str
        What to call the curves.
    curves : sequence of BSplineCurve
    notes : list of str
        What was changed is added.
    """
    size = diameter(curves)
    length = np.array([polygon_length(c) for c in curves])
    kept = np.flatnonzero(length > NEGLIGIBLE * size).tolist()
    if not kept:
        # Nothing would be left to tell about; whoever chains them names the first.
        return list(names), list(curves)
    gone = [f"{names[i]} has no length and is left out" for i in np.flatnonzero(length <= NEGLIGIBLE * size).tolist()]
    _tell(notes, gone, "curves without length left out")
    names, result, length = [names[i] for i in kept], [curves[i] for i in kept], length[kept]
    told = []
    for i, j, a, b in _gaps(result, TOLERANCE * size, RESOLUTION * size):
        gap = float(np.linalg.norm(a - b))
        if gap > SHARE * min(length[i // 2], length[j // 2]):
            continue
        for end in (i, j):
            result[end // 2] = _moved(result[end // 2], {end % 2: (a + b) / 2})
        between = f"{names[i // 2]} and {names[j // 2]}" if i // 2 != j // 2 else f"the ends of {names[i // 2]}"
        told.append(f"closed a gap of {_size(gap, size)} between {between} at {_place((a + b) / 2)}")
    _tell(notes, told, "gaps closed")
    return names, result


def _gaps(curves: Sequence[BSplineCurve], same: float, bound: float) -> list[tuple[int, int, FloatArray, FloatArray]]:
    """Pairs of free ends (2 i is the start of curve i, 2 i + 1 its end) that have no other one within the bound."""
    ends = free_ends(curves, same)
    if len(ends) < 2:
        return []
    from scipy.spatial import cKDTree

    points = np.array([curves[e // 2].end if e % 2 else curves[e // 2].start for e in ends])
    # The nearest is the point itself; the third tells whether there are several.
    distance, nearest = cKDTree(points).query(points, 3, distance_upper_bound=bound)
    partner = np.where((distance[:, 1] < np.inf) & (distance[:, 2] == np.inf), nearest[:, 1], -1)
    return [
        (int(ends[a]), int(ends[b]), points[a], points[b])
        for a, b in enumerate(partner.tolist())
        if b > a and partner[b] == a
    ]


def cleaned(loops: Sequence[Sequence[BSplineCurve]], notes: list[str]) -> list[list[BSplineCurve]]:
    """Loops without specks, spikes and slivers; what was changed is added to `notes`."""
    size = diameter([c for loop in loops for c in loop])
    result: list[list[BSplineCurve]] = []
    specks, cut, absorbed = [], [], []
    for k, loop in enumerate(loops):
        across = diameter(loop)
        if across <= RESOLUTION * size and len(loops) > 1:
            specks.append(f"loop {k}, a speck {_size(across, size)} across at {_place(loop[0].start)}, left out")
            continue
        whole, spikes = without_spikes(loop, across)
        cut += [
            f"loop {k}: cut off a spike of {_size(long, size)} at {_place(at)}, where the outline ran back over itself"
            for long, at in spikes
        ]
        # Without one sliver another may stand next to long edges only.
        while True:
            whole, found = _without_slivers(whole, across)
            if not found:
                break
            absorbed += [f"loop {k}: absorbed a sliver of {_size(long, size)} at {_place(at)}" for long, at in found]
        result.append(whole)
    if not result:
        # Specks that lie far apart are all there is.
        return [list(loop) for loop in loops]
    _tell(notes, specks, "specks left out")
    _tell(notes, cut, "spikes cut off")
    _tell(notes, absorbed, "slivers absorbed")
    return result


def _without_slivers(
    loop: list[BSplineCurve], size: float
) -> tuple[list[BSplineCurve], list[tuple[float, FloatArray]]]:
    """The loop without its slivers, and their lengths and places."""
    length = np.array([polygon_length(c) for c in loop])

    def direction(i: int, forwards: bool, reach: float) -> FloatArray:
        return _direction(loop[i], forwards, reach)

    runs = slivers(length, size, direction)
    if not runs:
        return loop, []
    gone: set[int] = set()
    moved: dict[int, dict[int, FloatArray]] = {}
    found = []
    for first, count in runs:
        run = [(first + j) % len(loop) for j in range(count)]
        gone.update(run)
        before, after = (first - 1) % len(loop), (first + count) % len(loop)
        at = (loop[before].end + loop[after].start) / 2
        moved.setdefault(before, {})[1] = at
        moved.setdefault(after, {})[0] = at
        found.append((float(length[run].sum()), at))
    kept = [_moved(c, moved.get(i, {})) for i, c in enumerate(loop) if i not in gone]
    return close_loop(kept), found


def slivers(
    length: FloatArray, size: float, direction: Callable[[int, bool, float], FloatArray]
) -> list[tuple[int, int]]:
    """Runs of edges that are slips of a closed chain: (first edge, count) each.

    Parameters
    ----------
    length : (n,) array
        Lengths of the edges in order.
    size : float
        Diameter of the chain.
    direction : callable
        `direction(i, forwards, reach)`: how edge i goes on, over a distance `reach` from its start (forwards) or to its
        end.
    """
    bound, n = RESOLUTION * size, len(length)
    short = length <= bound
    if not short.any() or short.all():
        return []
    origin = int(np.argmin(short))
    turned = np.roll(short, -origin)
    starts = np.flatnonzero(turned & ~np.roll(turned, 1))
    ends = np.flatnonzero(~turned & np.roll(turned, 1))
    # The chain starts with a long edge, so that a run that ends with the chain ends at number 0.
    if len(ends) and ends[0] == 0:
        ends = np.append(ends[1:], n)
    runs = []
    for first, end in zip(((starts + origin) % n).tolist(), (ends - starts).tolist(), strict=True):
        total = float(length[np.arange(first, first + end) % n].sum())
        before, after = (first - 1) % n, (first + end) % n
        if total > min(bound, SHARE * length[before], SHARE * length[after]):
            continue
        into, out = direction(before, False, 5 * total), direction(after, True, 5 * total)
        turn = math.atan2(into[0] * out[1] - into[1] * out[0], float(into @ out))
        if abs(turn) <= TURNS_BACK:
            runs.append((first, end))
    return runs


def absorb(points: FloatArray, notes: list[str], name: str) -> FloatArray:
    """A closed list of points without slivers: the ends of each become the point halfway."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    told: list[str] = []
    while len(points) > 3:
        edges = np.roll(points, -1, axis=0) - points
        length = np.hypot(*edges.T)
        runs = slivers(length, size, _edge_of(edges))
        if not runs:
            break
        n, gone = len(points), np.zeros(len(points), bool)
        points = points.copy()
        for first, count in runs:
            last = (first + count) % n
            told.append(
                f"{name}: absorbed a sliver of {_size(length[np.arange(first, first + count) % n].sum(), size)} "
                f"at {_place(points[first])}"
            )
            points[first] = (points[first] + points[last]) / 2
            gone[np.arange(first + 1, first + count + 1) % n] = True
        points = points[~gone]
    _tell(notes, told, f"slivers of {name} absorbed")
    return points


def _edge_of(edges: FloatArray) -> Callable[[int, bool, float], FloatArray]:
    return lambda i, _forwards, _reach: np.asarray(edges[i])


def polygon_length(curve: BSplineCurve) -> float:
    """Length of the control polygon."""
    return float(np.hypot(*np.diff(curve.control_points, axis=0).T).sum())


def _direction(curve: BSplineCurve, forwards: bool, reach: float) -> FloatArray:
    """Where a curve goes from its start, or comes from to its end, seen over a distance."""
    points = curve(np.linspace(*curve.domain, 65))
    away = points - points[0] if forwards else points[-1] - points[::-1]
    far = np.hypot(*away.T) >= reach
    return np.asarray(away[int(np.argmax(far))] if far.any() else away[-1])


def _moved(curve: BSplineCurve, ends: dict[int, FloatArray]) -> BSplineCurve:
    """The curve with its start (0) or end (1) moved, and the tangent there if another control point can do so."""
    start, end = ends.get(0, curve.start), ends.get(1, curve.end)
    if curve.degree > 1 and len(curve.control_points) > 3:
        points = curve.control_points.copy()
        points[1] += start - curve.start
        points[-2] += end - curve.end
        curve = BSplineCurve(curve.knots, curve.degree, points, curve.weights)
    return with_ends(curve, start, end)


def _tell(notes: list[str], told: Sequence[str], kind: str) -> None:
    """Add changes to the notes; of very many the rest as a number."""
    notes += told[:LISTED]
    if len(told) > LISTED:
        notes.append(f"{len(told) - LISTED} more {kind}")


def _size(length: float, size: float) -> str:
    return f"{length:.3g} ({length / size:.1e} of the diameter)"


def _place(point: FloatArray) -> str:
    return f"({point[0]:g}, {point[1]:g})"
