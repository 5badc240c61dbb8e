"""Rational models: arcs of conics, annuli, discs, and what is made of them."""

from __future__ import annotations

import numpy as np

from patchtransfer import BSplineCurve, MultiPatch, Patch
from shapes import turned

BEZIER = {p: [0.0] * (p + 1) + [1.0] * (p + 1) for p in (1, 2, 3)}


def conic(a, b, c, weight: float) -> BSplineCurve:
    """From a to c, tangent to a-b and b-c: an ellipse's arc, a parabola's or a hyperbola's by the weight."""
    return BSplineCurve(BEZIER[2], 2, [a, b, c], [1.0, weight, 1.0])


def arc(angle: float, start: float = 0.0) -> BSplineCurve:
    """Of the unit circle, less than 180 degrees of it (radians)."""
    w = np.cos(angle / 2)
    a = start + np.array([0.0, angle / 2, angle])
    return conic(*(np.column_stack([np.cos(a), np.sin(a)]) / np.array([[1.0], [w], [1.0]])), w)


def ring(
    inner: float = 0.5, outer: float = 1.0, patches: int = 4, angle: float = 2 * np.pi, degree: int = 2
) -> list[Patch]:
    """Patches of an annulus or a part of one: u runs outwards, v along the arcs."""
    radii = np.linspace(inner, outer, degree + 1)
    made = []
    for k in range(patches):
        part = arc(angle / patches, k * angle / patches)
        points = radii[:, None, None] * part.control_points
        made.append(Patch((BEZIER[degree], BEZIER[2]), (degree, 2), points, np.ones((degree + 1, 1)) * part.weights))
    return made


def annulus(inner: float = 0.5, outer: float = 1.0, patches: int = 4, spans: int = 1) -> MultiPatch:
    """With biquadratic patches; four of one span have 24 control points."""
    return MultiPatch([patch.split_spans(spans) for patch in ring(inner, outer, patches)])


def disc() -> Patch:
    """The unit disc in one patch, whose corners are straight angles."""
    r = 0.5**0.5
    net = [[(-1, -1), (-2, 0), (-1, 1)], [(0, -2), (0, 0), (0, 2)], [(1, -1), (2, 0), (1, 1)]]
    return Patch((BEZIER[2], BEZIER[2]), (2, 2), r * np.array(net), [[1, r, 1], [r, 1, r], [1, r, 1]])


def plate(spans: int = 1) -> MultiPatch:
    """A quarter of a plate with a hole, weights of rank two, and a polynomial patch glued to its far side."""
    hole = [arc(np.pi / 4, np.pi / 4 * k) for k in (0, 1)]
    far = [np.array([[4.0, 0], [4, 2], [4, 4]]), np.array([[4.0, 4], [2, 4], [0, 4]])]
    made = []
    for inner, outer in zip(hole, far, strict=True):
        points = np.stack([inner.control_points, (inner.control_points + outer) / 2, outer])
        weights = np.stack([inner.weights, (inner.weights + 1) / 2, np.ones(3)])
        made.append(Patch((BEZIER[2], BEZIER[2]), (2, 2), points, weights))
    x = np.array([4.0, 5.0, 6.0])
    beside = np.stack([np.column_stack([np.full(3, s), [0.0, 2.0, 4.0 + (s - 4) / 4]]) for s in x])
    made.append(Patch((BEZIER[2], BEZIER[2]), (2, 2), beside))
    return MultiPatch([patch.split_spans(spans) for patch in made])


def spun(mp: MultiPatch, turns, order) -> MultiPatch:
    """The same domain, with patches in another order and other directions of parameters."""
    patches = [turned(patch, *turn) for patch, turn in zip(mp.patches, turns, strict=True)]
    return MultiPatch([patches[i] for i in order])


def moved(mp: MultiPatch, scale: float, angle: float, shift) -> MultiPatch:
    """The image of a similarity."""
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    return mp.with_control_points([p.control_points @ np.array([[c, s], [-s, c]]) + shift for p in mp])


def disc_in_a_square() -> MultiPatch:
    """The unit disc in one patch, whose corners are straight angles inside, and four patches around it."""
    inner = disc()
    ends = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    around = []
    for side in MultiPatch([inner]).boundary().loops[0]:
        corners = [ends[np.argmin(((ends - x) ** 2).sum(axis=1))] * 2 for x in (side.start, side.end)]
        line = np.stack([corners[0], (corners[0] + corners[1]) / 2, corners[1]])
        net = np.stack([side.control_points, (side.control_points + line) / 2, line])
        weights = np.stack([side.weights, (side.weights + 1) / 2, np.ones(3)])
        around.append(Patch((BEZIER[2], BEZIER[2]), (2, 2), net, weights))
    return MultiPatch([inner, *around])


def cornered_plate() -> MultiPatch:
    """A quarter of a plate with a hole in one patch, whose far side turns at a double knot."""
    arcs = [arc(np.pi / 4, np.pi / 2 + np.pi / 4 * k) for k in (1, 0)]
    hole = [c.reversed() for c in arcs]
    far = np.array([[-4.0, 0], [-4, 2], [-4, 4], [-2, 4], [0, 4]])
    near = np.concatenate([hole[0].control_points, hole[1].control_points[1:]])
    weights = np.concatenate([hole[0].weights, hole[1].weights[1:]])
    knots = ([0, 0, 0, 1, 1, 2, 2, 2], [0, 0, 1, 1])
    return MultiPatch([Patch(knots, (2, 1), np.stack([near, far], axis=1), np.column_stack([weights, np.ones(5)]))])
