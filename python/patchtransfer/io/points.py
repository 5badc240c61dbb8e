"""CSV: closed outlines as lists of points, and landmarks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..limits import LARGEST, MAX_CURVES, MAX_LANDMARKS, MAX_LINES, MAX_LOOPS, TOO_LARGE, at_most
from ..numeric.arrays import FloatArray
from .interpolation import interpolate_outline
from .options import DEFAULT, BoundaryOptions
from .point_loops import PointLoop, boundary_of_points

__all__ = [
    "interpolate_outline",
    "landmarks_text",
    "looks_like_points",
    "read_boundary",
    "read_landmarks",
    "read_named_landmarks",
]

LANDMARK_COLUMNS, NAME_COLUMN = ("xs", "ys", "xt", "yt"), "name"


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
    # The comparison also refuses NaN.
    if not all(abs(value) <= LARGEST for value in values):
        raise InputError(f"line {number}: NaN, infinity or a number {TOO_LARGE}; give finite numbers")
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
    loops = [_outline(block) for block in blocks if block]
    if not loops:
        raise InputError("holds no points; list x,y line by line")
    return boundary_of_points(loops, options)


def _outline(block: list[tuple[int, list[float]]]) -> PointLoop:
    lines = [number for number, _ in block]
    name = f"the outline that starts at line {lines[0]}"
    return PointLoop(name, np.array([values for _, values in block]), lambda i: f"line {lines[i]}")


def read_landmarks(data: bytes) -> FloatArray:
    """Landmarks (r, 4) of a CSV file; see `patchtransfer.read_landmarks`."""
    return read_named_landmarks(data)[0]


def read_named_landmarks(data: bytes) -> tuple[FloatArray, list[str]]:
    """Landmarks (r, 4) of a CSV file and their names, "" where the file has none."""
    names: list[str] = []
    columns: list[int] = []
    rows: list[list[float]] = []
    width = 0
    for number, line in enumerate(_lines(data), 1):
        fields = _fields(line)
        if not fields:
            continue
        if not columns:
            header = [field.lower() for field in fields]
            missing = [name for name in LANDMARK_COLUMNS if header.count(name) != 1]
            if missing:
                raise InputError(
                    f"line {number}: the header must name the columns xs,ys,xt,yt once each; "
                    f"{missing[0]} is missing or repeated"
                )
            columns, width = [header.index(name) for name in LANDMARK_COLUMNS], len(header)
            named = header.index(NAME_COLUMN) if NAME_COLUMN in header else None
            continue
        if len(fields) != width:
            raise InputError(f"line {number}: {len(fields)} entries where the header has {width}; correct it")
        at_most(len(rows) + 1, MAX_LANDMARKS, "landmarks", "keep the telling ones")
        rows.append(_values([fields[c] for c in columns], number, "four numbers"))
        names.append("" if named is None else fields[named])
    if not rows:
        raise InputError("holds no landmarks; give a header xs,ys,xt,yt and at least one row")
    return np.array(rows), names


def landmarks_text(rows: FloatArray, names: Sequence[str] | None) -> str:
    """CSV of landmarks (r, 4) in full precision, with a first column of names if there are any."""
    given = [""] * len(rows) if names is None else list(names)
    if len(given) != len(rows):
        raise InputError(f"{len(given)} names for {len(rows)} landmarks; give one a landmark")
    for name in given:
        # What reading would take for the end of an entry or of a line.
        if any(mark in name for mark in ",#") or name != " ".join(name.split()):
            raise InputError(f"a landmark's name cannot be {name!r}: no commas, no #, single blanks inside")
    header = [*([] if names is None else [NAME_COLUMN]), *LANDMARK_COLUMNS]
    lines = [
        ",".join([*([] if names is None else [name]), *map(repr, row)])
        for name, row in zip(given, rows.tolist(), strict=True)
    ]
    return "\n".join([",".join(header), *lines, ""])
