"""Combinatorics of a quad layout: edges, boundary loops, and whether it is a disk with holes."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..geometry.sides import Interface, Side
from ..numeric.arrays import IntArray

__all__ = ["QuadGraph"]

#: Sides of the patch along the edges of its quad (a, b, c, d): parameters run with the first two, against the others.
SIDES = (Side.SOUTH, Side.EAST, Side.NORTH, Side.WEST)


@dataclass(frozen=True, eq=False)
class QuadGraph:
    """Quads by the numbers of their vertices, counter-clockwise.

    Attributes
    ----------
    quads : (m, 4) int array
    """

    quads: IntArray

    @cached_property
    def edges(self) -> IntArray:
        """Directed edges (4 m, 2), four a quad, counter-clockwise."""
        return np.stack([self.quads, np.roll(self.quads, -1, axis=1)], axis=2).reshape(-1, 2)

    @cached_property
    def half_edges(self) -> dict[tuple[int, int], int]:
        """Row in `edges` of every directed edge; row // 4 is its quad."""
        return {(a, b): row for row, (a, b) in enumerate(self.edges.tolist())}

    @cached_property
    def boundary_edges(self) -> IntArray:
        """Directed edges (n, 2) that belong to one quad, the domain on their left."""
        return np.array([e for e in self.edges.tolist() if (e[1], e[0]) not in self.half_edges], np.int64).reshape(
            -1, 2
        )

    @cached_property
    def boundary_vertices(self) -> list[int]:
        """Vertices on the boundary, sorted."""
        return sorted(set(self.boundary_edges.ravel().tolist()))

    @cached_property
    def loops(self) -> list[list[int]]:
        """Boundary loops, the domain on their left, each from its smallest vertex on, by these vertices.

        Of a graph that passes `check`.
        """
        after = dict(self.boundary_edges.tolist())
        loops = []
        while after:
            loop = [min(after)]
            while (following := after.pop(loop[-1])) != loop[0]:
                loop.append(following)
            loops.append(loop)
        return loops

    @cached_property
    def valence(self) -> IntArray:
        """Number of quads at every vertex."""
        return np.bincount(self.quads.ravel())

    @property
    def interfaces(self) -> list[Interface]:
        """How patches that follow the quads are glued."""
        found = []
        for (a, b), row in self.half_edges.items():
            twin = self.half_edges.get((b, a), -1)
            if row < twin:
                along = (row % 4 < 2) == (twin % 4 < 2)
                found.append(Interface(row // 4, SIDES[row % 4], twin // 4, SIDES[twin % 4], along))
        return found

    def check_edges(self) -> None:
        """Raise `InputError` on an edge that two quads have on the same side of it."""
        if len(self.half_edges) < len(self.edges):
            (a, b), count = Counter(map(tuple, self.edges.tolist())).most_common(1)[0]
            raise InputError(f"layout edge ({a}, {b}) belongs to {count} quads on the same side; quads overlap there")

    def check(self) -> None:
        """Raise `InputError` unless the quads form a disk with holes that injective patches can fill."""
        for q, quad in enumerate(self.quads.tolist()):
            if len(set(quad)) < 4:
                raise InputError(f"layout quad {q} {quad} has a vertex twice; give it four different ones")
        self.check_edges()
        self._check_vertices()
        self._check_shape()

    def _check_vertices(self) -> None:
        on_boundary = set(self.boundary_vertices)
        leaving = Counter(self.boundary_edges[:, 0].tolist())
        for v, count in leaving.items():
            if count > 1:
                raise InputError(
                    f"the layout's boundary touches itself at vertex {v}: {count} boundary edges leave it; split the "
                    "vertex, or add quads between"
                )
        # Across the edge that leaves a vertex to the edge that arrives at it in the same quad, and so on round.
        corner = {(v, q): i for q, quad in enumerate(self.quads.tolist()) for i, v in enumerate(quad)}
        first = dict(reversed(corner))
        for v, start in first.items():
            if v in on_boundary:
                continue
            q, seen = start, 0
            while seen == 0 or q != start:
                before = int(self.quads[q, corner[v, q] - 1])
                q, seen = self.half_edges[v, before] // 4, seen + 1
            if seen < self.valence[v]:
                raise InputError(f"the layout's quads meet at vertex {v} in two separate fans; split the vertex")
            if seen < 3:
                pair = sorted(quad for vertex, quad in corner if vertex == v)
                raise InputError(
                    f"inner layout vertex {v} has only {seen} quads around it ({', '.join(map(str, pair))}), one of "
                    "which would fill 180 degrees or more; merge these quads"
                )

    def _check_shape(self) -> None:
        if not len(self.boundary_edges):
            raise InputError("the layout has no boundary: every edge belongs to two quads")
        reached, stack = {0}, [0]
        while stack:
            q = stack.pop()
            for a, b in self.edges[4 * q : 4 * q + 4].tolist():
                other = self.half_edges.get((b, a), 4 * q) // 4
                if other not in reached:
                    reached.add(other)
                    stack.append(other)
        if len(reached) < len(self.quads):
            apart = min(set(range(len(self.quads))) - reached)
            raise InputError(f"the layout falls apart: quad {apart} is not joined to quad 0 by edges")
        vertices = np.count_nonzero(self.valence)
        undirected = (len(self.edges) + len(self.boundary_edges)) // 2
        euler, loops = vertices - undirected + len(self.quads), len(self.loops)
        if euler != 2 - loops:
            raise InputError(
                f"the layout is no disk with holes: {vertices} vertices - {undirected} edges + {len(self.quads)} quads "
                f"= {euler}, but {loops} boundary loops need {2 - loops}; some quads are glued across a handle"
            )
