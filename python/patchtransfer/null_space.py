"""A sparse basis of the maps that satisfy the continuity rows, by local elimination.

C1 rows are read as substitutions; what other rows say about the points that remain is solved in the small groups
that they tie together (one around every extraordinary vertex, or around several that are close). Rows that couple a
whole interface are first solved for the points that belong to that interface alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array, hstack
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from .continuity import ContinuityRows
from .errors import InputError
from .splines import FloatArray
from .topology import IntArray

__all__ = ["RowSpace", "row_space"]

#: Singular values below this are zero; rows have unit size (the gap is from 0.01 to 1e-15 in nearly all models).
RANK_TOLERANCE = 1e-10
#: An interface's own points are solved for where singular values exceed this.
STRONG = 1e-2
#: Entries below this are rounding.
ROUNDING = 1e-13
#: Substitutions into substitutions at most; a regular vertex takes two.
DEEPEST = 20
#: Rows that boundary values violate by more than this fraction of the model's size contradict them.
CONSISTENT = 1e-9


@dataclass(frozen=True, eq=False)
class RowSpace:
    """All maps with given boundary points that satisfy the rows.

    Attributes
    ----------
    rows : ContinuityRows
        The active ones.
    interior : (n_interior,) int array
        The points that may move.
    basis : (n_interior, m) sparse array
        Columns span the displacements of the interior points that keep the rows.
    particular : (n_interior, n_points) sparse array
        From the boundary points to interior points that satisfy the rows.
    contradictory : tuple of (interface, vertex)
        Rows that the boundary contradicts; they are not active. Vertex -1: a row that belongs to no vertex.
    redundant : int
        Active rows that follow from the others.
    """

    rows: ContinuityRows
    interior: IntArray
    basis: csc_array
    particular: csr_array
    contradictory: tuple[tuple[int, int], ...]
    redundant: int

    @cached_property
    def _normal(self) -> Any:
        return splu(csc_array(self.basis.T @ self.basis))

    def project(self, points: FloatArray) -> FloatArray:
        """The map nearest to `points` (n_points, 2) that satisfies the rows and has the same boundary."""
        moved = np.array(points)
        start = self.particular @ points
        moved[self.interior] = start
        if self.basis.shape[1]:
            away = self.basis.T @ (points[self.interior] - start)
            moved[self.interior] += self.basis @ self._normal.solve(np.ascontiguousarray(away))
        return moved

    def residual(self, points: FloatArray) -> float:
        """Largest residual of an active row, a length."""
        return float(np.hypot(*(self.rows.matrix @ points).T).max(initial=0.0))


def row_space(rows: ContinuityRows, interior: IntArray, points: FloatArray) -> RowSpace:
    """Eliminate the rows for given boundary points.

    Parameters
    ----------
    rows : ContinuityRows
    interior : (n_interior,) int array
        The points that may move, sorted.
    points : (n_points, 2) array
        Boundary points count; where rows contradict them, rows are dropped.

    Returns
    -------
    RowSpace

    Raises
    ------
    InputError
        When C1 rows go round in a circle: some patch has fewer than three control points across an interface.
    """
    free = np.zeros(len(points), bool)
    free[interior] = True
    first = np.unique(rows.slave, return_index=True)[1]
    first = first[rows.slave[first] >= 0]
    together = not len(first)
    if together:
        lift, equations, others = _interfaces_solved(rows, free)
    else:
        lift, equations, others = _substituted(rows, first, free)
    # Unknowns come after the fixed points.
    n = len(points)
    null, particular, dropped, redundant = _solve_groups(
        csr_array(equations[:, n:]), csr_array(equations[:, :n]), points, rows.order[others]
    )
    dropped = others[dropped]
    if together and len(dropped):
        # These are combinations of an interface's rows: it loses them all.
        lost = np.unique(rows.interface[dropped])
        space = row_space(rows.select(np.flatnonzero(~np.isin(rows.interface, lost))), interior, points)
        return replace(space, contradictory=(*space.contradictory, *((int(i), -1) for i in lost)))
    return RowSpace(
        rows=rows.select(np.setdiff1d(np.arange(len(rows)), dropped)),
        interior=interior,
        basis=csc_array(_without_rounding(lift[interior, n:] @ null)),
        particular=_without_rounding(lift[interior, :n] + lift[interior, n:] @ particular),
        contradictory=tuple((int(rows.interface[i]), int(rows.vertex[i])) for i in np.sort(dropped)),
        redundant=redundant,
    )


def _without_rounding(matrix: Any) -> csr_array:
    matrix = csr_array(matrix)
    matrix.data[np.abs(matrix.data) < ROUNDING] = 0.0
    matrix.eliminate_zeros()
    matrix.sort_indices()
    return matrix


def _substituted(rows: ContinuityRows, first: IntArray, free: np.ndarray) -> tuple[csr_array, csr_array, IntArray]:
    """Read the rows `first` as substitutions.

    Returns the map from [fixed points, masters] to all points, the other rows in [fixed points, masters], and their
    indices.
    """
    n = len(free)
    slaves = rows.slave[first]
    is_slave = np.zeros(n, bool)
    is_slave[slaves] = True
    spread = csr_array((np.ones(len(first)), (slaves, np.arange(len(first)))), shape=(n, len(first)))
    once = _without_rounding(spread @ rows.matrix[first] + diags_array(is_slave.astype(float)))
    power = _without_rounding(diags_array((~is_slave).astype(float)))
    total = power
    for _ in range(DEEPEST):
        power = csr_array(once @ power)
        if power.nnz == 0:
            break
        total = csr_array(total + power)
    else:
        raise InputError(
            "C1 rows depend on each other in a circle: a patch has fewer than three control points across an "
            "interface; raise the degree (MultiPatch.elevate) or use continuity c0"
        )
    masters = np.flatnonzero(free & ~is_slave)
    fixed = csr_array(total @ diags_array((~free).astype(float)))
    lift = csr_array(hstack([fixed, total[:, masters]]))
    others = np.setdiff1d(np.arange(len(rows)), first)
    return lift, _without_rounding(rows.matrix[others] @ lift), others


def _interfaces_solved(rows: ContinuityRows, free: np.ndarray) -> tuple[csr_array, csr_array, IntArray]:
    """Solve the rows of every interface for points that no other interface touches.

    Unknowns that remain are the points that interfaces share or that have no rows, and those of an interface's own
    that its rows leave free or determine weakly. Returns as `_substituted`; the equations are combinations of an
    interface's rows, and any of them stands for all.
    """
    n = len(free)
    touched = csr_array((np.ones(rows.matrix.nnz), rows.matrix.indices, rows.matrix.indptr), shape=rows.matrix.shape)
    shape = (int(rows.interface.max(initial=0)) + 1, len(rows))
    incidence = csr_array((np.ones(len(rows)), (rows.interface, np.arange(len(rows)))), shape=shape)
    owned = free & (np.asarray((csr_array(incidence @ touched) > 0).sum(axis=0)).ravel() == 1)
    kept = np.flatnonzero(free & ~owned)
    column = np.arange(n)
    column[kept] = n + np.arange(len(kept))
    width = n + len(kept)
    unowned = np.flatnonzero(~owned)
    lifts: list[tuple[IntArray, IntArray, FloatArray]] = []
    equations: list[tuple[IntArray, IntArray, FloatArray]] = []
    others: list[IntArray] = []
    for index in np.unique(rows.interface):
        r = np.flatnonzero(rows.interface == index)
        block = csr_array(rows.matrix[r])
        used = np.unique(block.indices)
        own, rest = used[owned[used]], used[~owned[used]]
        u, sigma, _ = np.linalg.svd(block[:, own].toarray())
        strong = int((sigma > STRONG).sum())
        inside, outside = u.T @ block[:, own].toarray(), u.T @ block[:, rest].toarray()
        solution, null = _echelon(inside[:strong])
        columns = np.concatenate([column[rest], width + np.arange(null.shape[1])])
        width += null.shape[1]
        # own = -solution outside + null y, with new unknowns y: some of the points themselves.
        lifts.append((own, columns, np.hstack([-solution @ outside[:strong], null])))
        weak = inside[strong:]
        left = np.hstack([outside[strong:] - weak @ solution @ outside[:strong], weak @ null])
        equations.append((np.arange(len(r) - strong), columns, left))
        others.append(r[strong:])
    offsets = np.cumsum([0, *(len(r) for r, _, _ in equations)])
    shifted = [(r + k, c, block) for (r, c, block), k in zip(equations, offsets[:-1], strict=True)]
    identity = csr_array((np.ones(len(unowned)), (unowned, column[unowned])), shape=(n, width))
    lift = csr_array(identity + _assembled(lifts, (n, width)))
    return (
        lift,
        _without_rounding(_assembled(shifted, (int(offsets[-1]), width))),
        np.concatenate([[], *others]).astype(int),
    )


def _assembled(blocks: list[tuple[IntArray, IntArray, FloatArray]], shape: tuple[int, int]) -> csr_array:
    """Sum of dense blocks at the given rows and columns."""
    row = np.concatenate([[], *(np.repeat(r, len(c)) for r, c, _ in blocks)]).astype(int)
    columns = np.concatenate([[], *(np.tile(c, len(r)) for r, c, _ in blocks)]).astype(int)
    return csr_array((np.concatenate([[], *(b.ravel() for _, _, b in blocks)]), (row, columns)), shape=shape)


def _solve_groups(
    matrix: csr_array, fixed: csr_array, points: FloatArray, order: IntArray
) -> tuple[csr_array, csr_array, IntArray, int]:
    """Solve ``matrix`` y = -``fixed`` x for y, group by group, where x are all points and only fixed ones count.

    Returns null vectors of the matrix (columns), the solution's matrix on x, the equations dropped because the fixed
    points contradict them, and how many are redundant.
    """
    tolerance = CONSISTENT * float(np.linalg.norm(np.ptp(points, axis=0)))
    m, n = matrix.shape
    groups = _tied(matrix)
    alone = np.setdiff1d(np.arange(n), np.concatenate([[], *(c for _, c in groups)]).astype(int))
    at_fixed, place, width = np.asarray(fixed @ points), np.empty(n, int), len(alone)
    nulls: list[tuple[IntArray, IntArray, FloatArray]] = []
    solutions: list[tuple[IntArray, IntArray, FloatArray]] = []
    dropped: list[int] = []
    redundant = 0
    for r, c in groups:
        own = matrix[r]
        place[c] = np.arange(len(c))
        dense = np.zeros((len(r), len(c)))
        dense[np.repeat(np.arange(len(r)), np.diff(own.indptr)), place[own.indices]] = own.data
        kept = _consistent(dense, at_fixed[r], tolerance, order[r])
        dropped += r[~kept].tolist()
        u, sigma, vt = np.linalg.svd(dense[kept])
        rank = int((sigma > RANK_TOLERANCE).sum())
        redundant += int(kept.sum()) - rank
        # On orthonormal rows: weak ones would lose their digits.
        solution, null = _echelon(vt[:rank])
        solutions.append((c, r[kept], -solution @ (u[:, :rank].T / sigma[:rank, None])))
        nulls.append((c, width + np.arange(null.shape[1]), null))
        width += null.shape[1]
    identity = csr_array((np.ones(len(alone)), (alone, np.arange(len(alone)))), shape=(n, width))
    null_vectors = csr_array(identity + _assembled(nulls, (n, width)))
    return null_vectors, csr_array(_assembled(solutions, (n, m)) @ fixed), np.array(dropped, int), redundant


def _echelon(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve ``matrix`` y = b of full row rank for as many entries of y as it has rows, the best pivots.

    Returns the solution's matrix on b, where the other entries are 0, and null vectors: sparser than orthonormal
    ones, because the other entries are their coordinates.
    """
    k, n = matrix.shape
    # Gauss-Jordan with complete pivoting: LAPACK's pivoted QR costs more in threads than these small matrices do.
    work, pivots = np.hstack([matrix, np.eye(k)]), np.full(k, -1)
    for _ in range(k):
        size = np.abs(work[:, :n])
        size[pivots >= 0] = 0.0
        row, column = divmod(int(size.argmax()), n)
        pivots[row] = column
        work[row] /= work[row, column]
        factor = work[:, column].copy()
        factor[row] = 0.0
        work -= factor[:, None] * work[row]
    others = np.setdiff1d(np.arange(n), pivots)
    solution, null = np.zeros((n, k)), np.zeros((n, n - k))
    solution[pivots] = work[:, n:]
    null[pivots] = -work[:, others]
    null[others, np.arange(n - k)] = 1.0
    return solution, null


def _tied(matrix: csr_array) -> list[tuple[IntArray, IntArray]]:
    """Rows and columns that belong together; rows without entries form a group of their own."""
    m, n = matrix.shape
    entries = matrix.tocoo()
    graph = csr_array((np.ones(entries.nnz), (entries.row, m + entries.col)), shape=(m + n, m + n))
    label = connected_components(graph, directed=False)[1]
    label[:m][np.diff(matrix.indptr) == 0] = -1
    by_row, by_column = np.argsort(label[:m], kind="stable"), np.argsort(label[m:], kind="stable")
    sorted_rows, sorted_columns = label[:m][by_row], label[m:][by_column]
    return [
        (
            by_row[slice(*np.searchsorted(sorted_rows, [g, g + 1]))],
            by_column[slice(*np.searchsorted(sorted_columns, [g, g + 1]))],
        )
        for g in np.unique(sorted_rows)
    ]


def _consistent(dense: FloatArray, fixed: FloatArray, tolerance: float, order: IntArray) -> np.ndarray:
    """Which rows `dense` y = -`fixed` to keep so that they can hold together; the first in `order` stay."""

    def violation(chosen: np.ndarray) -> float:
        y = np.linalg.lstsq(dense[chosen], -fixed[chosen], rcond=RANK_TOLERANCE)[0]
        return float(np.abs(dense[chosen] @ y + fixed[chosen]).max(initial=0.0))

    kept = np.ones(len(dense), bool)
    if not fixed.any() or violation(kept) <= tolerance:
        return kept
    kept[:] = False
    for i in np.argsort(order, kind="stable"):
        kept[i] = True
        kept[i] = violation(kept) <= tolerance
    return kept
