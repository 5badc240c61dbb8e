"""Outlines of glyphs as the font's own tables have them, exactly: lines and quadratic or cubic Bézier curves."""

from __future__ import annotations

import logging
from functools import cache
from pathlib import Path

import matplotlib
import numpy as np
from curves import Loop, bezier
from fontTools.pens.basePen import BasePen
from fontTools.ttLib import TTFont

from patchtransfer import Boundary

# Fonts without a date are none of our business.
logging.getLogger("fontTools.ttLib.tables._h_e_a_d").setLevel(logging.ERROR)


class _Loops(BasePen):
    """Collects closed chains of curves; what has no length is left out."""

    def __init__(self, glyphs: object) -> None:
        super().__init__(glyphs)
        self.loops: list[Loop] = []

    def _moveTo(self, point: tuple[float, float]) -> None:
        self.loops.append([])
        self._start = point

    def _add(self, *points: tuple[float, float]) -> None:
        corners = np.array([self._getCurrentPoint(), *points], float)
        if (corners != corners[0]).any():
            self.loops[-1].append(bezier(corners))

    _lineTo = _qCurveToOne = _curveToOne = _add

    def _closePath(self) -> None:
        self._add(self._start)


@cache
def font(name: str) -> TTFont:
    """A font that ships with matplotlib, by its file: DejaVuSans, STIXGeneral, cmr10, ..."""
    return TTFont(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{name}.ttf")


def glyph(character: str, name: str) -> Boundary | None:
    """Outline of a letter or digit, in ems; None where it has more than one component."""
    file = font(name)
    pen = _Loops(file.getGlyphSet())
    pen.glyphSet[file.getBestCmap()[ord(character)]].draw(pen)
    em = file["head"].unitsPerEm
    loops = [[c.with_control_points(c.control_points / em) for c in loop] for loop in pen.loops if loop]
    areas = []
    for loop in loops:
        x, y = np.concatenate([curve.control_points[:-1] for curve in loop]).T
        areas.append(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    outer = np.sign(areas[int(np.argmax(np.abs(areas)))])
    return Boundary(loops) if sum(np.sign(areas) == outer) == 1 else None
