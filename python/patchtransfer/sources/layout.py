"""A source of one's own: a coarse quad layout and boundary curves -> multi-patch parameterization.

The layout's straight-sided quads are a multi-patch already, so they are carried onto the boundary by the package's own
pipeline: the layout's boundary vertices are the landmarks, the fit, the optimiser and the certificate are those of a
transfer. Only the reference differs: distortion is measured against a rectangle for every patch, not against the quad.
Quads that have to be bent, known by their connectivity and the places of boundary vertices, are drawn with straight
sides first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..geometry.outline import Outline
from ..geometry.rectangles import rectangle, rectangles
from ..numeric.arrays import FloatArray
from ..pipeline.plan import TransferPlan
from ..pipeline.result import TransferResult
from ..progress import Progress
from ..registration.landmarks import SNAP_DISTANCE
from ..registration.register import register
from .drawing import circle_drawing, harmonic_drawing
from .layout_places import LoopPlaces, off_boundary, places_on_boundary
from .quad_layout import QuadLayout, bilinear_patches, convex

__all__ = ["QuadLayout", "from_layout"]


#: A boundary corner this close to a layout vertex (relative to the loop's length) is at the vertex.
AT_VERTEX = 5e-3
#: Rounds of measuring the patches' rectangles anew and optimising against them.
MEASURING_ROUNDS = 3


def from_layout(
    vertices: ArrayLike | None,
    quads: ArrayLike,
    boundary: Boundary,
    degree: int = 3,
    spans: int = 2,
    *,
    assignment: Mapping[int, Sequence[float]] | None = None,
    fit_tolerance: float = 1e-3,
    refine: str = "auto",
    on_failure: str = "raise",
    progress: Progress | None = None,
) -> TransferResult:
    """Parameterize a domain from a coarse quad layout and its boundary curves.

    Parameters
    ----------
    vertices : (n, 2) array or None
        Layout vertices; those on the outline lie within 1 % of the diameter of the boundary curves. None, or guesses
        only, where `assignment` names all boundary vertices.
    quads : (m, 4) array of int
        Conforming quads, counter-clockwise; convex at `vertices`, unless `assignment` names all boundary vertices.
    boundary : Boundary
        Closed loops in any order, sense and segmentation.
    degree : int, default 3
    spans : int, default 2
        Knot spans of every patch and direction; knots are uniform and simple.
    assignment : mapping, optional
        Boundary points (x, y) of boundary vertices that are not to go to the nearest one. With all boundary vertices
        named, any quads that form a disk with holes will do, as those of `QuadLayout.abstract`.
    fit_tolerance, refine, on_failure, progress
        As in `transfer`.

    Returns
    -------
    TransferResult
        ``.multipatch`` has one patch a quad, in their order; certificate, quality and errors as of a transfer.

    Raises
    ------
    InputError
        On layouts that do not conform, inverted quads, boundary vertices off the boundary, and boundary corners inside
        a layout edge; on assignments that leave out or exchange vertices where quads are not convex.
    InfeasibleTargetError, NotCertifiedError
        As in `transfer`.

    Examples
    --------
    >>> from patchtransfer import BSplineCurve
    >>> square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    >>> sides = [BSplineCurve([0, 0, 1, 1], 1, [square[i], square[(i + 1) % 4]]) for i in range(4)]
    >>> result = from_layout(square, [[0, 1, 2, 3]], Boundary([sides]), degree=2)
    >>> result.certificate.status, round(result.quality.scaled_jacobian.min, 9)
    ('certified', 1.0)

    A disk by its connectivity, a square inside four quads at the rim:

    >>> t = np.linspace(0, 2 * np.pi, 33)
    >>> points = np.column_stack([np.cos(t), np.sin(t)])
    >>> rim = [BSplineCurve([0, 0, 1, 1], 1, points[[k, k + 1]]) for k in range(32)]
    >>> quads = [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]]
    >>> quarters = {0: (1, 0), 1: (0, 1), 2: (-1, 0), 3: (0, -1)}
    >>> from_layout(None, quads, Boundary([rim]), assignment=quarters).certificate.status
    'certified'
    """
    assignment = assignment or {}
    layout = _layout(vertices, quads, assignment)
    if vertices is not None and layout.straight:
        start = layout.multipatch(degree, spans)
        shape, landmarks = rectangles(start), _landmarks(layout, boundary, assignment)
    else:
        places = places_on_boundary(layout.graph, boundary, assignment)
        guess = _guess(layout, places)
        shape = [rectangle(patch, 1) for patch in bilinear_patches(guess, layout.quads, degree, spans)]
        layout = _drawn(layout, places, guess)
        start = layout.multipatch(degree, spans)
        landmarks = np.concatenate([np.column_stack([layout.vertices[x.vertices], x.points]) for x in places])
    _check_corners(layout, start, boundary, landmarks)
    result: TransferResult | None = None
    for k in range(MEASURING_ROUNDS):
        # The sides of the rectangles follow the patches, which follow the rectangles.
        plan = TransferPlan(start, "c0", reference=shape)
        last = k == MEASURING_ROUNDS - 1
        result = plan.transfer(
            boundary,
            landmarks,
            fit_tolerance=fit_tolerance,
            refine=refine if last else "never",
            on_failure=on_failure if last else "return",
            progress=progress,
        )
        shape = rectangles(result.multipatch)
    assert result is not None
    # A drawing of the layout is no shape that the result could be compared with.
    return replace(result, _source=None)


def _layout(vertices: ArrayLike | None, quads: ArrayLike, assignment: Mapping[int, Sequence[float]]) -> QuadLayout:
    """Straight quads if they are convex; others if all boundary vertices have a place."""
    if vertices is None:
        return QuadLayout.abstract(quads, None, assignment)
    try:
        return QuadLayout(vertices, quads)
    except InputError:
        if not assignment:
            raise
        layout = QuadLayout.abstract(quads, vertices, assignment)
        if not set(layout.boundary_vertices) <= set(assignment):
            raise
        return layout


def _guess(layout: QuadLayout, places: Sequence[LoopPlaces]) -> FloatArray:
    """Vertices where they may come to lie: on the boundary as assigned, inside as given or harmonic."""
    on_boundary = {v: point for loop in places for v, point in zip(loop.vertices, loop.points, strict=True)}
    given = layout.vertices.copy()
    given[list(on_boundary)] = list(on_boundary.values())
    harmonic = given.copy()
    harmonic[: len(layout.graph.valence)] = harmonic_drawing(layout.graph, on_boundary)
    # Those given may be of a drawing elsewhere.
    return max((given, harmonic), key=lambda vertices: np.count_nonzero(convex(vertices, layout.quads)))


def _drawn(layout: QuadLayout, places: Sequence[LoopPlaces], guess: FloatArray) -> QuadLayout:
    """The layout with straight convex quads, an injective source whatever its shape."""
    if convex(guess, layout.quads).all():
        return QuadLayout(guess, layout.quads)
    outer = next(loop for loop in places if loop.outer)
    drawing = circle_drawing(layout.graph, outer.vertices, outer.lengths)
    bad = np.flatnonzero(~convex(drawing, layout.quads))
    if len(bad):
        raise InputError(
            f"layout quad {bad[0]} {layout.quads[bad[0]].tolist()} cannot be drawn with straight convex sides: two of "
            "its vertices cut a part of the layout off the rest; split the quad"
        )
    return QuadLayout(drawing, layout.quads)


def _landmarks(layout: QuadLayout, boundary: Boundary, assignment: Mapping[int, Sequence[float]]) -> FloatArray:
    """A landmark for every boundary vertex: itself, and its assigned or nearest boundary point."""
    outlines = [Outline(loop) for loop in boundary.loops]
    on_boundary = layout.boundary_vertices
    unknown = sorted(set(assignment) - set(on_boundary))
    if unknown:
        raise InputError(f"assignment names vertex {unknown[0]}, which is not a boundary vertex of the layout")
    wanted = np.array([assignment.get(v, layout.vertices[v]) for v in on_boundary], dtype=np.float64)
    found = [outline.nearest(wanted) for outline in outlines]
    distance = np.array([d for _, d in found])
    best = distance.argmin(axis=0)
    worst = int(distance.min(axis=0).argmax())
    if distance[best[worst], worst] > SNAP_DISTANCE * boundary.diameter:
        raise off_boundary(on_boundary[worst], wanted[worst], distance[best[worst], worst], boundary.diameter)
    images = np.array([outlines[k].point(found[k][0][i]) for i, k in enumerate(best)])
    return np.column_stack([layout.vertices[on_boundary], images])


def _check_corners(layout: QuadLayout, start: MultiPatch, boundary: Boundary, landmarks: FloatArray) -> None:
    """Raise if the boundary has a corner inside a layout edge, which one smooth side cannot follow."""
    for loop in register(start.boundary().loops, boundary, landmarks).loops:
        corners, _ = loop.target.corners
        joints = np.mod(loop.joints[:-1], loop.target.length)
        gap = abs(corners[:, None] - joints)
        gap = np.minimum(gap, loop.target.length - gap)
        inside = np.flatnonzero(gap.min(axis=1, initial=np.inf) > AT_VERTEX * loop.target.length)
        if len(inside):
            s = corners[inside[0]]
            x, y = loop.target.point(s)
            after = int(np.argmin(np.mod(s - joints, loop.target.length)))
            ends = [loop.source.point(loop.source.joints[(after + k) % len(joints)]) for k in (0, 1)]
            a, b = (int(np.linalg.norm(layout.vertices - end, axis=1).argmin()) for end in ends)
            raise InputError(
                f"the boundary has a corner at ({x:g}, {y:g}) inside the layout edge ({a}, {b}); put a layout vertex "
                "there"
            )
