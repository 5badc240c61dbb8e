"""The motorcycle graph of a seamless map: rectangles that meet in T-junctions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..._core import LayoutError, layout_t_mesh
from ...numeric.arrays import FloatArray, IntArray
from .reasons import NoLayoutError

__all__ = ["TMesh", "build_t_mesh"]


@dataclass(frozen=True, eq=False)
class TMesh:
    """Faces that are rectangles in the map, with T-junctions.

    Half-arc ``2 * arc`` runs from the first to the second node of an arc, ``2 * arc + 1`` back. Arcs may have no
    length: two traces that come along one line from both sides of a third one end there in two nodes at one place.

    Attributes
    ----------
    node_kind : (n,) array of int
        0 mesh vertex, 1 junction, 2 boundary hit, 3 head-on join of two traces.
    node_vertex : (n,) array of int
        Vertex of the mesh, or -1.
    node_critical : (n,) array of bool
        Singularity, corner, or vertex of the outline with a number of quads other than two.
    node_index : (n,) array of int
        At mesh vertices 4 - valence inside, the number of quads on the outline; 0 at other nodes.
    node_loop : (n,) array of int
        Loop of the outline, or -1 inside.
    node_position : (n,) array
        Place along the loop: rank in its polygon, from the vertex of the smallest number, plus a fraction of the
        edge; -1 inside.
    node_point : (n, 2) array
    arc_nodes : (a, 2) array of int
    arc_length : (a,) array
        Length in the map.
    arc_size : (a,) array
        Length in the plane.
    arc_loop : (a,) array of int
        Loop of an arc of the outline, or -1.
    arc_interval : (a, 2) array
        Positions of an outline's arc; the second may exceed the loop's number of nodes. -1 inside.
    arc_points : tuple of (k, 2) arrays
        Polylines.
    arc_places : tuple of (k,) arrays
        Length in the map from the arc's start to each point of its polyline.
    faces : tuple of tuples of 4 int arrays
        Half-arcs of the four sides of every face, counter-clockwise.
    sector_next : (2 a,) array of int
        The next outgoing half-arc counter-clockwise around the origin of each half-arc.
    sector_quarters : (2 a,) array of int
        Quarter turns of the sector between them: 0 outside the domain, 2 on the flat side of a junction and on both
        sides of a join.
    """

    node_kind: IntArray
    node_vertex: IntArray
    node_critical: NDArray[np.bool_]
    node_index: IntArray
    node_loop: IntArray
    node_position: FloatArray
    node_point: FloatArray
    arc_nodes: IntArray
    arc_length: FloatArray
    arc_size: FloatArray
    arc_loop: IntArray
    arc_interval: FloatArray
    arc_points: tuple[FloatArray, ...]
    arc_places: tuple[FloatArray, ...]
    faces: tuple[tuple[IntArray, IntArray, IntArray, IntArray], ...]
    sector_next: IntArray
    sector_quarters: IntArray


def build_t_mesh(
    points: FloatArray,
    triangles: IntArray,
    uv: FloatArray,
    rotation: IntArray,
    index: IntArray,
    outline_next: IntArray,
    outline_loop: IntArray,
    corner: NDArray[np.bool_],
) -> TMesh:
    """Trace the motorcycle graph of a seamless map and find its faces.

    Parameters
    ----------
    points : (N, 2) array
        Vertices; the first n are those of the outline.
    triangles : (m, 3) array of int
        Counter-clockwise.
    uv : (m, 3, 2) array
        The map at the corners of every triangle, constant in one coordinate along every edge of the outline.
    rotation : (m, 3) array of int
        Quarter turns r across the edge opposite each corner: uv of the neighbour = Rʳ uv + t.
    index : (N,) array of int
        4 - valence inside, the number of quads on the outline.
    outline_next : (n,) array of int
        The next vertex of the outline, the domain on the left.
    outline_loop : (n,) array of int
        Loop of every vertex of the outline, numbered from 0.
    corner : (n,) array of bool
        Vertices of the outline that are nodes whatever their number of quads.

    Returns
    -------
    TMesh

    Raises
    ------
    NoLayoutError
        When the arrays are no map of a domain, when the traces of a vertex are not as many as its index says, when
        one does not end, or when a face is no rectangle: the map folds.

    Examples
    --------
    A square of two triangles, mapped to itself:

    >>> import numpy as np
    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> triangles = np.array([[0, 1, 2], [0, 2, 3]])
    >>> mesh = build_t_mesh(
    ...     square, triangles, square[triangles], np.zeros((2, 3), int), np.ones(4, int),
    ...     np.array([1, 2, 3, 0]), np.zeros(4, int), np.ones(4, bool),
    ... )
    >>> len(mesh.faces), mesh.arc_length.tolist()
    (1, [1.0, 1.0, 1.0, 1.0])
    """
    try:
        nodes, arcs, faces, sectors = layout_t_mesh(
            points, triangles, uv, rotation, index, outline_next, outline_loop, corner
        )
    except LayoutError as error:
        raise NoLayoutError("T-mesh", str(error)) from error
    kind, vertex, loop, position, point = nodes
    is_vertex = vertex >= 0
    node_index = np.where(is_vertex, index[vertex], 0)
    on_outline = is_vertex & (loop >= 0)
    forced = np.zeros(len(kind), bool)
    forced[on_outline] = corner[vertex[on_outline]]
    polylines = tuple(arc[3] for arc in arcs)
    places = tuple(arc[4] for arc in arcs)
    frozen = TMesh(
        node_kind=kind,
        node_vertex=vertex,
        node_critical=is_vertex & (forced | (node_index != np.where(on_outline, 2, 0))),
        node_index=node_index,
        node_loop=loop,
        node_position=position,
        node_point=point,
        arc_nodes=np.array([arc[0] for arc in arcs], np.int64).reshape(-1, 2),
        arc_length=np.array([place[-1] for place in places]),
        arc_size=np.array([np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in polylines]),
        arc_loop=np.array([arc[1] for arc in arcs], np.int64),
        arc_interval=np.array([arc[2] for arc in arcs]).reshape(-1, 2),
        arc_points=polylines,
        arc_places=places,
        faces=tuple((a, b, c, d) for a, b, c, d in faces),
        sector_next=sectors[0],
        sector_quarters=sectors[1],
    )
    _make_read_only(frozen)
    return frozen


def _make_read_only(mesh: TMesh) -> None:
    for value in vars(mesh).values():
        for item in value if isinstance(value, tuple) else (value,):
            for array in item if isinstance(item, tuple) else (item,):
                array.flags.writeable = False
