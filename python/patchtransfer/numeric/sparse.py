"""Sparse matrices by rows: the few operations that continuity rows need.

`scipy.sparse` has them all, but its import takes longer than a transfer of a small model; what works with SciPy anyway
gets a matrix of its own by `Sparse.to_scipy`. Sums are made in SciPy's order, to the same bits.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, overload

import numpy as np

from .._core import sparse_product
from .arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["Sparse", "ranges"]

#: Rows and columns of a part: numbers or truth values of rows, a range of columns.
Part = IntArray | np.ndarray | slice


class Sparse:
    """A sparse matrix by rows, the columns of each sorted; it does not change.

    Parameters
    ----------
    data : (nnz,) array
        Entries, named as in `scipy.sparse.csr_array`.
    indices : (nnz,) int array
        Their columns.
    indptr : (m + 1,) int array
        Where every row begins among them.
    shape : (m, n)

    Examples
    --------
    >>> import numpy as np
    >>> a = Sparse.of_entries([0, 1, 1], [1, 0, 1], [2.0, 3.0, 4.0], (2, 2))
    >>> (a @ np.array([1.0, 10.0])).tolist()
    [20.0, 43.0]
    >>> (a @ a.T).toarray().tolist()
    [[4.0, 8.0], [8.0, 25.0]]
    """

    def __init__(self, data: FloatArray, indices: IntArray, indptr: IntArray, shape: tuple[int, int]) -> None:
        self.data, self.indices, self.indptr, self.shape = data, indices, indptr, shape

    @classmethod
    def of_entries(cls, row: Any, column: Any, value: Any, shape: tuple[int, int]) -> Self:
        """A matrix from entries at any places in any order; those at the same place are added up, in that order."""
        row, column = np.asarray(row, np.int64), np.asarray(column, np.int64)
        key = row * shape[1] + column
        order = np.argsort(key, kind="stable")
        key = key[order]
        first = np.ones(len(key), bool)
        first[1:] = key[1:] != key[:-1]
        data = _sums(np.cumsum(first) - 1, np.asarray(value, np.float64)[order], int(first.sum()))
        kept = order[first]
        indptr = np.searchsorted(row[kept], np.arange(shape[0] + 1))
        return cls(data, column[kept], indptr, shape)

    @classmethod
    def of(cls, matrix: Any) -> Sparse:
        """A matrix of SciPy's as one of these, which are returned as they are."""
        if isinstance(matrix, Sparse):
            return matrix
        entries = matrix.tocoo()
        return cls.of_entries(entries.row, entries.col, entries.data, entries.shape)

    @classmethod
    def diagonal_of(cls, values: FloatArray) -> Self:
        """The square matrix with these values on its diagonal."""
        n = len(values)
        return cls(np.asarray(values, np.float64), np.arange(n), np.arange(n + 1), (n, n))

    def __repr__(self) -> str:
        return f"<Sparse: {self.shape[0]} x {self.shape[1]}, {self.nnz} entries>"

    @property
    def nnz(self) -> int:
        """Number of entries."""
        return len(self.data)

    @cached_property
    def rows(self) -> IntArray:
        """Row of every entry (nnz,)."""
        return np.repeat(np.arange(self.shape[0]), np.diff(self.indptr))

    @cached_property
    def T(self) -> Sparse:
        """The transpose: its rows are the columns."""
        return Sparse.of_entries(self.indices, self.rows, self.data, (self.shape[1], self.shape[0]))

    def diagonal(self) -> FloatArray:
        """Entries (min(m, n),) of the diagonal."""
        on = self.rows == self.indices
        found = np.zeros(min(self.shape))
        found[self.indices[on]] = self.data[on]
        return found

    def toarray(self) -> FloatArray:
        """All of it (m, n)."""
        dense = np.zeros(self.shape)
        dense[self.rows, self.indices] = self.data
        return dense

    def to_scipy(self) -> csr_array:
        """As `scipy.sparse.csr_array`."""
        from scipy.sparse import csr_array

        return csr_array((self.data, self.indices, self.indptr), shape=self.shape)

    def __getitem__(self, part: Part | tuple[Part, slice]) -> Sparse:
        """The rows of the given numbers, in their order, or where true; with a range of columns only those."""
        rows, columns = part if isinstance(part, tuple) else (part, slice(None))
        chosen = np.arange(self.shape[0])[rows]
        counts = np.diff(self.indptr)[chosen]
        entries = ranges(self.indptr[chosen], counts)
        row, column, data = np.repeat(np.arange(len(chosen)), counts), self.indices[entries], self.data[entries]
        begin, end, _ = columns.indices(self.shape[1])
        if end - begin < self.shape[1]:
            inside = (column >= begin) & (column < end)
            row, column, data = row[inside], column[inside] - begin, data[inside]
        indptr = np.searchsorted(row, np.arange(len(chosen) + 1))
        return Sparse(data, column, indptr, (len(chosen), max(end - begin, 0)))

    def without(self, smallest: float) -> Sparse:
        """Without entries below `smallest`, and without zeros."""
        return self._where((np.abs(self.data) >= smallest) & (self.data != 0))

    def scaled(self, columns: FloatArray) -> Sparse:
        """Every column times its number (n,)."""
        return Sparse(self.data * columns[self.indices], self.indices, self.indptr, self.shape).without(0.0)

    def upper(self) -> Sparse:
        """The part on and above the diagonal, without zeros above it."""
        return self._where((self.rows < self.indices) & (self.data != 0) | (self.rows == self.indices))

    def _where(self, keep: np.ndarray) -> Sparse:
        indptr = np.concatenate([[0], np.cumsum(keep)])[self.indptr]
        return Sparse(self.data[keep], self.indices[keep], indptr, self.shape)

    def __add__(self, other: Sparse) -> Sparse:
        if self.shape != other.shape:
            raise ValueError(f"shapes {self.shape} and {other.shape} do not fit")
        return Sparse.of_entries(
            np.concatenate([self.rows, other.rows]),
            np.concatenate([self.indices, other.indices]),
            np.concatenate([self.data, other.data]),
            self.shape,
        )

    @overload
    def __matmul__(self, other: Sparse) -> Sparse: ...

    @overload
    def __matmul__(self, other: FloatArray) -> FloatArray: ...

    def __matmul__(self, other: Sparse | FloatArray) -> Sparse | FloatArray:
        """Product with another one, or with an array (n,) or (n, k)."""
        if self.shape[1] != (other.shape[0] if len(other.shape) else 0):
            raise ValueError(f"shapes {self.shape} and {other.shape} do not fit")
        if isinstance(other, Sparse):
            width = other.shape[1]
            indptr, indices, data = sparse_product(self._lines, other._lines, width)
            return Sparse(data, indices, indptr, (self.shape[0], width))
        if other.ndim == 1:
            return _sums(self.rows, self.data * other[self.indices], self.shape[0])
        return np.stack([self @ column for column in other.T], axis=-1)

    @property
    def _lines(self) -> tuple[IntArray, IntArray, FloatArray]:
        return self.indptr, self.indices, self.data


def _sums(place: IntArray, values: FloatArray, count: int) -> FloatArray:
    """Sums of the values at each of `count` places; NumPy's of none are integers."""
    return np.bincount(place, values, count).astype(np.float64, copy=False)


def ranges(starts: IntArray, lengths: IntArray) -> IntArray:
    """The ranges ``starts[k], ..., starts[k] + lengths[k] - 1`` one after the other."""
    before = np.cumsum(lengths) - lengths
    return np.repeat(starts - before, lengths) + np.arange(int(lengths.sum()))
