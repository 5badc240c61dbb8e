"""Airfoils (``.dat``): a name and the points of a section, in the order of Selig or of Lednicer.

**Selig.** From the trailing edge over one side to the leading edge, and back over the other side. **Lednicer.** The
second line has the numbers of points of the upper and the lower side, which follow one after the other, both from the
leading edge. Either way one cubic runs around the leading edge, and the only corners are at the trailing edge: one
where it is closed, else two with a straight side between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..limits import MAX_CURVES, MAX_LINES, at_most
from ..numeric.arrays import FloatArray
from .interpolation import LARGEST_SMOOTH
from .loops import TOLERANCE, close_loop
from .options import DEFAULT, BoundaryOptions

__all__ = ["looks_like_airfoil", "read_boundary"]

#: Fewest points of a section: two a side and the trailing edge.
FEWEST = 5
#: A trailing edge that is open by less of the chord is closed by rounding of the file: thinner ones are not built.
ROUNDED = 1e-4
#: What the ends of the list may be away from the trailing edge, relative to the chord.
AT_THE_END = 0.1
#: Coordinates of 999 separate the elements of a section in files for panel codes.
SEPARATOR = 999.0

Point = tuple[float, ...]


def _numbers(line: str) -> Point | None:
    """The line's numbers, None if it has anything else."""
    try:
        return tuple(float(entry) for entry in line.replace(",", " ").split())
    except ValueError:
        return None


def _lines(data: bytes, count: int | None = None) -> list[tuple[int, str]]:
    """Numbered lines that say something."""
    # Old files are in all encodings; only the name has letters.
    text = data.decode("utf-8-sig", errors="replace").splitlines()[:count]
    return [(k, line.strip()) for k, line in enumerate(text, 1) if line.strip()]


def looks_like_airfoil(data: bytes) -> bool:
    """Whether the first line is a name and pairs of numbers follow (a comma-separated header is none)."""
    lines = [line for _, line in _lines(data[:4096], 40)[:-1]]
    if len(lines) < FEWEST or _numbers(lines[0]) is not None:
        return False
    if lines[0][0] in "#<{[" or [x.strip().lower() for x in lines[0].replace(",", " ").split()] == ["x", "y"]:
        return False
    pairs = [_numbers(line) for line in lines[1:]]
    return all(pair is not None and len(pair) == 2 for pair in pairs)


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of a section; see `patchtransfer.read_boundary`."""
    at_most(data.count(b"\n") + data.count(b"\r"), 2 * MAX_LINES, "line ends", "delete empty lines")
    lines = _lines(data)
    if not lines:
        raise InputError("holds no points; list x y line by line")
    name = lines[0][1] if _numbers(lines[0][1]) is None else ""
    rows = [_pair(number, line) for number, line in (lines[1:] if name else lines)]
    at_most(len(rows), MAX_CURVES, "points", "take every other one")
    if len(rows) < FEWEST:
        raise InputError(f"has {len(rows)} points; a section needs at least {FEWEST}, from its trailing edge on")
    notes = [f"airfoil {name[:80]!r}"] if name else []
    points = _lednicer(rows) if _starts_with_counts(rows) else np.array(rows)
    return _section(points, notes, options)


def _pair(number: int, line: str) -> Point:
    pair = _numbers(line)
    if pair is None or len(pair) != 2:
        raise InputError(f"line {number}: expected two numbers x y, got {line[:40]!r}; correct it")
    # A smooth curve through them must not overflow; the comparison also refuses NaN.
    if not all(abs(value) <= LARGEST_SMOOTH for value in pair):
        raise InputError(f"line {number}: NaN, infinity or a number above {LARGEST_SMOOTH:g}; give finite numbers")
    if min(pair) >= SEPARATOR:
        raise InputError(f"line {number}: separates elements of a section, which is several outlines; keep one")
    return pair


def _starts_with_counts(rows: Sequence[Point]) -> bool:
    """Whether the first row has numbers of points: they add up, or are whole and beyond all coordinates."""
    if len(rows) < FEWEST or not all(2 <= value == value // 1 for value in rows[0]):
        return False
    return sum(rows[0]) == len(rows) - 1 or min(rows[0]) > max(max(map(abs, row)) for row in rows[1:])


def _lednicer(rows: Sequence[Point]) -> FloatArray:
    upper, lower = (int(n) for n in rows[0])
    points = np.array(rows[1:]).reshape(-1, 2)
    if upper + lower != len(points):
        raise InputError(
            f"announces {upper} and {lower} points, but {len(points)} follow; correct the numbers or the list"
        )
    first, second = points[:upper][::-1], points[upper:]
    same = np.linalg.norm(first[-1] - second[0]) <= TOLERANCE * _chord(points)
    return np.concatenate([first, second[1:] if same else second])


def _chord(points: FloatArray) -> float:
    return float(np.ptp(points[:, 0])) if len(points) else 0.0


def _section(points: FloatArray, notes: list[str], options: BoundaryOptions) -> Boundary:
    """The loop through points from the trailing edge around the leading edge."""
    chord = _chord(points)
    if not chord > 0:
        raise InputError("has no extent in x; list the points of a section")
    ends = points[[0, -1]]
    if (ends[:, 0] < points[:, 0].max() - AT_THE_END * chord).any():
        raise InputError(
            f"starts at x = {ends[0, 0]:g} and ends at x = {ends[1, 0]:g}, but the trailing edge is at "
            f"x = {points[:, 0].max():g}; list the points from the trailing edge around the leading edge"
        )
    gap = float(np.linalg.norm(ends[1] - ends[0]))
    if gap <= (ROUNDED if options.clean else TOLERANCE) * chord:
        if gap > 0:
            notes.append(f"trailing edge closed: its ends were {gap:.3g} apart")
        points = np.concatenate([[ends.mean(axis=0)], points[1:-1], [ends.mean(axis=0)]])
        blunt = []
    else:
        notes.append(f"trailing edge closed by a straight side of length {gap:.3g}")
        blunt = [_straight(ends[1], ends[0])]
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    repeated = step <= 1e-12 * np.hypot(*np.ptp(points, axis=0))
    if repeated.any():
        notes.append(f"{np.count_nonzero(repeated)} repeated points left out")
        points, step = points[np.append(True, ~repeated)], step[~repeated]
    if len(points) < FEWEST:
        raise InputError(f"has {len(points)} points that differ; a section needs at least {FEWEST}")
    if options.smooth is False:
        sides = [_straight(a, b) for a, b in pairwise(points)]
    else:
        sides = [_through(points, np.append(0.0, np.cumsum(step)))]
    return Boundary([close_loop([*sides, *blunt])], notes)


def _straight(a: FloatArray, b: FloatArray) -> BSplineCurve:
    return BSplineCurve([0.0, 0.0, 1.0, 1.0], 1, [a, b])


def _through(points: FloatArray, x: FloatArray) -> BSplineCurve:
    """Cubic spline by chord length."""
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(x, points, k=3)
    control = spline.c.copy()
    control[0], control[-1] = points[0], points[-1]
    return BSplineCurve(spline.t, 3, control)
