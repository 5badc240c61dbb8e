"""Whether the points of a closed outline are a polygon's corners or samples of a smooth curve, and its corners then.

**Turn.** The turn at a point is the angle between the chords to the outline's points one window (0.5 % of the loop's
length) before and behind it; a chord never is shorter than the edge next to the point. A finely sampled corner, cut
over a few points, is found this way, and ripples smaller than the window are not; on a coarse polygon the chords are
the edges. Of the points of a window the one that turns most counts; its *neighbours* are a window or an edge away.

**Corner of a smooth curve.** A point whose turn exceeds the corner angle and is more than three times what its
neighbours explain, the smaller of their turns to the same side; corners explain nothing. (A chamfer has two corners,
the tip of a coarsely sampled ellipse none.) The corner angle is moved into the widest gap between the turns near it,
so that rounding never flips single corners.

**Polygon or samples.** All turns that are no corners decide together, by one angle: their mean, weighed by their
size, of the turn from one sample to the next, plus what the neighbours do not explain, the distance of the turn from
the interval between theirs (its square over the turn). A circle sampled in steps of 15° has 15°, a polygon of 16
equal sides 22.5°; one of 24 sides with seven points on each has 15° for its kinks and as much again for their
suddenness; outlines of countries have 30° to 100°. From 19.5° on, or if more than every fourth point is a corner, all
are corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import FloatArray

__all__ = ["CORNER_ANGLE", "Reading", "read_points"]

#: Turn of a corner on a smooth curve, in degrees: a circle sampled in steps of 24° is one still.
CORNER_ANGLE = 30.0
#: Length of the chords that measure the turn at a point, relative to the loop's length.
WINDOW = 0.005
#: From this mean turn (degrees) on points are a polygon's: between a regular polygon of 18 sides and one of 19.
POLYGON_ANGLE = 19.5
#: A corner turns by more than this many times what its neighbours explain.
SUDDEN = 3.0
#: Share of corners among the points that count from which on all are corners.
CORNER_SHARE = 0.25
#: Range around the corner angle in which the gap is looked for, as a factor up and down.
GAP_RANGE = 1.25
#: Rounds in which corners make corners of their neighbours: more are in a row in no drawing.
ROUNDS = 1000
#: Turns below this (radians) are rounding: the points are on a line.
STRAIGHT = 1e-9


@dataclass(frozen=True)
class Reading:
    """What points are taken for: `corner` marks those where curves end, `angle` is the mean turn (degrees)."""

    smooth: bool
    corner: NDArray[np.bool_]
    angle: float


@dataclass(frozen=True)
class _Turns:
    """Turns at the points, to the left positive, in radians."""

    windowed: FloatArray
    sharp: FloatArray
    """Between the two edges at the point itself."""
    step: FloatArray
    """From one sample to the next, at the curvature of the window."""
    before: NDArray[np.intp]
    after: NDArray[np.intp]
    """Numbers of the neighbours."""
    place: FloatArray
    window: float
    total: float

    def explained(self, corner: NDArray[np.bool_]) -> FloatArray:
        """The smaller of the neighbours' turns to the same side; 0 if one is to the other side or a corner."""
        side = np.sign(self.windowed)
        before = np.where(corner[self.before], 0.0, side * self.previous)
        after = np.where(corner[self.after], 0.0, side * self.following)
        return np.maximum(np.minimum(before, after), 0.0)

    @property
    def previous(self) -> FloatArray:
        """Turns of the neighbours before."""
        return np.asarray(self.windowed[self.before])

    @property
    def following(self) -> FloatArray:
        """Turns of the neighbours after."""
        return np.asarray(self.windowed[self.after])

    @property
    def unexplained(self) -> FloatArray:
        """Distance from the interval between the neighbours' turns."""
        low, high = np.minimum(self.previous, self.following), np.maximum(self.previous, self.following)
        return np.maximum(np.maximum(self.windowed - high, low - self.windowed), 0.0)


def read_points(points: FloatArray, smooth: bool | None, corner_angle: float) -> Reading:
    """Decide what the points of a closed outline are.

    Parameters
    ----------
    points : (n, 2) array
        At least 3, no two consecutive ones equal.
    smooth : bool or None
        Samples of a smooth curve, or corners of a polygon; None decides.
    corner_angle : float
        Turn of a corner of a smooth curve, in degrees.
    """
    turns = _turns(points)
    counted = _sharpest(turns)
    size = np.abs(turns.windowed)
    corner = _corners(turns, counted, math.radians(corner_angle))
    bent = counted & ~corner & (size > STRAIGHT) & ~_beside(turns, corner)
    angle = _mean_angle(turns, bent)
    if smooth is None:
        smooth = bool(angle < POLYGON_ANGLE and corner.sum() <= CORNER_SHARE * counted.sum())
    return Reading(smooth, corner if smooth else np.abs(turns.sharp) > STRAIGHT, angle)


def _corners(turns: _Turns, counted: NDArray[np.bool_], angle: float) -> NDArray[np.bool_]:
    size, corner = np.abs(turns.windowed), np.zeros(len(counted), bool)
    sudden = size > SUDDEN * turns.explained(corner)
    threshold = _in_gap(size[counted & sudden], angle)
    # A corner at the point itself is one also beside a larger one.
    possible = (size > threshold) & (counted | (np.abs(turns.sharp) > threshold))
    for _ in range(ROUNDS):
        found = possible & (size > SUDDEN * turns.explained(corner))
        if (found == corner).all():
            break
        # What a corner explained may be one too.
        corner = found
    return corner


def _turns(points: FloatArray) -> _Turns:
    n = len(points)
    edges = np.roll(points, -1, axis=0) - points
    length = np.hypot(*edges.T)
    total = float(length.sum())
    s = np.concatenate([[0.0], np.cumsum(length)])
    closed = np.vstack([points, points[:1]])

    def at(t: FloatArray) -> FloatArray:
        return np.column_stack([np.interp(t, s, x) for x in closed.T])

    window, place = WINDOW * total, s[:-1]
    edge_before, length_before = np.roll(edges, 1, axis=0), np.roll(length, 1)
    after = np.where((length < window)[:, None], at((place + window) % total) - points, edges)
    before = np.where((length_before < window)[:, None], points - at((place - window) % total), edge_before)
    windowed = _turn(before, after)
    # The first point that is a window away, at least the next one.
    reach = window * (1 - 1e-9)
    following = np.maximum(np.searchsorted(np.concatenate([place, place + total]), place + reach), np.arange(n) + 1)
    previous = np.searchsorted(np.concatenate([place - total, place]), place - reach, side="right") - 1
    previous = np.minimum(previous, np.arange(n) + n - 1)
    step = windowed * np.minimum((length + length_before) / (2 * window), 1.0)
    return _Turns(windowed, _turn(edge_before, edges), step, previous % n, following % n, place, window, total)


def _turn(before: FloatArray, after: FloatArray) -> FloatArray:
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(np.arctan2(cross, (before * after).sum(axis=1)))


def _within_window(turns: _Turns) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and past-the-last number of the points nearer than a window to each; numbers count on beyond both ends."""
    place = np.concatenate([turns.place - turns.total, turns.place, turns.place + turns.total])
    reach, n = turns.window * (1 - 1e-9), len(turns.place)
    first = np.searchsorted(place, turns.place - reach, side="right")
    return first - n, np.searchsorted(place, turns.place + reach) - n


def _sharpest(turns: _Turns) -> NDArray[np.bool_]:
    """Points no nearer than a window to each other, those that turn most first; all of a coarse outline."""
    n = len(turns.place)
    taken, free = np.zeros(n, bool), np.ones(n, bool)
    first, end = _within_window(turns)
    # Of equal turns the first counts; rounding must not choose.
    for i in np.argsort(-np.round(np.abs(turns.windowed), 9), kind="stable").tolist():
        if free[i]:
            taken[i] = True
            free[np.arange(first[i], end[i]) % n] = False
    return taken


def _beside(turns: _Turns, corner: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Points nearer than a window to a corner, whose chords reach over it."""
    n = len(corner)
    first, end = _within_window(turns)
    before = np.concatenate([[0], np.cumsum(np.tile(corner, 3))])
    return np.asarray(before[end + n] > before[first + n])


def _in_gap(sizes: FloatArray, angle: float) -> float:
    """The middle of the widest gap between turns near `angle`, by ratio."""
    low, high = angle / GAP_RANGE, angle * GAP_RANGE
    ends = np.concatenate([[low], np.sort(sizes[(sizes > low) & (sizes < high)]), [high]])
    widest = int(np.argmax(ends[1:] / ends[:-1]))
    return math.sqrt(ends[widest] * ends[widest + 1])


def _mean_angle(turns: _Turns, bent: NDArray[np.bool_]) -> float:
    size = np.abs(turns.windowed[bent])
    if not len(size):
        return 0.0
    weighed = size * np.abs(turns.step[bent]) + turns.unexplained[bent] ** 2
    return math.degrees(float(weighed.sum() / size.sum()))
