"""Points on arcs of a T-mesh and on the loops of the outline."""

from __future__ import annotations

import numpy as np

from ...numeric.arrays import FloatArray
from .reasons import NoLayoutError
from .sampling import SampledOutline
from .t_mesh import TMesh

__all__ = ["arc_length_at", "inner_points", "inner_positions"]


def inner_points(t_mesh: TMesh, arc: int, edges: int) -> FloatArray:
    """The points (edges - 1, 2) that divide an arc into edges of equal length in the map.

    By length in the map, not in the plane or by samples: its isolines join such points across a face.
    """
    return _divided(t_mesh, arc, edges, t_mesh.arc_points[arc])


def inner_positions(t_mesh: TMesh, arc: int, edges: int) -> list[float]:
    """The same points of an outline's arc as positions along its loop."""
    start, end = t_mesh.arc_interval[arc].tolist()
    # Its polyline: the ends and the polygon's nodes between them.
    ranks = np.concatenate([[start], np.arange(np.floor(start) + 1, np.ceil(end)), [end]])
    if len(ranks) != len(t_mesh.arc_places[arc]):
        raise NoLayoutError(
            "T-mesh",
            f"arc {arc} has {len(t_mesh.arc_places[arc])} points, but {len(ranks)} positions from {start:g} to {end:g}",
        )
    return [float(position) for position in _divided(t_mesh, arc, edges, ranks[:, None])[:, 0]]


def _divided(t_mesh: TMesh, arc: int, edges: int, values: FloatArray) -> FloatArray:
    """Values along an arc's polyline, interpolated at equal parts of its length in the map."""
    places = t_mesh.arc_places[arc]
    wanted = places[-1] * np.arange(1, edges) / max(edges, 1)
    return np.column_stack([np.interp(wanted, places, column) for column in values.T])


def arc_length_at(outline: SampledOutline, loop: int, positions: FloatArray) -> FloatArray:
    """Arc lengths, on the user's outline, of positions along a loop's polygon (any sense, modulo the loop)."""
    s, length = outline.s[outline.loop == loop], outline.outlines[loop].length
    rank = np.floor(positions).astype(np.int64)
    here, there = s[rank % len(s)], s[(rank + 1) % len(s)]
    # Edges are shorter than half a loop: the short way is the edge, whatever the sense and wherever s starts.
    step = (there - here + length / 2) % length - length / 2
    return np.asarray((here + (positions - rank) * step) % length)
