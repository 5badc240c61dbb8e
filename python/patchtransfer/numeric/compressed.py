"""Sparse matrices as three arrays: what the core takes and gives, so that nobody has to wait for SciPy's import."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arrays import FloatArray, IntArray

__all__ = ["Compressed", "selected", "summed"]


class Compressed(NamedTuple):
    """A sparse matrix in compressed rows or in compressed columns.

    The names are those of SciPy's ``csr_array`` and ``csc_array``, either of which can be put in its place.

    Attributes
    ----------
    indptr : (n + 1,) int array
        Where the n rows (or columns) begin among the entries, and where the last one ends.
    indices : (k,) int array
        Column (or row) of every entry, sorted within each row (or column).
    data : (k,) array
        The entries.
    shape : (int, int)
        Rows and columns.
    """

    indptr: IntArray
    indices: IntArray
    data: FloatArray
    shape: tuple[int, int]


def summed(row: IntArray, column: IntArray, value: FloatArray, shape: tuple[int, int]) -> Compressed:
    """Compressed rows from entries (k,) in any order: those at the same place are added up, zeros are left out.

    Examples
    --------
    >>> matrix = summed(np.array([1, 0, 1]), np.array([2, 1, 2]), np.array([3.0, 4.0, 5.0]), (2, 3))
    >>> matrix.indptr.tolist(), matrix.indices.tolist(), matrix.data.tolist()
    ([0, 1, 2], [1, 2], [4.0, 8.0])
    """
    place = row * shape[1] + column
    order = np.argsort(place, kind="stable")
    place, value = place[order], value[order]
    first = np.flatnonzero(np.diff(place, prepend=-1))
    place, value = place[first], np.add.reduceat(value, first) if len(first) else value
    place, value = place[value != 0], value[value != 0]
    row, column = np.divmod(place, max(shape[1], 1))
    counts = np.bincount(row, minlength=shape[0])
    return Compressed(np.concatenate([[0], np.cumsum(counts)]), column, value, shape)


def selected(matrix: Compressed, rows: IntArray) -> Compressed:
    """Only these rows of a matrix in compressed rows."""
    starts, counts = matrix.indptr[rows], np.diff(matrix.indptr)[rows]
    indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    entries = np.repeat(starts - indptr[:-1], counts) + np.arange(indptr[-1])
    return Compressed(indptr, matrix.indices[entries], matrix.data[entries], (len(rows), matrix.shape[1]))
