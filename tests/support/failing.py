"""Sources and targets that a transfer refuses, or for which it finds no certified map."""

from __future__ import annotations

import numpy as np

import models
import targets
from patchtransfer import Boundary, BSplineCurve, MultiPatch, Patch
from shapes import loop

SHEET = [[0.0, 0], [2, 0], [2, 1], [0, 1]]

#: Sides of three quadratic spans cannot follow it without crossing.
SLOT = [[1.9, 1], [1.9, 0.05], [0.5, 0.05], [0.5, 1]]


def folded_source() -> MultiPatch:
    """Two patches, the second with a control point far outside."""
    mp = models.grid(2, 1, 2, 1, seed=None)
    points = [p.control_points.copy() for p in mp.patches]
    points[1][1, 1] = [-3, -3]
    return mp.with_control_points(points)


def rational_source() -> MultiPatch:
    """Two patches, the second with weights that differ away from the interface."""
    mp = models.grid(2, 1, 2, 1)
    a, b = mp.patches
    weights = np.ones(b.shape)
    weights[-1, -1] = 2.0
    return MultiPatch([a, Patch(b.knots, b.degrees, b.control_points, weights)])


def disconnected_source() -> MultiPatch:
    """Two patches far apart."""
    a = models.grid(1, 1)
    return MultiPatch([*a.patches, a.patches[0].with_control_points(a.patches[0].control_points + 5)])


def plate() -> MultiPatch:
    """A source with a hole, for `moved_hole`."""
    return models.plate_with_hole(2, 2)


def moved_hole(shift) -> Boundary:
    """The plate's boundary with the hole elsewhere: across the outer loop, or outside."""
    outer, hole = plate().boundary().loops
    return Boundary([outer, [BSplineCurve(c.knots, c.degree, c.control_points + shift) for c in hole]])


def reentrant() -> Boundary:
    """An arrowhead: its fourth corner, which one patch has to fill, has 270 degrees."""
    return loop([[0, 0], [2, 0.5], [0.5, 0.5], [0.5, 2]])


def eight() -> Boundary:
    """A quadrilateral that crosses itself."""
    return loop([[0, 0], [1, 1], [1, 0], [0, 1.2]])


def notched(*notch, spans: int = 1) -> tuple[MultiPatch, Boundary, np.ndarray]:
    """A sheet with few quadratic spans a side, and the sheet with a notch in its upper side."""
    mp = models.build([models.bilinear(*SHEET)], 2, spans, None)
    return mp, loop([*SHEET[:3], *notch, SHEET[3]]), np.hstack([SHEET, SHEET])


def hopeless() -> tuple[MultiPatch, Boundary, np.ndarray]:
    """A swirled strip of Bézier patches, which are too stiff: the fit is good, the inside folds on every rung."""
    mp = models.strip(5, 2, 1)
    f = targets.swirl(mp, (0.5559415, 0.80298034), -500 * 0.6875, 0.5666576758324919)
    return mp, *targets.given_boundary(mp, f)
