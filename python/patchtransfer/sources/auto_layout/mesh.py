"""How many quads meet in every corner, and a triangulation that is fine enough there.

A corner of interior angle α is filled by the number of quads k whose right angles come nearest to it; a
parameterization of k equal parts has the scaled Jacobian sin(α / k) in the corner. Where two numbers are about as
good, at 135°, 225° and 315°, an *offset* prefers the larger or the smaller one.

The triangulation is a constrained Delaunay triangulation with refinement (Ruppert 1995) that keeps the outline's
edges whole, so that its vertices keep their arc lengths. *Spokes* divide every corner into wedges, see
`rust/core/src/layout/mesh.rs`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..._core import LayoutError, TriangulationError, layout_edges, layout_mesh
from ...errors import InputError
from ...geometry.boundary import Boundary
from ...numeric.arrays import FloatArray, IntArray
from .reasons import NoLayoutError
from .sampling import TRIANGLES, SampledOutline, sample_outline

__all__ = ["LayoutMesh", "corner_valences", "generate_mesh", "sample_simply"]

#: Triangles to try where the polygons of `TRIANGLES` cross: edges half as long, and half again.
FINER = (4 * TRIANGLES, 16 * TRIANGLES)
#: An angle this near (in quarter turns) to one where two numbers of quads are equally good gets the larger one, so that
#: rounding decides nothing: the corners of a regular octagon are equal.
TIE = 1e-6
#: Triangles have this part of the area of a square on the step at most.
LARGEST = 0.9


@dataclass(frozen=True, eq=False)
class LayoutMesh:
    """A triangulated domain.

    Attributes
    ----------
    points : (N, 2) array
        The nodes of the outline in their order, then the others.
    triangles : (m, 3) array of int
        Counter-clockwise.
    outline : SampledOutline
        The n nodes of the outline.
    corner_valence : (n,) array of int
        Wanted quads at every corner, 0 at other nodes.
    """

    points: FloatArray
    triangles: IntArray
    outline: SampledOutline
    corner_valence: IntArray

    @cached_property
    def edges(self) -> IntArray:
        """Vertices (e, 2) of all edges, the smaller one first, in lexicographic order."""
        edges = layout_edges(len(self.points), self.triangles)
        edges.flags.writeable = False
        return edges


def corner_valences(
    outline: SampledOutline, offset: float = 0.0, corner_patches: Mapping[tuple[int, int], int] | None = None
) -> IntArray:
    """Quads that shall meet in every corner.

    Parameters
    ----------
    outline : SampledOutline
    offset : float
        Added to the angle in quarter turns before it is rounded: 0.13 takes the larger number from 123° on, -0.2 the
        smaller one up to 153°.
    corner_patches : mapping of (loop, corner) to int, optional
        Numbers for single corners. Corners of a loop are counted from 0 in the order of their arc lengths.

    Returns
    -------
    (n,) array of int
        0 at nodes that are no corners.

    Raises
    ------
    InputError
        When `corner_patches` names a corner that does not exist, or less than one quad.
    """
    corner = ~np.isnan(outline.corner_angle)
    valence = np.zeros(len(corner), np.int64)
    quarters = outline.corner_angle[corner] / (np.pi / 2)
    valence[corner] = np.maximum(1, np.floor(quarters + 0.5 + offset + TIE))
    corners = [nodes[corner[nodes]] for nodes in outline.loop_nodes()]
    corners = [nodes[np.argsort(outline.s[nodes])] for nodes in corners]
    for (loop, rank), quads in (corner_patches or {}).items():
        if not 0 <= loop < len(corners):
            raise InputError(f"corner_patches: there is no loop {loop}, only {len(corners)} of them, counted from 0")
        if not 0 <= rank < len(corners[loop]):
            raise InputError(
                f"corner_patches: loop {loop} has {len(corners[loop])} corners, counted from 0; there is no corner "
                f"{rank}"
            )
        if quads != int(quads) or quads < 1:
            raise InputError(f"corner_patches: corner {rank} of loop {loop} needs at least one patch, got {quads}")
        valence[corners[loop][rank]] = int(quads)
    valence.flags.writeable = False
    return valence


def sample_simply(boundary: Boundary) -> SampledOutline:
    """`sample_outline`, finer where polygons would cross that loops do not: at narrow tips between curved sides.

    Raises
    ------
    NoLayoutError
        When the finest polygons cross as well: the outline does, or nearly.
    """
    for triangles in (TRIANGLES, *FINER):
        outline = sample_outline(boundary, triangles)
        try:
            generate_mesh(outline, corner_valences(outline))
        except NoLayoutError as error:
            failure = error
        else:
            return outline
    raise failure


def generate_mesh(outline: SampledOutline, corner_valence: IntArray) -> LayoutMesh:
    """Triangulate the domain.

    Parameters
    ----------
    outline : SampledOutline
    corner_valence : (n,) array of int
        Quads at every corner, 0 at other nodes, as of `corner_valences`.

    Returns
    -------
    LayoutMesh

    Raises
    ------
    NoLayoutError
        When the outline touches or crosses itself, or its loops are not one outer loop and holes in it.
    """
    corners = np.flatnonzero(corner_valence)
    try:
        points, triangles = layout_mesh(
            outline.points,
            list(outline.loop_nodes()),
            corners,
            corner_valence[corners],
            LARGEST * outline.step**2,
        )
    except TriangulationError as error:
        message, _, nodes = error.args
        raise NoLayoutError("mesh", _with_places(message, nodes, outline)) from error
    except LayoutError as error:
        raise NoLayoutError("mesh", str(error)) from error
    points.flags.writeable = triangles.flags.writeable = False
    return LayoutMesh(points, triangles, outline, corner_valence)


def _with_places(message: str, nodes: list[int], outline: SampledOutline) -> str:
    """Where the nodes are that a message names; ends of spokes are nowhere on the outline."""
    places = [
        f"node {i}: loop {outline.loop[i]}, arc length {outline.s[i]:.6g}" for i in nodes if i < len(outline.points)
    ]
    return f"{message} ({'; '.join(places)})" if places else message
