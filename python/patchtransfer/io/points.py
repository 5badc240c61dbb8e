"""CSV: closed outlines as lists of points, interpolated by splines, and landmarks.

**Corners.** The turn at a point is the angle between the chords to the outline's points one window (0.5 %
of the loop's length) before and behind it; a chord never is shorter than the edge next to the point. A
finely sampled corner, cut over a few points, is found this way, and ripples smaller than the window are
not; on a coarse polygon the chords are the edges. A point is a corner if its turn exceeds 30° and is the
largest within a window, or if the two edges at the point itself turn by more than 30° as well (a chamfer
has two corners). So every vertex of an octagon is a corner, and a circle sampled in 15° steps has none.

**Straight edges.** A cubic through a dense arc followed by one long edge would bulge along the edge.
Where an edge is more than 5 times as long as its neighbour and as the median of the next three, the
outline is split too; if that happens at both ends the edge becomes a straight segment. The arc's end
tangent takes the edge's direction.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..limits import MAX_CURVES, MAX_LANDMARKS, MAX_LINES, MAX_LOOPS, at_most
from ..numeric.arrays import FloatArray
from .loops import close_loop
from .options import DEFAULT, BoundaryOptions

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

__all__ = ["interpolate_outline", "looks_like_points", "read_boundary", "read_landmarks"]

CORNER_ANGLE = math.radians(30.0)
WINDOW = 0.005
"""Length of the chords that measure the turn at a point, relative to the loop's length."""
LONG_EDGE = 5.0

LANDMARK_COLUMNS = ("xs", "ys", "xt", "yt")


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"is not UTF-8 text (byte {error.start}); save it as UTF-8 CSV") from None


def _lines(data: bytes) -> list[str]:
    text = _text(data)
    at_most(text.count("\n") + text.count("\r"), 2 * MAX_LINES, "line ends", "delete empty lines and comments")
    return text.splitlines()


def _fields(line: str) -> list[str]:
    """Entries of a line, separated by commas or, without any comma, by blanks; without its comment."""
    line = line.partition("#")[0].strip()
    return [field.strip() for field in line.split(",")] if "," in line else line.split()


def _values(fields: list[str], number: int, what: str) -> list[float]:
    try:
        values = [float(field) for field in fields]
    except ValueError:
        raise InputError(f"line {number}: expected {what}, got {', '.join(fields)[:40]!r}; correct it") from None
    # Squares of coordinates must not overflow; the comparison also refuses NaN.
    if not all(abs(value) <= 1e150 for value in values):
        raise InputError(f"line {number}: NaN, infinity or a number above 1e150; give finite numbers")
    return values


def looks_like_points(data: bytes) -> bool:
    """Whether the first line that says something is ``x,y`` or two numbers."""
    for line in data[:4096].decode("utf-8-sig", errors="replace").splitlines():
        if fields := _fields(line):
            try:
                return len([float(f) for f in fields]) == 2
            except ValueError:
                return [f.lower() for f in fields] == ["x", "y"]
    return False


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary from closed point lists; see `patchtransfer.read_boundary`."""
    blocks: list[list[tuple[int, list[float]]]] = [[]]
    header_allowed = True
    count = 0
    for number, line in enumerate(_lines(data), 1):
        fields = _fields(line)
        if not fields:
            # A comment line does not end a block.
            if not line.strip() and blocks[-1]:
                blocks.append([])
            continue
        if not (header_allowed and [f.lower() for f in fields] == ["x", "y"]):
            if len(fields) != 2:
                raise InputError(f"line {number}: expected x,y, got {len(fields)} entries; correct it")
            blocks[-1].append((number, _values(fields, number, "two numbers x,y")))
            count += 1
            at_most(count, MAX_CURVES, "points", "take every other one")
            at_most(len(blocks), MAX_LOOPS, "outlines", "keep those of the domain")
        header_allowed = False
    loops = [interpolate_outline(*_outline(block)) for block in blocks if block]
    if not loops:
        raise InputError("holds no points; list x,y line by line")
    return Boundary(loops)


def _outline(block: list[tuple[int, list[float]]]) -> tuple[FloatArray, str]:
    """Points of a loop without the repeated last one; `InputError` on repetitions, naming the line."""
    lines = [number for number, _ in block]
    points = np.array([values for _, values in block])
    same = 1e-12 * float(np.linalg.norm(np.ptp(points, axis=0)))
    if len(points) > 1 and np.linalg.norm(points[-1] - points[0]) <= same:
        points, lines = points[:-1], lines[:-1]
    name = f"the outline that starts at line {block[0][0]}"
    step = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    if len(points) > 1 and (step <= same).any():
        i = int(np.argmax(step <= same))
        # Only the last point can equal the first one here, and the last one is the repetition then.
        raise InputError(f"line {lines[i] if i else lines[-1]}: repeats the point before it; delete the line")
    if len(np.unique(points, axis=0)) < 3:
        raise InputError(f"{name} has fewer than 3 distinct points; add points")
    return points, name


def interpolate_outline(points: FloatArray, name: str = "outline") -> list[BSplineCurve]:
    """Splines through a closed list of points, split at corners.

    Parameters
    ----------
    points : (n, 2) array
        At least 3 points in order, the first not repeated at the end, no two consecutive ones equal.
    name : str
        What to call the outline in messages.

    Returns
    -------
    list of BSplineCurve
        A closed chain: C² cubics (chord-length parameters, not-a-knot ends) between corners, lines where
        points are collinear, one closed C² cubic if there is no corner.
    """
    edges = np.roll(points, -1, axis=0) - points
    length = np.hypot(*edges.T)
    if length.min() <= 1e-13 * length.sum():
        raise InputError(f"{name}: two consecutive points are equal or nearly so; delete one of them")
    corner = _corners(points, edges, length)
    long_after, long_before = _long(length)
    # At a straight edge's end the tangent is prescribed unless there is a corner.
    split = np.flatnonzero(corner | long_after | long_before)
    if len(split) == 0:
        return close_loop([_periodic(points)])
    pieces = []
    for k, a in enumerate(split):
        b = split[(k + 1) % len(split)]
        index = np.arange(a, b + 1 if b > a else b + 1 + len(points)) % len(points)
        start = edges[a - 1] / length[a - 1] if long_before[a] and not corner[a] else None
        end = edges[b] / length[b] if long_after[b] and not corner[b] else None
        pieces.append(_piece(points[index], start, end))
    return close_loop(pieces)


def _turn(before: FloatArray, after: FloatArray) -> FloatArray:
    """Absolute angles between vectors."""
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(np.abs(np.arctan2(cross, (before * after).sum(axis=1))))


def _corners(points: FloatArray, edges: FloatArray, length: FloatArray) -> NDArray[np.bool_]:
    total = length.sum()
    s = np.concatenate([[0.0], np.cumsum(length)])
    closed = np.vstack([points, points[:1]])

    def at(t: FloatArray) -> FloatArray:
        return np.column_stack([np.interp(t, s, x) for x in closed.T])

    window = WINDOW * total
    edge_before = np.roll(edges, 1, axis=0)
    reach_after = at((s[:-1] + window) % total) - points
    reach_before = points - at((s[:-1] - window) % total)
    after = np.where((length < window)[:, None], reach_after, edges)
    before = np.where((np.roll(length, 1) < window)[:, None], reach_before, edge_before)
    turn, sharp = _turn(before, after), _turn(edge_before, edges)
    corner = turn > CORNER_ANGLE
    for i in np.flatnonzero(corner & (sharp <= CORNER_ANGLE)):
        distance = np.abs(s[:-1] - s[i])
        near = np.minimum(distance, total - distance) < window
        # Of equal turns the first counts.
        corner[i] = i == np.flatnonzero(near)[np.argmax(turn[near])]
    return np.asarray(corner)


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


def read_landmarks(data: bytes) -> FloatArray:
    """Landmarks (r, 4) of a CSV file; see `patchtransfer.read_landmarks`."""
    columns: list[int] = []
    rows: list[list[float]] = []
    width = 0
    for number, line in enumerate(_lines(data), 1):
        fields = _fields(line)
        if not fields:
            continue
        if not columns:
            names = [field.lower() for field in fields]
            missing = [name for name in LANDMARK_COLUMNS if names.count(name) != 1]
            if missing:
                raise InputError(
                    f"line {number}: the header must name the columns xs,ys,xt,yt once each; "
                    f"{missing[0]} is missing or repeated"
                )
            columns, width = [names.index(name) for name in LANDMARK_COLUMNS], len(names)
            continue
        if len(fields) != width:
            raise InputError(f"line {number}: {len(fields)} entries where the header has {width}; correct it")
        at_most(len(rows) + 1, MAX_LANDMARKS, "landmarks", "keep the telling ones")
        rows.append(_values([fields[c] for c in columns], number, "four numbers"))
    if not rows:
        raise InputError("holds no landmarks; give a header xs,ys,xt,yt and at least one row")
    return np.array(rows)
