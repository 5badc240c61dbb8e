"""Degrees of freedom of a NURBS mesh: how many there are, and which of them are the control points of a patch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import InputError
from ...geometry.basis import reverse_knots
from ...geometry.sides import Side
from ...limits import MAX_CONTROL_POINTS, at_most
from ...numeric.arrays import FloatArray, IntArray
from ...numeric.components import components
from .mesh import CoarseMesh, pair

__all__ = ["KnotVector", "patch_dofs", "patch_knots"]

KnotVector = tuple[FloatArray, int]
"""Knots and degree."""

#: Knots that read the same in both directions up to this part of their range have no direction.
SYMMETRIC = 1e-12
#: Opposite sides, by the axis along them.
ALONG = {0: (Side.SOUTH, Side.NORTH), 1: (Side.WEST, Side.EAST)}


def patch_knots(mesh: CoarseMesh, vectors: Sequence[KnotVector]) -> list[tuple[KnotVector, KnotVector]]:
    """Knot vectors of the patches, in the sense of their parameters."""
    rows = {pair(a, b): (vector, (a, b)) for vector, a, b in mesh.edges}
    strips = None if rows else _strips(mesh)
    result = []
    for k in range(len(mesh.elements)):
        both = []
        for axis in (0, 1):
            found = []
            for side in ALONG[axis]:
                ends = mesh.ends(k, side)
                vector, stated = rows[pair(*ends)] if strips is None else (int(strips[2 * k + axis]), ends)
                if not 0 <= vector < len(vectors):
                    raise InputError(f"patch {k}: there is no knot vector {vector}, they are 0 to {len(vectors) - 1}")
                found.append((vector, stated == ends))
            both.append(_agreed(found, vectors, k, strips is None))
        result.append((both[0], both[1]))
    return result


def _agreed(found: list[tuple[int, bool]], vectors: Sequence[KnotVector], patch: int, listed: bool) -> KnotVector:
    """The knot vector of two opposite sides."""
    (vector, forwards), (other, other_forwards) = found
    if vector != other:
        raise InputError(
            f"edges: opposite edges of patch {patch} have the knot vectors {vector} and {other}; correct them"
        )
    knots, degree = vectors[vector]
    turned = reverse_knots(knots)
    if np.abs(knots - turned).max() <= SYMMETRIC * (knots[-1] - knots[0]):
        return knots, degree
    if forwards != other_forwards or not listed:
        raise InputError(
            f"edges: opposite edges of patch {patch} let knot vector {vector} run in different directions; turn one"
            if listed
            else f"edges: none are listed, so the direction of knot vector {vector} is not known; list them"
        )
    return (knots, degree) if forwards else (turned, degree)


def _strips(mesh: CoarseMesh) -> IntArray:
    """Number of the knot vector of (patch, axis), at 2 * patch + axis: those that share an edge share it."""
    first, second = [], []
    for sides in mesh.sides().values():
        nodes = [2 * k + side.axis for k, side in sides]
        first += nodes[:-1]
        second += nodes[1:]
    return components(2 * len(mesh.elements), np.array(first, dtype=np.int64), np.array(second, dtype=np.int64))


def patch_dofs(mesh: CoarseMesh, shapes: Sequence[tuple[int, int]]) -> tuple[list[IntArray], int]:
    """Degrees of freedom (n_u, n_v) of each patch, and how many there are in all."""
    sides = mesh.sides()
    order = [pair(a, b) for _, a, b in mesh.edges] or list(sides)
    start: dict[tuple[int, int], int] = {}
    total = mesh.vertices
    for ends in order:
        patch, side = sides[ends][0]
        for k, other in sides[ends]:
            if shapes[k][other.axis] != shapes[patch][side.axis]:
                raise InputError(f"edges: that of vertices {ends[0]} and {ends[1]} has different knots in two patches")
        start[ends] = total
        total += shapes[patch][side.axis] - 2
    result = []
    for k, (n, m) in enumerate(shapes):
        dofs = np.empty((n, m), dtype=np.int64)
        for side in Side:
            a, b = mesh.ends(k, side)
            inside = start[pair(a, b)] + np.arange(shapes[k][side.axis] - 2)
            along = [a, *(inside if a < b else inside[::-1]).tolist(), b]
            side.of(dofs)[:] = along
        dofs[1:-1, 1:-1] = total + np.arange((n - 2) * (m - 2)).reshape(m - 2, n - 2).T
        total += (n - 2) * (m - 2)
        result.append(dofs)
    at_most(total, MAX_CONTROL_POINTS, "control points", "coarsen the model or split it")
    return result, total
