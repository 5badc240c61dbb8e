"""Quad layouts: straight convex quads of the plane, or connectivity with a place of every boundary vertex."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..geometry.basis import greville
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..limits import LARGEST, MAX_LAYOUT_DEGREE, MAX_LAYOUT_POINTS, MAX_QUADS, at_most
from ..numeric.arrays import FloatArray, IntArray, frozen_array
from .drawing import circle_drawing
from .quad_graph import QuadGraph

__all__ = ["QuadLayout", "bilinear_patches", "convex"]

#: Edges shorter than this (relative to the largest coordinate) have no direction left.
SHORTEST = 1e-14
#: Sine of a quad's angle below which its sign is rounding.
FLAT = 1e-12


@dataclass(frozen=True, eq=False)
class QuadLayout:
    """Conforming quads of the plane.

    ``QuadLayout(vertices, quads)`` has straight convex quads, which are a parameterization themselves.
    `QuadLayout.abstract` takes any conforming quads, whose sides may have to be curved; vertices are guesses then.
    Change a layout by giving changed vertices, quads or assignment to either.

    Parameters
    ----------
    vertices : (n, 2) array
    quads : (m, 4) array of int
        Vertices of every quad, counter-clockwise; the first edge becomes the direction u of its patch.

    Attributes
    ----------
    vertices, quads
        As given, read-only.
    assignment : mapping of int to (x, y)
        Boundary points of boundary vertices, for `from_layout`; may be empty.
    straight : bool
        Whether the straight quads are convex.

    Raises
    ------
    InputError
        On quads that are inverted, not convex or share an edge the wrong way, naming them, and on vertices that lie
        inside an edge (the layout does not conform).

    Examples
    --------
    >>> from patchtransfer import QuadLayout
    >>> layout = QuadLayout([(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)], [(0, 1, 4, 3), (1, 2, 5, 4)])
    >>> len(layout.quads)
    2
    """

    vertices: FloatArray
    quads: IntArray
    assignment: Mapping[int, tuple[float, float]]
    straight: bool

    def __init__(self, vertices: ArrayLike, quads: ArrayLike) -> None:
        points = frozen_array(vertices, "layout vertices")
        corners = _quad_array(quads)
        _check_numbers(points, corners)
        self._set(points, corners, {}, True)
        self._check()

    def __repr__(self) -> str:
        sides = "straight" if self.straight else "sides to be curved"
        return f"<QuadLayout: {len(self.quads)} quads, {len(self.vertices)} vertices, {sides}>"

    @classmethod
    def abstract(
        cls,
        quads: ArrayLike,
        vertices: ArrayLike | None = None,
        assignment: Mapping[int, Sequence[float]] | None = None,
    ) -> QuadLayout:
        """A layout by its connectivity; its patches may need curved sides.

        Parameters
        ----------
        quads : (m, 4) array of int
        vertices : (n, 2) array, optional
            Guesses of where vertices lie; default a drawing on a disk.
        assignment : mapping of int to (x, y), optional
            Boundary points of boundary vertices.

        Returns
        -------
        QuadLayout
            ``straight`` says whether the quads happen to be convex at these vertices.

        Raises
        ------
        InputError
            Unless the quads form a disk with holes: on edges used twice, a boundary that touches itself, separate
            parts, inner vertices of two quads, naming them.

        Examples
        --------
        >>> ring = QuadLayout.abstract([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
        >>> ring.loops
        [[0, 1, 2, 3], [4, 7, 6, 5]]
        """
        corners = _quad_array(quads)
        if corners.min() < 0:
            raise InputError(f"layout quads use vertex {corners.min()}; vertices are numbered from 0")
        at_most(int(corners.max()), 4 * MAX_QUADS, "as vertex number", "number the vertices that quads use from 0 on")
        QuadGraph(corners).check()
        points = circle_drawing(QuadGraph(corners)) if vertices is None else vertices
        points = frozen_array(points, "layout vertices")
        _check_numbers(points, corners)
        try:
            return cls(points, corners)._with(assignment)
        except InputError:
            layout = object.__new__(cls)
            layout._set(points, corners, {}, False)
            return layout._with(assignment)

    def _with(self, assignment: Mapping[int, Sequence[float]] | None) -> QuadLayout:
        """The same with places of boundary vertices."""
        places = {}
        on_boundary = set(self.boundary_vertices)
        for v, place in (assignment or {}).items():
            if v not in on_boundary:
                raise InputError(f"assignment names vertex {v}, which is not a boundary vertex of the layout")
            point = frozen_array(place, f"assignment of layout vertex {v}")
            if point.shape != (2,):
                raise InputError(f"assignment of layout vertex {v} must be a point (x, y), got shape {point.shape}")
            places[int(v)] = (float(point[0]), float(point[1]))
        layout = object.__new__(QuadLayout)
        layout._set(self.vertices, self.quads, places, self.straight)
        return layout

    def _set(
        self, vertices: FloatArray, quads: IntArray, assignment: Mapping[int, tuple[float, float]], straight: bool
    ) -> None:
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "quads", quads)
        object.__setattr__(self, "assignment", MappingProxyType(dict(assignment)))
        object.__setattr__(self, "straight", straight)

    @cached_property
    def graph(self) -> QuadGraph:
        """The connectivity."""
        return QuadGraph(self.quads)

    @property
    def edges(self) -> IntArray:
        """Directed edges (4 m, 2), four a quad, counter-clockwise."""
        return self.graph.edges

    @property
    def boundary_edges(self) -> IntArray:
        """Directed edges that belong to one quad, the domain on their left."""
        return self.graph.boundary_edges

    @property
    def boundary_vertices(self) -> list[int]:
        """Vertices on the boundary, sorted."""
        return self.graph.boundary_vertices

    @property
    def loops(self) -> list[list[int]]:
        """Boundary vertices loop by loop, the domain on the left of each."""
        return self.graph.loops

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
        cross = _corner_products(vertices, self.quads)
        bad = np.flatnonzero((cross <= FLAT).any(axis=1))
        if len(bad):
            turned = (cross[bad[0]] < 0).all()
            raise InputError(
                f"layout quad {bad[0]} {self.quads[bad[0]].tolist()} is "
                + ("inverted: list its vertices counter-clockwise" if turned else "not convex: move its vertices")
                + ", or assign every boundary vertex a boundary point"
            )
        self.graph.check_edges()
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
        """The straight quads as bilinear patches, written with uniform knots of the given degree.

        Raises
        ------
        InputError
            On degrees and spans below 1 or beyond the limits, and on quads that are not convex.
        """
        if not self.straight:
            raise InputError("the layout's straight quads are not all convex; from_layout bends them")
        return MultiPatch(bilinear_patches(self.vertices, self.quads, degree, spans))


def bilinear_patches(vertices: FloatArray, quads: IntArray, degree: int, spans: int) -> list[Patch]:
    """A bilinear patch a quad, with uniform knots of the given degree; `InputError` beyond the limits."""
    if degree < 1 or spans < 1:
        raise InputError(f"degree and spans must be at least 1, got {degree} and {spans}")
    at_most(degree, MAX_LAYOUT_DEGREE, "as degree", "take a lower one (2 or 3 are usual)")
    at_most(len(quads), MAX_QUADS, "quads", "take larger ones and more spans in each")
    count = len(quads) * (degree + spans) ** 2
    at_most(count, MAX_LAYOUT_POINTS, "control points", "take fewer spans")
    knots = np.concatenate([np.zeros(degree), np.linspace(0, 1, spans + 1), np.ones(degree)])
    t = greville(knots, degree)
    u, v = t[:, None, None], t[None, :, None]
    patches = []
    for a, b, c, d in vertices[quads]:
        points = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
        patches.append(Patch((knots, knots), (degree, degree), points))
    return patches


def convex(vertices: FloatArray, quads: IntArray) -> NDArray[np.bool_]:
    """Which of the straight quads are counter-clockwise and strictly convex, (m,)."""
    return np.asarray((_corner_products(vertices, quads) > FLAT).all(axis=1))


def _corner_products(vertices: FloatArray, quads: IntArray) -> FloatArray:
    """Sine of the angle at every corner of every quad, (m, 4); 0 where an edge has no length."""
    corners = vertices[quads]
    out, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cross = out[..., 0] * back[..., 1] - out[..., 1] * back[..., 0]
    size = np.linalg.norm(out, axis=2) * np.linalg.norm(back, axis=2)
    return np.asarray(cross / np.where(size > 0, size, 1.0))


def _quad_array(quads: ArrayLike) -> IntArray:
    try:
        corners = np.array(quads)
    except ValueError:
        # Rows of different lengths.
        raise InputError("layout quads must be integers of shape (m, 4)") from None
    if corners.ndim != 2 or corners.shape[1] != 4 or not np.issubdtype(corners.dtype, np.integer) or not len(corners):
        raise InputError(f"layout quads must be integers of shape (m, 4), got shape {corners.shape}")
    corners = corners.astype(np.int64)
    corners.flags.writeable = False
    return corners


def _check_numbers(points: FloatArray, corners: IntArray) -> None:
    if points.ndim != 2 or points.shape[1] != 2:
        raise InputError(f"layout vertices must have shape (n, 2), got {points.shape}")
    if corners.min() < 0 or corners.max() >= len(points):
        raise InputError(f"layout quads use vertices {corners.min()} to {corners.max()} of {len(points)}")
