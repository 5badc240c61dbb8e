"""Sparse symmetric positive definite systems, solved in the core by one thread.

SciPy's direct solver calls BLAS; see `dense` for what that does to the digits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_array, csc_array

from .._core import SparseCholesky
from .arrays import FloatArray

__all__ = ["DefiniteFactor", "upper_triangle"]


class DefiniteFactor:
    """Cholesky factorization of a sparse symmetric positive definite matrix.

    Parameters
    ----------
    matrix : (n, n) sparse array
        In full; the upper triangle counts.

    Raises
    ------
    RuntimeError
        When it is not positive definite.
    """

    def __init__(self, matrix: Any) -> None:
        upper = upper_triangle(csc_array(matrix))
        if not (upper.diagonal() > 0).all():
            raise RuntimeError("the matrix is not positive definite: a diagonal entry is not positive")
        self._factor = SparseCholesky(upper.indptr.astype(np.int64), upper.indices.astype(np.int64))
        self._factor.factorize(upper.data)

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of right-hand sides (n,) or (n, k)."""
        if right.ndim == 1:
            return self._factor.solve(np.ascontiguousarray(right))
        return np.column_stack([self.solve(column) for column in right.T])


def upper_triangle(matrix: csc_array) -> csc_array:
    """Upper triangle with sorted rows and without entries that are zero."""
    c = matrix.tocoo()
    keep = (c.row <= c.col) & ((c.data != 0) | (c.row == c.col))
    out = csc_array(coo_array((c.data[keep], (c.row[keep], c.col[keep])), shape=matrix.shape))
    out.sort_indices()
    return out
