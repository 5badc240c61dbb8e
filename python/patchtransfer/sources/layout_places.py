"""Where the boundary vertices of an abstract layout lie on the boundary: loop by loop, in order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..geometry.outline import Outline
from ..numeric.arrays import FloatArray
from ..registration.landmarks import SAME_POINT, SNAP_DISTANCE
from .quad_graph import QuadGraph

__all__ = ["LoopPlaces", "off_boundary", "places_on_boundary"]


class LoopPlaces(NamedTuple):
    """A loop of a layout on the boundary.

    Attributes
    ----------
    vertices : list of int
        In order, the domain on the left.
    points : (n, 2) array
        Where they lie on the boundary.
    lengths : (n,) array
        Arc length from every vertex to the next.
    outer : bool
        Whether it is the outer loop.
    """

    vertices: list[int]
    points: FloatArray
    lengths: FloatArray
    outer: bool


def places_on_boundary(
    graph: QuadGraph, boundary: Boundary, assignment: Mapping[int, Sequence[float]]
) -> list[LoopPlaces]:
    """Every loop of a layout on the boundary.

    Parameters
    ----------
    graph : QuadGraph
    boundary : Boundary
    assignment : mapping of int to (x, y)
        Of all boundary vertices.

    Raises
    ------
    InputError
        On another number of loops, vertices without a place or off the boundary, loops that share one of the boundary's
        or lie on several, and vertices that come in another order than their places.
    """
    loops = graph.loops
    if len(loops) != len(boundary.loops):
        raise InputError(
            f"the layout has {len(loops)} boundary loop{'s' if len(loops) > 1 else ''} and the boundary "
            f"{len(boundary.loops)}; a layout needs a loop for the outline and for every hole"
        )
    missing = [v for v in graph.boundary_vertices if v not in assignment]
    if missing:
        raise InputError(
            f"boundary vertex {missing[0]} of the layout has no place on the boundary; assign it a boundary point"
        )
    outlines = [Outline(loop) for loop in boundary.loops]
    largest = int(np.argmax([abs(outline.area) for outline in outlines]))
    taken: dict[int, int] = {}
    found = []
    for number, vertices in enumerate(loops):
        points = np.array([assignment[v] for v in vertices], dtype=np.float64)
        k, s = _loop_of(vertices, points, outlines, boundary.diameter)
        if k in taken:
            raise InputError(
                f"layout loops {taken[k]} and {number} (with vertices {loops[taken[k]][0]} and {vertices[0]}) are both "
                f"assigned to boundary loop {k}; each needs a loop of its own"
            )
        taken[k] = number
        outline = outlines[k]
        forwards = s if (outline.area > 0) == (k == largest) else -s
        lengths = _steps(vertices, forwards, outline.length, k)
        found.append(LoopPlaces(vertices, outline.point(s), lengths, k == largest))
    return found


def off_boundary(vertex: int, point: FloatArray, distance: float, diameter: float) -> InputError:
    """The error of a boundary vertex that is too far from the boundary."""
    x, y = point
    return InputError(
        f"layout vertex {vertex} at ({x:g}, {y:g}) is {distance:.3g} off the boundary (allowed: {SNAP_DISTANCE:.0%} of "
        f"the diameter, {SNAP_DISTANCE * diameter:.3g}); move it, or assign it a boundary point"
    )


def _loop_of(
    vertices: list[int], points: FloatArray, outlines: Sequence[Outline], diameter: float
) -> tuple[int, FloatArray]:
    """The boundary loop that all of some points lie on, and their arc lengths on it."""
    feet = [outline.nearest(points) for outline in outlines]
    distance = np.array([d for _, d in feet])
    # By the farthest vertex: loops may run side by side closer than points are known.
    k = int(distance.max(axis=1).argmin())
    if distance[k].max() <= SNAP_DISTANCE * diameter:
        return k, feet[k][0]
    nearest = distance.argmin(axis=0)
    far = int(distance.min(axis=0).argmax())
    if distance[nearest[far], far] > SNAP_DISTANCE * diameter:
        raise off_boundary(vertices[far], points[far], float(distance[nearest[far], far]), diameter)
    # Most are right.
    k = int(np.bincount(nearest).argmax())
    same, other = (int(np.flatnonzero(mask)[0]) for mask in (nearest == k, nearest != k))
    raise InputError(
        f"layout vertices {vertices[same]} and {vertices[other]} are on one loop of the layout, but assigned to "
        f"boundary loops {k} and {nearest[other]}; assign them points of one loop"
    )


def _steps(vertices: list[int], s: FloatArray, length: float, k: int) -> FloatArray:
    """Arc lengths from each vertex to the next, once round."""
    steps = np.mod(np.roll(s, -1) - s, length)
    close = np.flatnonzero(np.minimum(steps, length - steps) <= SAME_POINT * length)
    if len(close):
        i = int(close[0])
        raise InputError(
            f"layout vertices {vertices[i]} and {vertices[(i + 1) % len(vertices)]} are assigned to the same point of "
            f"boundary loop {k}; give each a point of its own"
        )
    turns = round(float(steps.sum()) / length)
    if turns == len(vertices) - 1:
        raise InputError(
            f"the layout's loop through vertices {', '.join(map(str, vertices[:3]))}, ... runs backwards along "
            f"boundary loop {k}: the assignment is of the mirror image; list the quads' vertices the other way round"
        )
    if turns != 1:
        past = np.flatnonzero(steps + np.roll(steps, -1) > length)
        if not len(past):
            raise InputError(
                f"the layout's loop through vertices {', '.join(map(str, vertices[:3]))}, ... goes {turns} times round "
                f"boundary loop {k} by its assignment; let it go round once"
            )
        i = int(past[0])
        three = [vertices[(i + j) % len(vertices)] for j in range(3)]
        raise InputError(
            f"the assignment does not keep the order of the layout's boundary: vertices {three[0]}, {three[1]} and "
            f"{three[2]} follow each other on the layout, but vertex {three[1]} does not lie between the others on "
            f"boundary loop {k}; exchange their points"
        )
    return steps
