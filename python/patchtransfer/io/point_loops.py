"""Closed lists of points, from any file or array, to a boundary."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..limits import MAX_CURVES, MAX_LOOPS, TOO_LARGE, at_most, first_unusable
from ..numeric.arrays import FloatArray
from .cleaning import absorb, cleaned
from .interpolation import read_outline
from .options import DEFAULT, BoundaryOptions
from .sampling import CORNER_ANGLE

__all__ = ["PointLoop", "boundary_of_points", "from_points"]

#: Consecutive points nearer than this (relative to the loop's diameter) are the same.
SAME = 1e-12


@dataclass(frozen=True)
class PointLoop:
    """A closed outline: name in messages, points (n, 2), the first repeated at the end or not, and what to call one."""

    name: str
    points: FloatArray
    place: Callable[[int], str] | None = None

    def at(self, i: int) -> str:
        """What to call point i."""
        return f"{self.name}, point {i}" if self.place is None else self.place(i)


def boundary_of_points(
    loops: Sequence[PointLoop],
    options: BoundaryOptions = DEFAULT,
    notes: Sequence[str] = (),
    corner_angle: float = CORNER_ANGLE,
) -> Boundary:
    """Boundary through closed lists of points, cleaned if the options say so, with notes on what was decided.

    Parameters
    ----------
    loops : sequence of PointLoop
    options : BoundaryOptions
    notes : sequence of str
        What the reader has to say itself.
    corner_angle : float, default 30
        Turn, in degrees, from which a point of a smooth curve is a corner.

    Raises
    ------
    InputError
        When a loop has fewer than 3 distinct points, or repeats one and may not be cleaned.
    """
    at_most(len(loops), MAX_LOOPS, "outlines", "keep those of the domain")
    at_most(sum(len(loop.points) for loop in loops), MAX_CURVES, "points", "take every other one")
    told = list(notes)
    curves, readings = [], []
    for loop in loops:
        points = _distinct(loop, options.clean, told)
        if options.clean:
            points = absorb(points, told, loop.name)
        outline, reading = read_outline(points, loop.name, options.smooth, corner_angle)
        curves.append(outline)
        corners = int(reading.corner.sum()) if any(c.degree > 1 for c in outline) else None
        readings.append((loop.name, len(points), corners))
    if options.clean:
        curves = cleaned(curves, told)
    if options.smooth is None:
        told += _decided(readings)
    return Boundary(curves, told)


def from_points(
    loops: ArrayLike | Sequence[ArrayLike], *, smooth: bool | None, corner_angle: float, clean: bool
) -> Boundary:
    """See `Boundary.from_points`."""
    if not 0 < corner_angle < 180:
        raise InputError(f"corner_angle must lie between 0 and 180 degrees, got {corner_angle!r}")
    try:
        single = np.ndim(loops) == 2  # type: ignore[arg-type]
    except ValueError:
        # Lists of different lengths are several loops.
        single = False
    arrays: list[Any] = [loops] if single else list(loops)  # type: ignore[arg-type]
    if not arrays:
        raise InputError("no loops; pass an (n, 2) array of points, or a list of them")
    return boundary_of_points(
        [PointLoop(f"loop {k}", _array(each, k)) for k, each in enumerate(arrays)],
        BoundaryOptions(clean, smooth),
        corner_angle=corner_angle,
    )


def _array(points: ArrayLike, number: int) -> FloatArray:
    try:
        array = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"loop {number} is not an array of numbers; pass (n, 2) arrays of points") from None
    if array.ndim != 2 or array.shape[1] != 2 or not len(array):
        raise InputError(f"loop {number} has the shape {array.shape}; pass (n, 2) arrays of points")
    if (wrong := first_unusable(array)) is not None:
        raise InputError(f"loop {number}, point {wrong // 2}: NaN, infinity or a number {TOO_LARGE}")
    return array


def _distinct(loop: PointLoop, clean: bool, notes: list[str]) -> FloatArray:
    """Points of a loop without the repeated first one, and without other repetitions if these may be mended."""
    points = loop.points
    same = SAME * float(np.linalg.norm(np.ptp(points, axis=0)))
    if len(points) > 1 and np.linalg.norm(points[-1] - points[0]) <= same:
        points = points[:-1]
    step = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    repeated = (step <= same) & (len(points) > 1)
    # Only the last point can equal the first one here, and the last one is the repetition then.
    numbers = [int(i) if i else len(points) - 1 for i in np.flatnonzero(repeated)]
    if numbers and not clean:
        raise InputError(f"{loop.at(numbers[0])}: repeats the point before it; delete it")
    if len(np.unique(points, axis=0)) < 3:
        raise InputError(f"{loop.name} has fewer than 3 distinct points; add points")
    if numbers:
        more = f" and {len(numbers) - 1} more" if len(numbers) > 1 else ""
        notes.append(f"left out repeated points: {loop.at(numbers[0])}{more}")
    return np.delete(points, numbers, axis=0)


def _decided(readings: Sequence[tuple[str, int, int | None]]) -> list[str]:
    """A note for each way in which points were read: with a number of corners, or None for polygons."""
    notes = []
    for smooth in (False, True):
        those = [each for each in readings if (each[2] is not None) == smooth]
        if not those:
            continue
        if len(those) == 1:
            name, count, _ = those[0]
            who = f"{name} ({count} points): "
        else:
            counts = [count for _, count, _ in those]
            who = f"{len(those)} outlines ({min(counts)} to {max(counts)} points): "
        if smooth:
            corners = sum(number or 0 for _, _, number in those)
            corners_text = f" with {corners} corners" if corners != 1 else " with 1 corner"
            how = f"taken as samples of a smooth curve{corners_text}; smooth=False (--polygon) keeps the straight edges"
        else:
            how = "taken as corners of a polygon; smooth=True (--smooth) draws a smooth curve through them"
        notes.append(who + how)
    return notes
