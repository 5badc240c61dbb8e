"""Drawings of quad layouts with straight sides: every vertex in the middle of its neighbours (Tutte 1963).

With the outer loop on a circle such a drawing of a 3-connected planar graph has strictly convex faces. A vertex is
added in every hole and joined to its loop: faces that are to be convex are the quads, not the holes, so that a quad may
be the only one at a vertex of a hole.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array

from ..numeric.arrays import FloatArray
from ..numeric.definite import DefiniteFactor
from .quad_graph import QuadGraph

__all__ = ["circle_drawing", "harmonic_drawing"]

#: Shortest edge on the circle beside their mean: quads at very short ones would be slivers.
SHORTEST_ARC = 0.3


def circle_drawing(
    graph: QuadGraph, outer: Sequence[int] | None = None, lengths: ArrayLike | None = None
) -> FloatArray:
    """Places of all vertices with one loop on the unit circle.

    Parameters
    ----------
    graph : QuadGraph
        A disk with holes.
    outer : sequence of int, optional
        The loop, the domain on its left; default one with the most vertices.
    lengths : (n,) array, optional
        Of the edges from each of its vertices to the next, to which arcs are proportional where these do not get very
        short; default equal ones.

    Returns
    -------
    (n, 2) array
        Vertices of no quad are at the origin.
    """
    loop = list(outer or max(graph.loops, key=len))
    arcs = np.ones(len(loop)) if lengths is None else np.asarray(lengths, dtype=np.float64)
    arcs = np.maximum(arcs, SHORTEST_ARC * arcs.mean())
    angles = 2 * np.pi * np.concatenate([[0.0], np.cumsum(arcs)[:-1]]) / arcs.sum()
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    holes = [other for other in graph.loops if set(other) != set(loop)]
    return _averaged(graph, dict(zip(loop, circle, strict=True)), holes)


def harmonic_drawing(graph: QuadGraph, places: Mapping[int, Sequence[float]]) -> FloatArray:
    """Places of all vertices (n, 2) where those of the boundary are given; quads need not be convex."""
    return _averaged(graph, {v: np.asarray(place, dtype=np.float64) for v, place in places.items()}, [])


def _averaged(graph: QuadGraph, fixed: Mapping[int, FloatArray], holes: Sequence[Sequence[int]]) -> FloatArray:
    """Every vertex that is not fixed in the middle of its neighbours."""
    used = len(graph.valence)
    pairs = {(min(a, b), max(a, b)) for a, b in graph.edges.tolist()}
    pairs |= {(v, used + k) for k, hole in enumerate(holes) for v in hole}
    n = used + len(holes)
    i, j = np.array(sorted(pairs), np.int64).T
    places = np.zeros((n, 2))
    places[list(fixed)] = list(fixed.values())
    free = np.setdiff1d(np.unique(np.concatenate([i, j])), list(fixed))
    if len(free):
        neighbours = coo_array((np.ones(len(i)), (i, j)), shape=(n, n)).tocsr()
        neighbours = neighbours + neighbours.T
        degree = coo_array((neighbours.sum(axis=1)[free], (np.arange(len(free)),) * 2), shape=(len(free),) * 2)
        right = neighbours[free] @ places
        places[free] = DefiniteFactor(degree.tocsr() - neighbours[free][:, free]).solve(right)
    return places[:used]
