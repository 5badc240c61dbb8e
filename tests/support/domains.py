"""Outlines of known layouts, and outlines moved, mirrored, reversed and renumbered."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from outlines import smooth_loop
from patchtransfer import Boundary, BSplineCurve
from shapes import LINE, SQUARE, circle, loop, polygon


def _round(centre, radii) -> list[BSplineCurve]:
    curve = circle()
    return [curve.with_control_points(curve.control_points * radii + centre)]


def _arc(radius: float, angles: np.ndarray) -> BSplineCurve:
    points = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    spline = make_interp_spline(np.linspace(0, 1, len(angles)), points, k=3)
    return BSplineCurve(spline.t, 3, spline.c)


def ring_segment(end: float) -> Boundary:
    """A C: between two arcs of radius 0.6 and 1, from 0.5 radians on."""
    angles = np.linspace(0.5, end, 25)
    outer, inner = _arc(1.0, angles), _arc(0.6, angles[::-1])
    return Boundary(
        [
            [
                outer,
                BSplineCurve(LINE, 1, [outer.end, inner.start]),
                inner,
                BSplineCurve(LINE, 1, [inner.end, outer.start]),
            ]
        ]
    )


def wavy(waves: int, depth: float, stretch=(1.0, 1.0), turn: float = 0.0) -> Boundary:
    """A smooth loop whose distance from its centre goes up and down."""
    angle = np.linspace(0, 2 * np.pi, 8 * waves, endpoint=False)
    radius = 1 + depth * np.cos(waves * angle + turn)
    return Boundary([smooth_loop(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) * stretch)])


def mirrored_blob() -> Boundary:
    """A smooth loop and its mirror image in the y-axis, to the last bit."""
    half = np.array([(0, -1), (0.4, -1), (1.2, -0.9), (1.0, 0.1), (1.1, 1.3), (0.5, 1.2), (0, 1.2)])
    right = BSplineCurve([0, 0, 0, 0, 1, 2, 3, 4, 4, 4, 4], 3, half)
    return Boundary([[right, BSplineCurve(right.knots, 3, half[::-1] * [-1, 1])]])


def pentagon() -> Boundary:
    """Regular, of radius 1."""
    angle = 0.3 + 2 * np.pi * np.arange(5) / 5
    return loop(np.column_stack([np.cos(angle), np.sin(angle)]))


def disk(centre=(0.0, 0.0), radii=(1.0, 1.0)) -> Boundary:
    """An ellipse."""
    return Boundary([_round(centre, radii)])


def ring() -> Boundary:
    """Between circles of radius 0.4 and 1."""
    return Boundary([*disk().loops, _round((0, 0), (0.4, 0.4))])


def plate(centre=(0.0, 0.0), radius: float = 0.45) -> Boundary:
    """A square of side 2 with a round hole."""
    return Boundary([polygon(2 * SQUARE - 1), _round(centre, (radius, radius))])


L = loop([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)])
SKEW_L = loop([(0, 0), (2.1, 0.1), (2.3, 1.2), (1.1, 1.0), (0.9, 2.2), (-0.1, 1.8)])
T = loop([(-0.4, 0), (0.4, 0), (0.4, 1.5), (1.3, 1.5), (1.3, 2.3), (-1.3, 2.3), (-1.3, 1.5), (-0.4, 1.5)])
#: Two sides cross at (0.5, 0.5).
BOW_TIE = loop([(0, 0), (1, 1), (1, 0), (0, 1)])


def mapped(boundary: Boundary, matrix, shift=(0.0, 0.0)) -> Boundary:
    """Every control point x at matrix x + shift."""
    matrix = np.asarray(matrix, float)
    return Boundary(
        [[c.with_control_points(c.control_points @ matrix.T + shift) for c in curves] for curves in boundary.loops]
    )


def rotation(degrees: float) -> np.ndarray:
    """Matrix (2, 2)."""
    a = np.radians(degrees)
    return np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])


def reversed_loops(boundary: Boundary) -> Boundary:
    """All loops the other way round."""
    return Boundary([[curve.reversed() for curve in reversed(curves)] for curves in boundary.loops])


def started_elsewhere(boundary: Boundary) -> Boundary:
    """Every loop from the middle of its first curve on."""
    loops = []
    for curves in boundary.loops:
        a, b = curves[0].domain
        middle = a + 0.4 * (b - a)
        loops.append([curves[0].restrict(middle, b), *curves[1:], curves[0].restrict(a, middle)])
    return Boundary(loops)


def through(points: np.ndarray) -> BSplineCurve:
    """A cubic through points."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    spline = make_interp_spline(length / length[-1], points, k=3)
    return BSplineCurve(spline.t, 3, spline.c)
