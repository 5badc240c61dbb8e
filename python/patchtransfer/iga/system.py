"""Linear systems: assembly of symmetric forms, elimination of known values, factorization."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock

import numpy as np
from scipy.sparse import coo_array, csc_array

from .._core import Galerkin, SparseCholesky
from ..errors import InputError
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.definite import upper_triangle
from ..numeric.dense import product
from .nodes import PatchNodes, ScalarFunction, SideNodes, sampled
from .space import SplineSpace

__all__ = ["Assembler", "DefiniteSystem", "boundary_fit", "symmetric"]


class Assembler:
    """Symmetric forms on a spline space at fixed nodes; the pattern is found once.

    Parameters
    ----------
    space : SplineSpace
    nodes : list of PatchNodes

    Attributes
    ----------
    indptr, indices : int arrays
        Pattern of the upper triangle in compressed columns.
    """

    def __init__(self, space: SplineSpace, nodes: list[PatchNodes]) -> None:
        self.space, self.nodes = space, nodes
        self._core = Galerkin(
            [
                (u.knots, v.knots, u.degree, v.degree, *n.t, np.ascontiguousarray(numbers))
                for (u, v), n, numbers in zip(space.bases, nodes, space.points, strict=True)
            ],
            space.size,
        )
        self.indptr, self.indices = self._core.pattern()

    def values(self, kinds: Sequence[tuple[int, int]], coefficients: Sequence[FloatArray]) -> FloatArray:
        """Values of the upper triangle of ∫ Σ_kl C_kl (D_k φ)(D_l ψ).

        Parameters
        ----------
        kinds : sequence of (int, int)
            Orders of D_k in u and v, each 0 to 2.
        coefficients : sequence of (pairs, m_u, m_v) arrays
            One a patch: C_00, C_01, ..., C_11, ... at the nodes, weights and |det J| included.
        """
        return self._core.assemble(list(kinds), [np.ascontiguousarray(c) for c in coefficients])

    def matrix(self, values: FloatArray) -> csc_array:
        """The whole symmetric matrix, both triangles."""
        n = self.space.size
        return symmetric(csc_array((values, self.indices, self.indptr), shape=(n, n)))


def symmetric(upper: csc_array) -> csc_array:
    """A symmetric matrix from its upper triangle."""
    full = upper + upper.T
    full.setdiag(upper.diagonal())
    return csc_array(full)


class DefiniteSystem:
    """Symmetric positive definite matrices of one pattern, some of whose unknowns are known.

    The factorization of the free unknowns is analysed once. Solving is safe from several threads, one at a time.

    Parameters
    ----------
    indptr, indices : int arrays
        Pattern of the upper triangle in compressed columns, rows sorted.
    free : int array, optional
        Sorted unknowns to solve for; default all.
    """

    def __init__(self, indptr: IntArray, indices: IntArray, free: IntArray | None = None) -> None:
        n = len(indptr) - 1
        self.size, self.indptr, self.indices = n, indptr, indices
        self.free = np.arange(n) if free is None else free
        number = np.full(n, -1)
        number[self.free] = np.arange(len(self.free))
        columns = np.repeat(np.arange(n), np.diff(indptr))
        inside = (number[indices] >= 0) & (number[columns] >= 0)
        self._entries = np.flatnonzero(inside)
        counts = np.bincount(number[columns[inside]], minlength=len(self.free))
        offsets = np.concatenate([[0], np.cumsum(counts)])
        self._factor = SparseCholesky(offsets, np.ascontiguousarray(number[indices[inside]]))
        self._lock = Lock()

    def solve(self, values: FloatArray, load: FloatArray, known: FloatArray) -> tuple[FloatArray, float]:
        """Solve for the free unknowns.

        Parameters
        ----------
        values : array
            Upper triangle in the order of the pattern.
        load : (n,) array
        known : (n,) array
            Values of the unknowns that are not free, zero elsewhere.

        Returns
        -------
        x : (n,) array
        residual : float
            Largest residual of a free row, relative to the largest sum of a row's absolute terms.
        """
        upper = csc_array((values, self.indices, self.indptr), shape=(self.size, self.size))
        diagonal = upper.diagonal()

        def product(x: FloatArray) -> FloatArray:
            return np.asarray(upper @ x + upper.T @ x - diagonal * x)

        x = known.copy()
        rhs = (load - product(known) if known.any() else load)[self.free]
        with self._lock:
            try:
                self._factor.factorize(values[self._entries])
            except RuntimeError as error:
                raise InputError(f"the system cannot be solved: {error} (is the geometry nearly singular?)") from None
            x[self.free] = self._factor.solve(rhs)
        gap = float(np.abs((product(x) - load)[self.free]).max(initial=0.0))
        # Relative to the sums of the rows' absolute terms, which rounding is relative to.
        size, absolute = np.abs(x), abs(upper)
        scale = float((absolute @ size + absolute.T @ size)[self.free].max(initial=0.0))
        return x, gap / scale if scale > 0 else 0.0


def boundary_fit(space: SplineSpace, sides: list[SideNodes], data: Sequence[ScalarFunction]) -> FloatArray:
    """Coefficients whose trace is the best approximation in L² of a function a side on these sides, zero elsewhere.

    One system for all sides: at the joints of a loop the sides share a coefficient.
    """
    if not sides:
        return np.zeros(space.size)
    known = np.unique(np.concatenate([np.empty(0, int), *(s.side.of(space.points[s.patch]).ravel() for s in sides)]))
    number = np.full(space.size, -1)
    number[known] = np.arange(len(known))
    rows, columns, entries, load = [], [], [], np.zeros(len(known))
    for s, g in zip(sides, data, strict=True):
        basis = s.nodes.field[s.side.axis][0]
        along = number[s.side.of(space.points[s.patch])]
        mass = product(basis.T, s.ds[:, None] * basis)
        i, j = np.meshgrid(along, along, indexing="ij")
        rows.append(i.ravel())
        columns.append(j.ravel())
        entries.append(mass.ravel())
        values = sampled(g, s.x, "Dirichlet data", s.name)
        np.add.at(load, along, product(basis.T, s.ds * values))
    shape = (len(load), len(load))
    all_of = (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns)))
    upper = upper_triangle(csc_array(coo_array(all_of, shape=shape)))
    x, _ = DefiniteSystem(upper.indptr.astype(np.int64), upper.indices.astype(np.int64)).solve(
        upper.data, load, np.zeros(len(load))
    )
    out = np.zeros(space.size)
    out[known] = x
    return out
