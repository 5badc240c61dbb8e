"""Dense linear algebra in the core: the same bits for any number of threads, and no threads that wait for each other.

NumPy's own (``@`` of arrays, `numpy.linalg`) calls BLAS, which divides whatever is not tiny among its threads. That
changes the last digits, and takes many times as long where other programs keep the cores busy. Here every matrix is
one thread's work. NumPy keeps products of a handful of numbers.
"""

from __future__ import annotations

import math

import numpy as np

from .._core import eigen as core_eigen
from .._core import product as core_product
from .._core import solve as core_solve
from .._core import solve_definite as core_solve_definite
from .._core import svd as core_svd
from .arrays import FloatArray

__all__ = ["eigen", "least_squares", "product", "solve", "solve_definite", "svd"]


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Matrix product, as ``a @ b``.

    Parameters
    ----------
    a : (..., m, k) array
    b : (..., k, n) or (k,) array
        Leading dimensions are broadcast.

    Returns
    -------
    (..., m, n) or (..., m) array

    Raises
    ------
    ValueError
        When the shapes do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> product(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([1.0, 1.0])).tolist()
    [3.0, 7.0]
    """
    if b.ndim == 1:
        return product(a, b[:, None])[..., 0]
    if a.ndim == b.ndim == 2:
        return np.asarray(core_product(_stack(a), _stack(b))[0])
    lead = a.shape[:-2] or b.shape[:-2]
    if b.ndim > 2 and lead != b.shape[:-2]:
        lead = np.broadcast_shapes(lead, b.shape[:-2])
        a, b = (np.broadcast_to(x, (*lead, *x.shape[-2:])) for x in (a, b))
    return core_product(_stack(a), _stack(b)).reshape(*lead, a.shape[-2], b.shape[-1])


def _stack(a: FloatArray) -> FloatArray:
    """All matrices as one stack (s, m, n)."""
    a = np.ascontiguousarray(a, np.float64)
    return a[None] if a.ndim == 2 else a if a.ndim == 3 else a.reshape(math.prod(a.shape[:-2]), *a.shape[-2:])


def svd(a: FloatArray, *, full: bool = False) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Singular value decomposition ``a = u @ diag(sigma) @ vt``, as `numpy.linalg.svd`.

    Parameters
    ----------
    a : (..., m, n) array
    full : bool, default False
        Whether to return all singular vectors, or the first k = min(m, n) of either side.

    Returns
    -------
    u : (..., m, k) array, or (..., m, m)
    sigma : (..., k) array
        Decreasing.
    vt : (..., k, n) array, or (..., n, n)

    Raises
    ------
    RuntimeError
        When an entry is not finite.
    """
    lead = a.shape[:-2]
    u, sigma, vt = core_svd(_stack(a), full)
    return u.reshape(*lead, *u.shape[1:]), sigma.reshape(*lead, sigma.shape[1]), vt.reshape(*lead, *vt.shape[1:])


def eigen(a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (n,), increasing, and eigenvectors (n, n), as columns, of a symmetric matrix (n, n).

    Raises `RuntimeError` when an entry is not finite.
    """
    return core_eigen(np.ascontiguousarray(a, np.float64))


def solve(a: FloatArray, b: FloatArray) -> FloatArray:
    """Solution of ``a x = b`` with a square matrix (n, n) and `b` (n,) or (n, k); not finite if `a` is singular."""
    columns = np.ascontiguousarray(b, np.float64).reshape(len(b), -1)
    return core_solve(np.ascontiguousarray(a, np.float64), columns).reshape(b.shape)


def solve_definite(a: FloatArray, b: FloatArray) -> FloatArray:
    """Solution (n,) of ``a x = b`` with a symmetric positive definite (n, n) matrix.

    Pivots below 1e-14 of the largest diagonal entry are lifted to that: of a singular matrix it is a solution that has
    no large part in the null space.
    """
    return core_solve_definite(np.ascontiguousarray(a, np.float64), np.ascontiguousarray(b, np.float64))


def least_squares(a: FloatArray, b: FloatArray, rcond: float) -> FloatArray:
    """Shortest x (n,) or (n, k) with the least ``|a x - b|``, for `a` (m, n) and `b` (m,) or (m, k).

    Singular values below `rcond` times the largest are zero.
    """
    u, sigma, vt = svd(a)
    rank = int((sigma > rcond * sigma.max(initial=0.0)).sum())
    part = product(u[:, :rank].T, b)
    return product(vt[:rank].T, (part.T / sigma[:rank]).T)
