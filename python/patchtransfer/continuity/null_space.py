"""A sparse basis of the maps that satisfy the continuity rows, by local elimination in the core.

C1 rows are read as substitutions; what other rows say about the points that remain is solved in the small groups
that they tie together (one around every extraordinary vertex, or around several that are close). Rows that couple a
whole interface are first solved for the points that belong to that interface alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .._core import CircularRowsError, nearest_on_rows
from .._core import RowSpace as CoreRowSpace
from ..errors import InputError
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.compressed import Compressed
from .rows import ContinuityRows

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array

__all__ = ["RowSpace", "nearest", "row_space"]


@dataclass(frozen=True, eq=False)
class RowSpace:
    """All maps with given boundary points that satisfy the rows.

    Attributes
    ----------
    rows : ContinuityRows
        The active ones.
    interior : (n_interior,) int array
        The points that may move.
    columns : Compressed
        `basis` as arrays, for the optimiser.
    contradictory : tuple of (interface, vertex)
        Rows that the boundary contradicts; they are not active. Vertex -1: a row that belongs to no vertex.
    redundant : int
        Active rows that follow from the others.
    """

    rows: ContinuityRows
    interior: IntArray
    columns: Compressed
    contradictory: tuple[tuple[int, int], ...]
    redundant: int
    _core: CoreRowSpace = field(repr=False)

    @cached_property
    def basis(self) -> csc_array:
        """(n_interior, m) sparse array: columns span the displacements of the interior points that keep the rows."""
        from scipy.sparse import csc_array

        z = self.columns
        return csc_array((z.data, z.indices, z.indptr), shape=z.shape)

    @cached_property
    def particular(self) -> csr_array:
        """(n_interior, n_points) sparse array: from the boundary points to interior points that satisfy the rows."""
        from scipy.sparse import csr_array

        indptr, indices, data, shape = self._core.particular()
        return csr_array((data, indices, indptr), shape=shape)

    def of_fixed(self, columns: IntArray) -> FloatArray:
        """How interior points (n_interior, k) move with fixed points, the columns (k,) of `particular`."""
        indptr, indices, data, (n, width) = self._core.particular()
        number = np.full(width, -1)
        number[columns] = np.arange(len(columns))
        place, row = number[indices], np.repeat(np.arange(n), np.diff(indptr))
        found = np.zeros((n, len(columns)))
        found[row[place >= 0], place[place >= 0]] = data[place >= 0]
        return found

    def project(self, points: FloatArray) -> FloatArray:
        """The map nearest to `points` (n_points, 2) that satisfies the rows and has the same boundary."""
        return self._core.project(points)

    def residual(self, points: FloatArray) -> float:
        """Largest residual of an active row, a length."""
        return self._core.residual(points)


def row_space(rows: ContinuityRows, interior: IntArray, points: FloatArray) -> RowSpace:
    """Eliminate the rows for given boundary points.

    Parameters
    ----------
    rows : ContinuityRows
    interior : (n_interior,) int array
        The points that may move, sorted.
    points : (n_points, 2) array
        Boundary points count; where rows contradict them, rows are dropped. Rows none of which is a C1 row are
        solved together: if one is contradicted, its interface loses them all.

    Returns
    -------
    RowSpace

    Raises
    ------
    InputError
        When C1 rows go round in a circle: some patch has fewer than three control points across an interface.
    """
    try:
        core = CoreRowSpace(_arrays(rows), rows.slave, rows.interface, rows.order, interior, points)
    except CircularRowsError as error:
        raise InputError(
            f"{error}: a patch has fewer than three control points across an interface; raise the degree "
            "(MultiPatch.elevate) or use continuity c0"
        ) from None
    dropped = core.dropped
    # Without slaves the rows of an interface go together, and belong to no vertex.
    vertex = rows.vertex[dropped] if (rows.slave >= 0).any() else np.full(len(dropped), -1)
    named = zip(rows.interface[dropped].tolist(), vertex.tolist(), strict=True)
    return RowSpace(
        rows=rows.select(np.setdiff1d(np.arange(len(rows)), dropped)) if len(dropped) else rows,
        interior=interior,
        columns=Compressed(*core.basis()),
        contradictory=tuple(named) if (rows.slave >= 0).any() else tuple(dict.fromkeys(named)),
        redundant=core.redundant,
        _core=core,
    )


def nearest(rows: ContinuityRows, chosen: IntArray, interior: IntArray, points: FloatArray) -> FloatArray:
    """The points (n_points, 2) nearest to `points` that satisfy the rows `chosen` (k,); only `interior` ones move."""
    return nearest_on_rows(_arrays(rows), chosen, interior, points)


def _arrays(rows: ContinuityRows) -> Compressed:
    """Index types as the core takes them: SciPy's may be narrower."""
    indptr, indices = (np.asarray(x, np.int64) for x in (rows.entries.indptr, rows.entries.indices))
    return Compressed(indptr, indices, rows.entries.data, rows.entries.shape)
