"""Pieces to quads: n quads round the middle of a piece with n corners, but quads stay whole where that conforms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...numeric.arrays import FloatArray, IntArray
from .coarse_polygon import CoarsePolygon
from .convex_pieces import Pieces

__all__ = ["PlacedQuads", "quads_of_pieces"]


@dataclass(frozen=True, eq=False)
class PlacedQuads:
    """Quads with places of all vertices.

    Attributes
    ----------
    quads : (m, 4) array of int
        Counter-clockwise.
    loop : (n,) array of int
        Loop of vertices on the outline, -1 inside.
    t : (n,) array
        Arc length on the directed loop, 0 inside.
    corner : (n,) array of bool
    points : (n, 2) array
    """

    quads: IntArray
    loop: IntArray
    t: FloatArray
    corner: NDArray[np.bool_]
    points: FloatArray


def quads_of_pieces(polygon: CoarsePolygon, pieces: Pieces) -> PlacedQuads:
    """Subdivide every piece that is no quad, and the edges that this makes split."""
    edges = sorted({(min(a, b), max(a, b)) for cycle in pieces.cycles for a, b in _edges(cycle)})
    split = _split_edges(edges, pieces.cycles)
    n = len(pieces.points)
    middle = {edge: n + k for k, edge in enumerate(sorted(split))}
    quads: list[list[int]] = []
    centres: list[FloatArray] = []
    for cycle in pieces.cycles:
        middles = [middle.get((min(a, b), max(a, b)), -1) for a, b in _edges(cycle)]
        if min(middles) >= 0:
            # Edge i runs from corner i - 1 to corner i.
            centre = n + len(middle) + len(centres)
            centres.append(pieces.points[cycle].mean(axis=0))
            quads += [[v, middles[(i + 1) % len(cycle)], centre, middles[i]] for i, v in enumerate(cycle)]
        elif max(middles) < 0:
            quads.append(cycle)
        else:
            a, b, c, d = cycle if middles[1] >= 0 else cycle[1:] + cycle[:1]
            m, o = (middle[min(p, q), max(p, q)] for p, q in ((a, b), (c, d)))
            quads += [[a, m, o, d], [m, b, c, o]]
    return _placed(polygon, pieces, np.array(quads, np.int64), list(middle), np.array(centres).reshape(-1, 2))


def _edges(cycle: list[int]) -> list[tuple[int, int]]:
    return [(cycle[i - 1], cycle[i]) for i in range(len(cycle))]


def _split_edges(edges: list[tuple[int, int]], cycles: list[list[int]]) -> set[tuple[int, int]]:
    """Edges of pieces that are no quads, and those across quads from split ones."""
    across: dict[tuple[int, int], list[tuple[int, int]]] = {edge: [] for edge in edges}
    split = set()
    for cycle in cycles:
        around = [(min(a, b), max(a, b)) for a, b in _edges(cycle)]
        if len(cycle) == 4:
            for i, edge in enumerate(around):
                across[edge].append(around[(i + 2) % 4])
        else:
            split.update(around)
    stack = sorted(split)
    while stack:
        for edge in across[stack.pop()]:
            if edge not in split:
                split.add(edge)
                stack.append(edge)
    return split


def _placed(
    polygon: CoarsePolygon,
    pieces: Pieces,
    quads: IntArray,
    middles: list[tuple[int, int]],
    centres: FloatArray,
) -> PlacedQuads:
    nodes, inside = len(polygon.points), len(pieces.points) - len(polygon.points)
    ends = np.array(middles, np.int64).reshape(-1, 2)
    points = pieces.points[ends].mean(axis=1)
    loop, t = np.full(len(ends), -1), np.zeros(len(ends))
    for start, end in (ends.T, ends.T[::-1]):
        on = np.flatnonzero((start < nodes) & (end < nodes))
        on = on[polygon.next[start[on]] == end[on]]
        loop[on] = polygon.loop[start[on]]
        t[on], points[on] = polygon.on_arc(start[on], 0.5)
    none = np.full(inside, -1), np.zeros(inside)
    last = np.full(len(centres), -1), np.zeros(len(centres))
    corner = np.zeros(len(pieces.points) + len(ends) + len(centres), bool)
    corner[:nodes] = polygon.corner
    return PlacedQuads(
        quads,
        np.concatenate([polygon.loop, none[0], loop, last[0]]),
        np.concatenate([polygon.t, none[1], t, last[1]]),
        corner,
        np.concatenate([pieces.points, points, centres]),
    )
