"""Quadratic problems on a mesh's vertices whose matrices share one pattern: analysed once, factorized in the core.

A barycentric row couples the three corners of a triangle only. So PᵀMP, for any map P onto the mesh, has the pattern of
the mesh's own Laplacian, and so has all that the reversible harmonic map adds up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array, eye_array

from .._core import SparseCholesky, closest_on_mesh
from ..mesh.background_mesh import TriangleMesh
from ..numeric.arrays import FloatArray, IntArray

__all__ = ["Barycentric", "VertexSystem"]

#: The pairs of corners of a triangle, its upper triangle.
FIRST, SECOND = np.triu_indices(3)


@dataclass(frozen=True, eq=False)
class Barycentric:
    """A matrix P (m, n) of barycentric coordinates, three a row.

    Attributes
    ----------
    faces : (m,) ints
        Triangles of the mesh.
    columns : (m, 3) ints
        Their corners.
    weights : (m, 3) array
    """

    faces: IntArray
    columns: IntArray
    weights: FloatArray

    @classmethod
    def closest(cls, queries: FloatArray, vertices: FloatArray, triangles: IntArray) -> Barycentric:
        """P vertices are the mesh's points closest to `queries`, both in stacked coordinates (m, 4) and (n, 4)."""
        faces, weights, _ = closest_on_mesh(queries, vertices, triangles)
        return cls(faces, np.asarray(triangles)[faces], weights)

    def of(self, x: FloatArray) -> FloatArray:
        """P x."""
        return np.asarray(np.einsum("ij,ijc->ic", self.weights, x[self.columns]))

    def transposed(self, y: FloatArray, n: int) -> FloatArray:
        """Pᵀ y, with n rows."""
        at = self.columns.ravel()
        return np.stack([np.bincount(at, (self.weights * c[:, None]).ravel(), n) for c in y.T], axis=1)

    def matrix(self, n: int) -> csr_array:
        """P itself, with n columns."""
        m = len(self.faces)
        return csr_array((self.weights.ravel(), self.columns.ravel(), 3 * np.arange(m + 1)), shape=(m, n))


class VertexSystem:
    """Zᵀ A Z for symmetric matrices A that couple the vertices of common triangles.

    Parameters
    ----------
    mesh : TriangleMesh
        With n vertices.
    fixed : (k,) ints
        Vertices that do not move.
    basis : (n, m) sparse array, optional
        Z, of full column rank, with empty rows for the vertices that do not move; default the unit vectors of all but
        the fixed ones.

    Attributes
    ----------
    laplacian : (n, n) sparse array
    """

    def __init__(self, mesh: TriangleMesh, fixed: IntArray, basis: Any = None) -> None:
        n, self.laplacian = len(mesh.points), csr_array(mesh.laplacian())
        first, second = mesh.triangles[:, FIRST], mesh.triangles[:, SECOND]
        pairs = np.minimum(first, second) * n + np.maximum(first, second)
        diagonal = np.arange(n) * (n + 1)
        entries = np.unique(np.concatenate([pairs.ravel(), diagonal]))
        #: For every triangle its pairs' places among A's entries in the upper triangle.
        self._places = np.searchsorted(entries, pairs)
        self._diagonal = np.searchsorted(entries, diagonal)
        self._rows, self._columns = entries // n, entries % n
        self._stiffness = np.asarray(self.laplacian[self._rows, self._columns]).ravel()
        if basis is None:
            free = np.setdiff1d(np.arange(n), fixed)
            basis = eye_array(n, format="csr")[:, free]
        self._basis = csr_array(basis)
        self._basis.eliminate_zeros()
        self._reduction, offsets, rows = _reduction(self._rows, self._columns, self._basis)
        self._factor = SparseCholesky(offsets, rows) if len(rows) else None

    def factorize(self, stiffness: float, diagonal: FloatArray, p: Barycentric, mass: FloatArray) -> None:
        """Factorize ``Zᵀ (stiffness L + diagonal + Pᵀ mass P) Z``; P maps onto this mesh.

        Raises
        ------
        RuntimeError
            When that is not positive definite.
        """
        weights = mass[:, None] * p.weights[:, FIRST] * p.weights[:, SECOND]
        values = stiffness * self._stiffness
        values += np.bincount(self._places[p.faces].ravel(), weights.ravel(), len(values))
        values[self._diagonal] += diagonal
        if self._factor is not None:
            self._factor.factorize(self._reduction @ values)

    def solve(self, right: FloatArray) -> FloatArray:
        """Z (ZᵀAZ)⁻¹ Zᵀ times the columns of `right`, (n, 2)."""
        if self._factor is None:
            return np.zeros_like(right)
        reduced = self._basis.T @ right
        return np.asarray(self._basis @ np.column_stack([self._factor.solve(column.copy()) for column in reduced.T]))


def _reduction(rows: IntArray, columns: IntArray, basis: csr_array) -> tuple[csr_array, IntArray, IntArray]:
    """Matrix from A's entries in the upper triangle to those of ZᵀAZ, and their pattern in compressed columns."""
    m, starts, counts = basis.shape[1], basis.indptr[:-1].astype(np.int64), np.diff(basis.indptr).astype(np.int64)
    # An entry beside the diagonal stands for its mirror image as well.
    beside = np.flatnonzero(rows != columns)
    entry = np.concatenate([np.arange(len(rows)), beside])
    left, right = np.concatenate([rows, columns[beside]]), np.concatenate([columns, rows[beside]])
    pairs = counts[left] * counts[right]
    of = np.repeat(np.arange(len(entry)), pairs)
    within = np.arange(len(of)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    i = starts[left[of]] + within // counts[right[of]]
    j = starts[right[of]] + within % counts[right[of]]
    row, column = basis.indices[i].astype(np.int64), basis.indices[j].astype(np.int64)
    upper = row <= column
    i, j, of, row, column = (x[upper] for x in (i, j, of, row, column))
    # A column without entries has its place on the diagonal too: that is for the factorization to refuse.
    keys = np.unique(np.concatenate([column * m + row, np.arange(m) * (m + 1)]))
    place = np.searchsorted(keys, column * m + row)
    matrix = csr_array((basis.data[i] * basis.data[j], (place, entry[of])), shape=(len(keys), len(rows)))
    offsets = np.searchsorted(keys, np.arange(m + 1) * m)
    return matrix, offsets.astype(np.int64), (keys % max(m, 1)).astype(np.int64)
