"""Rows of interfaces in G+Smo XML: of 8 or of 5 numbers, by ids or by positions, as the patches fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...errors import InputError
from ...geometry.interfaces import Misfit, misfits
from ...geometry.patch import Patch
from ...geometry.sides import Interface, Side

__all__ = ["NONE", "Reading", "best", "readings"]

#: Numbers of an interface's row and, of these, flags at the end. The shorter rows are those of before 2014.
WIDTHS = {8: 4, 5: 1}
#: Attribute of an empty <interfaces> that says that sides which coincide are apart on purpose: other programs leave it
#: empty when they have not looked.
NONE = ("rows", "0")
#: Flags of a row are 0 and 1; the shorter rows' may be a sign as well.
FLAGS = {8: {0, 1}, 5: {-1, 0, 1}}


class Reading(NamedTuple):
    """One way to understand the numbers of interfaces: `tables` has an entry an element."""

    meaning: Mapping[int, int]
    tables: list[list[Interface]]
    misfits: list[Misfit]

    @property
    def interfaces(self) -> list[Interface]:
        """All, each pair of sides once."""
        every = (f for table in self.tables for f in table)
        return list({frozenset([(f.patch_a, f.side_a), (f.patch_b, f.side_b)]): f for f in every}.values())


def readings(patches: list[Patch], tables: list[list[int]], meanings: Sequence[Mapping[int, int]]) -> list[Reading]:
    """All ways to understand the tables whose patches, sides and flags exist: length of rows, ids or positions."""
    total = sum(map(len, tables))
    widths = [width for width in WIDTHS if not any(len(table) % width for table in tables)]
    if not widths:
        raise InputError(f"MultiPatch interfaces: {total} numbers are not rows of 8 or 5; the file is incomplete")
    found, errors = list[Reading](), list[str]()
    for width in widths:
        rows = [np.array(table, dtype=np.int64).reshape(-1, width) for table in tables]
        all_rows = np.concatenate(rows)
        if not np.isin(all_rows[:, [1, 3]], [s.value for s in Side]).all():
            errors.append("a side is not 1, 2, 3 or 4; correct it")
            continue
        # Flags only tell the lengths apart: programs disagree on what they mean.
        if len(widths) > 1 and not set(all_rows[:, -WIDTHS[width] :].ravel().tolist()) <= FLAGS[width]:
            errors.append("a direction or orientation is not 0 or 1; correct it")
            continue
        named = set(all_rows[:, [0, 2]].ravel().tolist())
        usable = [m for m in meanings if named <= m.keys()]
        if not usable:
            errors.append(f"there is no patch {sorted(named - meanings[0].keys())[0]}; correct the row")
        for meaning in usable:
            glued = [[_interface(patches, row, meaning) for row in table.tolist()] for table in rows]
            found.append(Reading(meaning, glued, []))
    if not found:
        raise InputError(f"MultiPatch interfaces: {errors[0]}")
    return found


def _interface(patches: list[Patch], row: list[int], meaning: Mapping[int, int]) -> Interface:
    a, side_a, b, side_b = meaning[row[0]], Side(row[1]), meaning[row[2]], Side(row[3])
    along = row[4] if len(row) == 5 else row[6 + side_a.axis]
    return Interface(a, side_a, b, side_b, _backwards(patches[a], side_a, patches[b], side_b, along != 1))


def _backwards(a: Patch, side_a: Side, b: Patch, side_b: Side, flag: bool) -> bool:
    """Whether two sides run in opposite directions: as their control points say, by the flag if they fit both ways.

    Programs disagree on what the orientation flags of an interface mean, but not on where the sides are.
    """
    points_a, points_b = side_a.of(a.control_points), side_b.of(b.control_points)
    if len(points_a) != len(points_b):
        points_a, points_b = points_a[[0, -1]], points_b[[0, -1]]
    along, against = (float(np.abs(points_a - points).max()) for points in (points_b, points_b[::-1]))
    return flag if along == against else against < along


def best(patches: list[Patch], readings: list[Reading]) -> Reading:
    """The reading with the fewest interfaces that do not fit."""
    weighed = []
    for reading in readings:
        found = list(misfits(patches, reading.interfaces))
        if not found:
            return reading
        weighed.append(reading._replace(misfits=found))
    return min(weighed, key=lambda r: len(r.misfits) / len(r.interfaces))
