"""Splines through the points of closed outlines, or the polygons that they are the corners of.

Which of the two is decided by `sampling`.

**Straight edges** of a smooth outline: a cubic through a dense arc followed by one long edge would bulge along it.
Where an edge is more than 5 times as long as its neighbour and as the median of the next three, the outline is split
too; if that happens at both ends the edge becomes a straight segment. The arc's end tangent takes the edge's
direction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.curve import BSplineCurve
from ..numeric.arrays import FloatArray
from .loops import close_loop
from .sampling import CORNER_ANGLE, Reading, read_points

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

__all__ = ["LARGEST_SMOOTH", "interpolate_outline", "read_outline"]

LONG_EDGE = 5.0
#: Largest coordinate of points that a spline goes through: the cubes of lengths must not overflow.
LARGEST_SMOOTH = 1e100


def interpolate_outline(
    points: FloatArray, name: str = "outline", smooth: bool | None = None, corner_angle: float = CORNER_ANGLE
) -> list[BSplineCurve]:
    """The curves of `read_outline`."""
    return read_outline(points, name, smooth, corner_angle)[0]


def read_outline(
    points: FloatArray, name: str = "outline", smooth: bool | None = None, corner_angle: float = CORNER_ANGLE
) -> tuple[list[BSplineCurve], Reading]:
    """Curves through a closed list of points, split at corners.

    Parameters
    ----------
    points : (n, 2) array
        At least 3 points in order, the first not repeated at the end, no two consecutive ones equal.
    name : str
        What to call the outline in messages.
    smooth : bool, optional
        Whether the points are samples of a smooth curve or corners of a polygon; None (the default) decides.
    corner_angle : float, default 30
        Turn, in degrees, from which a point of a smooth curve is a corner.

    Returns
    -------
    list of BSplineCurve
        A closed chain. Of a polygon: its edges, those on one line joined. Of a smooth curve: C² cubics (chord-length
        parameters, not-a-knot ends) between corners, lines where points are collinear, one closed C² cubic if there
        is no corner.
    Reading
        What the points were taken for.
    """
    edges = np.roll(points, -1, axis=0) - points
    length = np.hypot(*edges.T)
    if length.min() <= 1e-13 * length.sum():
        raise InputError(f"{name}: two consecutive points are equal or nearly so; delete one of them")
    reading = read_points(points, smooth, corner_angle)
    if not reading.smooth:
        ends = np.flatnonzero(reading.corner)
        return [_line(points[a], points[b]) for a, b in zip(ends, np.roll(ends, -1), strict=True)], reading
    if np.abs(points).max() > LARGEST_SMOOTH:
        raise InputError(
            f"{name}: a coordinate above {LARGEST_SMOOTH:g} is too large for a smooth curve; take smaller units"
        )
    corner = reading.corner
    long_after, long_before = _long(length)
    # At a straight edge's end the tangent is prescribed unless there is a corner.
    split = np.flatnonzero(corner | long_after | long_before)
    if len(split) == 0:
        return close_loop([_periodic(points)]), reading
    pieces = []
    for k, a in enumerate(split):
        b = split[(k + 1) % len(split)]
        index = np.arange(a, b + 1 if b > a else b + 1 + len(points)) % len(points)
        start = edges[a - 1] / length[a - 1] if long_before[a] and not corner[a] else None
        end = edges[b] / length[b] if long_after[b] and not corner[b] else None
        pieces.append(_piece(points[index], start, end))
    return close_loop(pieces), reading


def _long(length: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Points where a straight edge starts after, or ends with, shorter edges."""
    if len(length) < 7:
        none = np.zeros(len(length), bool)
        return none, none
    following = np.median([np.roll(length, -k) for k in (1, 2, 3)], axis=0)
    preceding = np.median([np.roll(length, k) for k in (1, 2, 3)], axis=0)
    # The median looks past single tiny edges, as contour tracers produce them.
    starts = length > LONG_EDGE * np.maximum(preceding, np.roll(length, 1))
    ends = np.roll(length > LONG_EDGE * np.maximum(following, np.roll(length, -1)), 1)
    return starts, ends


def _line(a: FloatArray, b: FloatArray) -> BSplineCurve:
    return BSplineCurve([0.0, 0.0, 1.0, 1.0], 1, [a, b])


def _piece(points: FloatArray, start: FloatArray | None, end: FloatArray | None) -> BSplineCurve:
    """Open piece through at least 2 points; `start` and `end` are unit tangents or None."""
    chord = points[-1] - points[0]
    x = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    if x[-1] - np.hypot(*chord) <= 1e-12 * x[-1]:
        relative = points - points[0]
        # The length alone would let pass deviations of 1e-6.
        if np.abs(relative[:, 0] * chord[1] - relative[:, 1] * chord[0]).max() <= 1e-12 * x[-1] ** 2:
            return _line(points[0], points[-1])
    ends = tuple("not-a-knot" if tangent is None else (1, tangent) for tangent in (start, end))
    from scipy.interpolate import CubicSpline

    return _as_bspline(CubicSpline(x, points, bc_type=ends), x, points)


def _periodic(points: FloatArray) -> BSplineCurve:
    closed = np.vstack([points, points[:1]])
    x = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    from scipy.interpolate import CubicSpline

    return _as_bspline(CubicSpline(x, closed, bc_type="periodic"), x, closed)


def _as_bspline(spline: CubicSpline, x: FloatArray, points: FloatArray) -> BSplineCurve:
    """Clamped B-spline form of a C² cubic, by interpolation at the Greville abscissae of its own space."""
    knots = np.concatenate([np.full(3, x[0]), x, np.full(3, x[-1])])
    greville = np.clip((knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3, x[0], x[-1])
    from scipy.interpolate import make_interp_spline

    control = make_interp_spline(greville, spline(greville), k=3, t=knots).c
    control[0], control[-1] = points[0], points[-1]
    return BSplineCurve(knots, 3, control)
