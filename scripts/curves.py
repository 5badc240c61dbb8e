"""Curves and closed chains of them, from formulas: what outlines are built of."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from patchtransfer import BSplineCurve

Loop = list[BSplineCurve]


def unit(angles: np.ndarray) -> np.ndarray:
    """Points of the unit circle."""
    return np.column_stack([np.cos(angles), np.sin(angles)])


def bezier(points: np.ndarray) -> BSplineCurve:
    """One polynomial span."""
    degree = len(points) - 1
    return BSplineCurve([0.0] * (degree + 1) + [1.0] * (degree + 1), degree, points)


def polygon(corners: object) -> Loop:
    """Lines from corner to corner, and back to the first."""
    points = np.asarray(corners, float)
    return [bezier(np.array(ends)) for ends in zip(points, np.roll(points, -1, axis=0), strict=True)]


def regular(number: int) -> Loop:
    """Regular polygon that stands on a side."""
    return polygon(unit(-np.pi / 2 + np.pi / number + 2 * np.pi * np.arange(number) / number))


def rectangle(width: float, height: float) -> Loop:
    """Round the origin."""
    return polygon(np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * [width / 2, height / 2])


def arc(radius: float, begin: float, end: float) -> BSplineCurve:
    """Circular arc, exact: rational quadratic spans of at most a right angle."""
    pieces = int(np.ceil(abs(end - begin) / (np.pi / 2) - 1e-9))
    points = radius * unit(np.linspace(begin, end, 2 * pieces + 1))
    half = np.cos((end - begin) / pieces / 2)
    points[1::2] /= half
    knots = [0.0] * 3 + [float(k) for k in range(1, pieces) for _ in "12"] + [float(pieces)] * 3
    return BSplineCurve(knots, 2, points, [1.0, half] * pieces + [1.0])


def ellipse(a: float, b: float, at: tuple[float, float] = (0, 0)) -> Loop:
    """An ellipse of semi-axes a and b."""
    circle = arc(1.0, 0.0, 2 * np.pi)
    points = circle.control_points.copy()
    points[-1] = points[0]
    return [circle.with_control_points(points * [a, b] + at)]


def smooth(points: np.ndarray, closed: bool) -> BSplineCurve:
    """Cubic interpolating spline, closed smoothly or with natural ends; double knots."""
    x = np.asarray(points, float)
    if closed:
        x = np.append(x, x[:1], axis=0)
    spans = len(x) - 1
    slope = CubicSpline(np.arange(spans + 1), x, bc_type="periodic" if closed else "natural")(np.arange(spans + 1), 1)
    inner = np.stack([x[:-1] + slope[:-1] / 3, x[1:] - slope[1:] / 3], axis=1).reshape(-1, 2)
    knots = [0.0] * 4 + [float(k) for k in range(1, spans) for _ in "12"] + [float(spans)] * 4
    return BSplineCurve(knots, 3, np.concatenate([x[:1], inner, x[-1:]]))


def bulged(vertices: list[tuple[float, float, float]]) -> Loop:
    """Lines and arcs, closed: x, y and, as in DXF, the tangent of a quarter of the angle of the arc that follows."""
    loop = []
    for (x, y, bulge), (x_next, y_next, _) in zip(vertices, vertices[1:] + vertices[:1], strict=True):
        a, b = np.array([x, y]), np.array([x_next, y_next])
        if bulge == 0:
            loop.append(bezier(np.array([a, b])))
            continue
        angle, chord = 4 * np.arctan(bulge), b - a
        centre = (a + b) / 2 + np.array([-chord[1], chord[0]]) / (2 * np.tan(angle / 2))
        begin = np.arctan2(*(a - centre)[::-1])
        curve = arc(float(np.linalg.norm(a - centre)), begin, begin + angle)
        points = curve.control_points + centre
        points[[0, -1]] = a, b
        loop.append(curve.with_control_points(points))
    return loop


def mirrored(loops: list[Loop]) -> list[Loop]:
    """Left and right exchanged."""
    return [[curve.with_control_points(curve.control_points * [-1, 1]) for curve in loop] for loop in loops]


def naca(digits: str) -> Loop:
    """Airfoil of four digits with a closed trailing edge, chord 1 about the origin, from its trailing edge on."""
    camber, at, thickness = int(digits[0]) / 100, int(digits[1]) / 10, int(digits[2:]) / 100
    # The root of x is a cosine that changes its sign at the nose, which makes the nose smooth.
    root = np.cos(np.linspace(0, np.pi, 41))
    root[20] = 0.0
    x = root**2
    tail = -0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4
    half = 5 * thickness * (0.2969 * root + np.sign(root) * tail)
    if not camber:
        return [smooth(np.column_stack([x - 0.5, half]), closed=False)]
    reach = np.where(x < at, at, 1 - at)
    line = np.where(x < at, 0.0, 1 - 2 * at) + 2 * at * x - x**2
    slope = np.arctan(2 * camber * (at - x) / reach**2)
    points = np.column_stack([x - half * np.sin(slope) - 0.5, camber * line / reach**2 + half * np.cos(slope)])
    points[-1] = points[0]
    return [smooth(points, closed=False)]
