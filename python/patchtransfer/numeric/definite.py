"""Sparse symmetric positive definite systems, solved in the core by one thread.

SciPy's direct solver calls BLAS; see `dense` for what that does to the digits.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .._core import SparseCholesky
from .arrays import FloatArray
from .sparse import Sparse

__all__ = ["DefiniteFactor", "upper_triangle"]


class DefiniteFactor:
    """Cholesky factorization of a sparse symmetric positive definite matrix.

    Parameters
    ----------
    matrix : (n, n) Sparse, or a sparse array of SciPy's
        In full; the upper triangle counts.

    Raises
    ------
    RuntimeError
        When it is not positive definite.
    """

    def __init__(self, matrix: Any) -> None:
        upper = upper_triangle(matrix)
        if not (upper.diagonal() > 0).all():
            raise RuntimeError("the matrix is not positive definite: a diagonal entry is not positive")
        self._factor = SparseCholesky(upper.indptr, upper.indices)
        self._factor.factorize(upper.data)

    def solve(self, right: FloatArray) -> FloatArray:
        """Solution of right-hand sides (n,) or (n, k)."""
        if right.ndim == 1:
            return self._factor.solve(np.ascontiguousarray(right))
        return np.column_stack([self.solve(column) for column in right.T])


def upper_triangle(matrix: Any) -> Sparse:
    """Upper triangle of a `Sparse` or of SciPy's, by columns (its transpose by rows), without entries that are zero."""
    return Sparse.of(matrix).upper().T
