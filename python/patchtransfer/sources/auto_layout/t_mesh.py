"""The motorcycle graph of a seamless map: rectangles that meet in T-junctions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...numeric.arrays import FloatArray, IntArray

__all__ = ["TMesh"]


@dataclass(frozen=True, eq=False)
class TMesh:
    """Rectangular faces with T-junctions.

    Half-arc ``2 * arc`` runs from the first to the second node of an arc, ``2 * arc + 1`` back.

    Attributes
    ----------
    node_kind : (n,) array of int
        0 mesh vertex, 1 junction, 2 boundary hit, 3 head-on join.
    node_vertex : (n,) array of int
        Vertex of the mesh, or -1.
    node_critical : (n,) array of bool
        Singularity, corner, or vertex of the outline with a number of quads other than two.
    node_index : (n,) array of int
        Index of a singularity (4 - valence), number of quads on the outline, 0 elsewhere.
    node_loop : (n,) array of int
        Loop of the outline, or -1 inside.
    node_position : (n,) array
        Place along the loop: rank in its polygon plus a fraction of the edge.
    node_point : (n, 2) array
    arc_nodes : (a, 2) array of int
    arc_length : (a,) array
        Length in the map.
    arc_size : (a,) array
        Length in the plane.
    arc_loop : (a,) array of int
        Loop of an arc of the outline, or -1.
    arc_interval : (a, 2) array
        Positions of an outline's arc; the second may exceed the loop's number of nodes.
    arc_points : tuple of (k, 2) arrays
        Polylines.
    arc_places : tuple of (k,) arrays
        Length in the map from the arc's start to each point of its polyline.
    faces : tuple of tuples of 4 int arrays
        Half-arcs of the four sides of every face, counter-clockwise.
    sector_next : (2 a,) array of int
        The next outgoing half-arc counter-clockwise around the origin of each half-arc.
    sector_quarters : (2 a,) array of int
        Quarter turns of the sector between them: 0 outside the domain, 2 on the flat side of a junction.
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
