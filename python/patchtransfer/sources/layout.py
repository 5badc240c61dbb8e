"""A source of one's own: a coarse quad layout and boundary curves -> multi-patch parameterization.

The layout's straight-sided quads are a multi-patch already, so they are carried onto the boundary by the package's own
pipeline: the layout's boundary vertices are the landmarks, the fit, the optimiser and the certificate are those of a
transfer. Only the reference differs: distortion is measured against a rectangle for every patch, not against the quad.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.basis import greville, knot_spans
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..geometry.outline import Outline
from ..geometry.patch import Patch
from ..limits import MAX_DEGREE, MAX_LAYOUT_POINTS, MAX_QUADS, at_most
from ..numeric.arrays import FloatArray, IntArray, frozen_array
from ..pipeline.plan import TransferPlan
from ..pipeline.result import TransferResult
from ..registration.landmarks import SNAP_DISTANCE
from ..registration.register import register

__all__ = ["QuadLayout", "from_layout"]


#: A boundary corner this close to a layout vertex (relative to the loop's length) is at the vertex.
AT_VERTEX = 5e-3
#: Largest coordinate: squares do not overflow.
LARGEST = 1e150
#: Edges shorter than this (relative to the largest coordinate) have no direction left.
SHORTEST = 1e-14
#: Rounds of measuring the patches' rectangles anew and optimising against them.
MEASURING_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class QuadLayout:
    """Conforming quads of the plane.

    Parameters
    ----------
    vertices : (n, 2) array
    quads : (m, 4) array of int
        Vertices of every quad, counter-clockwise; the first edge becomes the direction u of its patch.

    Raises
    ------
    InputError
        On quads that are inverted, not convex or share an edge the wrong way, naming them, and on vertices that lie
        inside an edge (the layout does not conform).
    """

    vertices: FloatArray
    quads: IntArray

    def __init__(self, vertices: ArrayLike, quads: ArrayLike) -> None:
        points = frozen_array(vertices, "layout vertices")
        try:
            corners = np.array(quads)
        except ValueError:
            # Rows of different lengths.
            raise InputError("layout quads must be integers of shape (m, 4)") from None
        if points.ndim != 2 or points.shape[1] != 2:
            raise InputError(f"layout vertices must have shape (n, 2), got {points.shape}")
        if (
            corners.ndim != 2
            or corners.shape[1] != 4
            or not np.issubdtype(corners.dtype, np.integer)
            or not len(corners)
        ):
            raise InputError(f"layout quads must be integers of shape (m, 4), got shape {corners.shape}")
        if corners.min() < 0 or corners.max() >= len(points):
            raise InputError(f"layout quads use vertices {corners.min()} to {corners.max()} of {len(points)}")
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "quads", corners.astype(np.int64))
        self._check()

    @property
    def edges(self) -> IntArray:
        """Directed edges (4 m, 2), four a quad, counter-clockwise."""
        return np.stack([self.quads, np.roll(self.quads, -1, axis=1)], axis=2).reshape(-1, 2)

    @property
    def boundary_edges(self) -> IntArray:
        """Directed edges that belong to one quad, the domain on their left."""
        twins = {(int(b), int(a)) for a, b in self.edges}
        return np.array([e for e in self.edges if (int(e[0]), int(e[1])) not in twins])

    @property
    def boundary_vertices(self) -> list[int]:
        """Vertices on the boundary, sorted."""
        return sorted(set(self.boundary_edges.ravel().tolist()))

    def _check(self) -> None:
        size = float(np.abs(self.vertices).max())
        if not size <= LARGEST:
            raise InputError(f"layout vertex {int(np.abs(self.vertices).max(axis=1).argmax())} is beyond {LARGEST:g}")
        # By a power of two: products do not underflow.
        vertices = np.ldexp(self.vertices, -int(np.frexp(size)[1]))
        lengths = np.linalg.norm(np.diff(vertices[self.edges], axis=1)[:, 0], axis=1)
        if lengths.min() <= SHORTEST:
            a, b = self.edges[int(lengths.argmin())]
            raise InputError(
                f"layout edge ({a}, {b}) has no length beside the others; move its vertices or delete its quads"
            )
        corners = vertices[self.quads]
        out, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
        cross = out[..., 0] * back[..., 1] - out[..., 1] * back[..., 0]
        size = np.linalg.norm(out, axis=2) * np.linalg.norm(back, axis=2)
        bad = np.flatnonzero((cross <= 1e-12 * size).any(axis=1))
        if len(bad):
            turned = (cross[bad[0]] < 0).all()
            raise InputError(
                f"layout quad {bad[0]} {self.quads[bad[0]].tolist()} is "
                + ("inverted: list its vertices counter-clockwise" if turned else "not convex: move its vertices")
            )
        for (a, b), count in Counter(map(tuple, self.edges.tolist())).items():
            if count > 1:
                raise InputError(
                    f"layout edge ({a}, {b}) belongs to {count} quads on the same side; quads overlap there"
                )
        ends = vertices[self.boundary_edges]
        along = ends[:, 1] - ends[:, 0]
        for v in self.boundary_vertices:
            offset = vertices[v] - ends[:, 0]
            t = (offset * along).sum(axis=1) / (along**2).sum(axis=1)
            distance = np.linalg.norm(offset - t[:, None] * along, axis=1) / np.linalg.norm(along, axis=1)
            inside = np.flatnonzero((t > 1e-6) & (t < 1 - 1e-6) & (distance < 1e-6))
            if len(inside):
                a, b = self.boundary_edges[inside[0]]
                raise InputError(
                    f"the layout does not conform: vertex {v} lies inside edge ({a}, {b}); split the quad there"
                )

    def multipatch(self, degree: int = 3, spans: int = 2) -> MultiPatch:
        """The quads as bilinear patches, written with uniform knots of the given degree."""
        if degree < 1 or spans < 1:
            raise InputError(f"degree and spans must be at least 1, got {degree} and {spans}")
        at_most(degree, MAX_DEGREE, "as degree", "take a lower one (2 or 3 are usual)")
        at_most(len(self.quads), MAX_QUADS, "quads", "take larger ones and more spans in each")
        count = len(self.quads) * (degree + spans) ** 2
        at_most(count, MAX_LAYOUT_POINTS, "control points", "take fewer spans")
        knots = np.concatenate([np.zeros(degree), np.linspace(0, 1, spans + 1), np.ones(degree)])
        t = greville(knots, degree)
        u, v = t[:, None, None], t[None, :, None]
        patches = []
        for a, b, c, d in self.vertices[self.quads]:
            points = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
            patches.append(Patch((knots, knots), (degree, degree), points))
        return MultiPatch(patches)


def from_layout(
    vertices: ArrayLike,
    quads: ArrayLike,
    boundary: Boundary,
    degree: int = 3,
    spans: int = 2,
    *,
    assignment: Mapping[int, Sequence[float]] | None = None,
    fit_tolerance: float = 1e-3,
    on_failure: str = "raise",
) -> TransferResult:
    """Parameterize a domain from a coarse quad layout and its boundary curves.

    Parameters
    ----------
    vertices : (n, 2) array
        Layout vertices; those on the outline lie within 1 % of the diameter of the boundary curves.
    quads : (m, 4) array of int
        Conforming convex quads, counter-clockwise.
    boundary : Boundary
        Closed loops in any order, sense and segmentation.
    degree : int, default 3
    spans : int, default 2
        Knot spans of every patch and direction; knots are uniform and simple.
    assignment : mapping, optional
        Boundary points (x, y) of boundary vertices that are not to go to the nearest one.
    fit_tolerance, on_failure
        As in `transfer`.

    Returns
    -------
    TransferResult
        ``.multipatch`` has one patch a quad, in their order; certificate, quality and errors as of a transfer.

    Raises
    ------
    InputError
        On layouts that do not conform, inverted quads, boundary vertices off the boundary, and boundary corners inside
        a layout edge.
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
    """
    layout = QuadLayout(vertices, quads)
    start = layout.multipatch(degree, spans)
    landmarks = _landmarks(layout, boundary, assignment or {})
    _check_corners(layout, start, boundary, landmarks)
    result: TransferResult | None = None
    shape = start
    for _ in range(MEASURING_ROUNDS):
        # The sides of the rectangles follow the patches, which follow the rectangles.
        plan = TransferPlan(start, "c0", reference=rectangles(shape))
        result = plan.transfer(boundary, landmarks, fit_tolerance=fit_tolerance, on_failure=on_failure)
        shape = result.multipatch
    assert result is not None
    return result


def rectangles(multipatch: MultiPatch) -> list[Patch]:
    """For every patch a rectangle with its mean side lengths, on its knots and with its orientation."""
    out = []
    for patch, sign in zip(multipatch.patches, multipatch.topology.orientation, strict=True):
        c = patch.control_points
        width, height = (np.linalg.norm(np.diff(c, axis=a), axis=2).sum(axis=a).mean() for a in (0, 1))
        grid = np.meshgrid(*(greville(k, p) for k, p in zip(patch.knots, patch.degrees, strict=True)), indexing="ij")
        lengths = np.array([float(np.ptp(knot_spans(k))) for k in patch.knots])
        out.append(patch.with_control_points(np.stack(grid, axis=2) * ([width, sign * height] / lengths)))
    return out


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
        x, y = wanted[worst]
        raise InputError(
            f"layout vertex {on_boundary[worst]} at ({x:g}, {y:g}) is {distance[best[worst], worst]:.3g} off the "
            f"boundary (allowed: {SNAP_DISTANCE:.0%} of the diameter, {SNAP_DISTANCE * boundary.diameter:.3g}); move "
            "it, or assign it a boundary point"
        )
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
