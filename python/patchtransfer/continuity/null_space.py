"""A sparse basis of the maps that satisfy the continuity rows, by local elimination.

C1 rows are read as substitutions; what other rows say about the points that remain is solved in the small groups
that they tie together (one around every extraordinary vertex, or around several that are close). Rows that couple a
whole interface are first solved for the points that belong to that interface alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..numeric.arrays import FloatArray, IntArray, distinct
from ..numeric.components import components
from ..numeric.definite import DefiniteFactor
from ..numeric.dense import least_squares, product, svd
from ..numeric.sparse import Sparse, ranges
from .rows import ContinuityRows

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
    basis : (n_interior, m) Sparse
        Columns span the displacements of the interior points that keep the rows.
    particular : (n_interior, n_points) Sparse
        From the boundary points to interior points that satisfy the rows.
    contradictory : tuple of (interface, vertex)
        Rows that the boundary contradicts; they are not active. Vertex -1: a row that belongs to no vertex.
    redundant : int
        Active rows that follow from the others.
    """

    rows: ContinuityRows
    interior: IntArray
    basis: Sparse
    particular: Sparse
    contradictory: tuple[tuple[int, int], ...]
    redundant: int

    @cached_property
    def _normal(self) -> DefiniteFactor:
        return DefiniteFactor(self.basis.T @ self.basis)

    def project(self, points: FloatArray) -> FloatArray:
        """The map nearest to `points` (n_points, 2) that satisfies the rows and has the same boundary."""
        moved = np.array(points)
        start = self.particular @ points
        moved[self.interior] = start
        if self.basis.shape[1]:
            away = self.basis.T @ (points[self.interior] - start)
            moved[self.interior] += self.basis @ self._normal.solve(away)
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
    null, particular, dropped, redundant = _solve_groups(equations[:, n:], equations[:, :n], points, rows.order[others])
    dropped = others[dropped]
    if together and len(dropped):
        # These are combinations of an interface's rows: it loses them all.
        lost = distinct(rows.interface[dropped])
        space = row_space(rows.select(np.flatnonzero(~np.isin(rows.interface, lost))), interior, points)
        return replace(space, contradictory=(*space.contradictory, *((int(i), -1) for i in lost)))
    return RowSpace(
        rows=rows.select(np.setdiff1d(np.arange(len(rows)), dropped)) if len(dropped) else rows,
        interior=interior,
        basis=(lift[interior, n:] @ null).without(ROUNDING),
        particular=(lift[interior, :n] + lift[interior, n:] @ particular).without(ROUNDING),
        contradictory=tuple((int(rows.interface[i]), int(rows.vertex[i])) for i in np.sort(dropped)),
        redundant=redundant,
    )


def _substituted(rows: ContinuityRows, first: IntArray, free: np.ndarray) -> tuple[Sparse, Sparse, IntArray]:
    """Read the rows `first` as substitutions.

    Returns the map from [fixed points, masters] to all points, the other rows in [fixed points, masters], and their
    indices.
    """
    n, slaves = len(free), rows.slave[first]
    number = np.full(n, -1)
    number[slaves] = np.arange(len(first))
    counts = np.diff(rows.matrix.indptr)[first]
    entries = ranges(rows.matrix.indptr[first], counts)
    point, column, weight = np.repeat(slaves, counts), rows.matrix.indices[entries], rows.matrix.data[entries]
    # Rows are scaled by their factor of the slave, so the others are its substitution.
    others = point != column
    point, column, weight = point[others], column[others], weight[others]
    counts = np.bincount(number[point], minlength=len(first))
    starts, columns, weights = np.cumsum(counts) - counts, column, weight
    _check_depth(number[point], number[column], len(first))
    parts = []
    while len(point):
        again = number[column] >= 0
        parts.append((point[~again], column[~again], weight[~again]))
        point, column, weight = point[again], column[again], weight[again]
        times = counts[number[column]]
        entries = ranges(starts[number[column]], times)
        point, column, weight = np.repeat(point, times), columns[entries], np.repeat(weight, times) * weights[entries]
    place = np.arange(n)
    masters = np.flatnonzero(free & (number < 0))
    place[masters] = n + np.arange(len(masters))
    kept = np.flatnonzero(number < 0)
    point, column, weight = (np.concatenate(x) for x in zip(*parts, (kept, kept, np.ones(len(kept))), strict=True))
    lift = Sparse.of_entries(point, place[column], weight, (n, n + len(masters)))
    used = np.zeros(len(rows), bool)
    used[first] = True
    rest = np.flatnonzero(~used)
    return lift, (rows.matrix[rest] @ lift).without(ROUNDING), rest


def _check_depth(substitution: IntArray, needs: IntArray, n: int) -> None:
    """Raise unless substitutions end: `needs` are those that `substitution` takes points from, -1 for none."""
    inner = needs >= 0
    substitution, needs = substitution[inner], needs[inner]
    depth = np.zeros(n, int)
    for _ in range(DEEPEST):
        deeper = depth.copy()
        np.maximum.at(deeper, substitution, depth[needs] + 1)
        if (deeper == depth).all():
            return
        depth = deeper
    raise InputError(
        "C1 rows depend on each other in a circle: a patch has fewer than three control points across an "
        "interface; raise the degree (MultiPatch.elevate) or use continuity c0"
    )


def _interfaces_solved(rows: ContinuityRows, free: np.ndarray) -> tuple[Sparse, Sparse, IntArray]:
    """Solve the rows of every interface for points that no other interface touches.

    Unknowns that remain are the points that interfaces share or that have no rows, and those of an interface's own
    that its rows leave free or determine weakly. Returns as `_substituted`; the equations are combinations of an
    interface's rows, and any of them stands for all.
    """
    n = len(free)
    touched = distinct(rows.interface[rows.matrix.rows] * n + rows.matrix.indices) % n
    owned = free & (np.bincount(touched, minlength=n) == 1)
    kept = np.flatnonzero(free & ~owned)
    column = np.arange(n)
    column[kept] = n + np.arange(len(kept))
    width = n + len(kept)
    unowned = np.flatnonzero(~owned)
    lifts: list[tuple[IntArray, IntArray, FloatArray]] = []
    equations: list[tuple[IntArray, IntArray, FloatArray]] = []
    others: list[IntArray] = []
    for index in distinct(rows.interface):
        r = np.flatnonzero(rows.interface == index)
        block = rows.matrix[r]
        used, place = np.unique(block.indices, return_inverse=True)
        dense = np.zeros((len(r), len(used)))
        dense[block.rows, place] = block.data
        own, rest = used[owned[used]], used[~owned[used]]
        u, sigma, _ = svd(dense[:, owned[used]], full=True)
        strong = int((sigma > STRONG).sum())
        inside, outside = (product(u.T, dense[:, which]) for which in (owned[used], ~owned[used]))
        solution, null = (x[0] for x in _echelon(inside[None, :strong]))
        columns = np.concatenate([column[rest], width + np.arange(null.shape[1])])
        width += null.shape[1]
        # own = -solution outside + null y, with new unknowns y: some of the points themselves.
        lifts.append((own, columns, np.hstack([product(-solution, outside[:strong]), null])))
        weak = inside[strong:]
        reached = product(weak, product(solution, outside[:strong]))
        left = np.hstack([outside[strong:] - reached, product(weak, null)])
        equations.append((np.arange(len(r) - strong), columns, left))
        others.append(r[strong:])
    offsets = np.cumsum([0, *(len(r) for r, _, _ in equations)])
    shifted = [(r + k, c, block) for (r, c, block), k in zip(equations, offsets[:-1], strict=True)]
    identity = Sparse.of_entries(unowned, column[unowned], np.ones(len(unowned)), (n, width))
    return (
        identity + _assembled(lifts, (n, width)),
        _assembled(shifted, (int(offsets[-1]), width)).without(ROUNDING),
        np.concatenate([[], *others]).astype(int),
    )


def _assembled(blocks: list[tuple[IntArray, IntArray, FloatArray]], shape: tuple[int, int]) -> Sparse:
    """Sum of dense blocks, or of stacks of them, at the given rows and columns."""
    row = np.concatenate([[], *(np.repeat(r, c.shape[-1], axis=-1).ravel() for r, c, _ in blocks)]).astype(int)
    wide = [np.repeat(np.expand_dims(c, -2), r.shape[-1], axis=-2).ravel() for r, c, _ in blocks]
    columns = np.concatenate([[], *wide]).astype(int)
    return Sparse.of_entries(row, columns, np.concatenate([[], *(b.ravel() for _, _, b in blocks)]), shape)


def _solve_groups(
    matrix: Sparse, fixed: Sparse, points: FloatArray, order: IntArray
) -> tuple[Sparse, Sparse, IntArray, int]:
    """Solve ``matrix`` y = -``fixed`` x for y, group by group, where x are all points and only fixed ones count.

    Returns null vectors of the matrix (columns), the solution's matrix on x, the equations dropped because the fixed
    points contradict them, and how many are redundant.
    """
    tolerance = CONSISTENT * float(np.linalg.norm(np.ptp(points, axis=0)))
    m, n = matrix.shape
    at_fixed = fixed @ points
    empty = np.diff(matrix.indptr) == 0
    contradicted = np.abs(at_fixed).max(axis=1, initial=0.0) > tolerance
    dropped, redundant = np.flatnonzero(empty & contradicted).tolist(), int((empty & ~contradicted).sum())
    alone = np.ones(n, bool)
    alone[matrix.indices] = False
    width = int(alone.sum())
    nulls: list[tuple[IntArray, IntArray, FloatArray]] = []
    solutions: list[tuple[IntArray, IntArray, FloatArray]] = []

    def solve(r: IntArray, c: IntArray, u: FloatArray, sigma: FloatArray, vt: FloatArray) -> None:
        nonlocal width, redundant
        redundant += r.size - sigma.size
        # On orthonormal rows: weak ones would lose their digits.
        solution, null = _echelon(vt)
        solutions.append((c, r, product(-solution, np.swapaxes(u, 1, 2) / sigma[:, :, None])))
        nulls.append((c, width + np.arange(null[:, 0].size).reshape(null.shape[0], null.shape[2]), null))
        width += nulls[-1][1].size

    for r, c, dense in _tied(matrix):
        u, sigma, vt = svd(dense)
        large = sigma > RANK_TOLERANCE
        # No y reaches what the fixed points leave outside of the range.
        inside = u * large[:, None, :]
        missed = at_fixed[r] - product(inside, product(np.swapaxes(inside, 1, 2), at_fixed[r]))
        fine = np.abs(missed).max(axis=(1, 2)) <= tolerance
        rank = large.sum(axis=1)
        for value in distinct(rank[fine]):
            k = np.flatnonzero(fine & (rank == value))
            solve(r[k], c[k], u[k, :, :value], sigma[k, :value], vt[k, :value])
        for i in np.flatnonzero(~fine):
            kept = _consistent(dense[i], at_fixed[r[i]], tolerance, order[r[i]])
            dropped += r[i, ~kept].tolist()
            u_i, sigma_i, vt_i = svd(dense[i, kept])
            rest = int((sigma_i > RANK_TOLERANCE).sum())
            solve(r[i, kept][None], c[i][None], u_i[None, :, :rest], sigma_i[None, :rest], vt_i[None, :rest])
    count = int(alone.sum())
    identity = Sparse.of_entries(np.flatnonzero(alone), np.arange(count), np.ones(count), (n, width))
    null_vectors = identity + _assembled(nulls, (n, width))
    return null_vectors, _assembled(solutions, (n, m)) @ fixed, np.array(dropped, int), redundant


def _echelon(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve ``matrix`` y = b of full row rank for as many entries of y as it has rows, the best pivots; stacked.

    Returns the solution's matrix on b, where the other entries are 0, and null vectors: sparser than orthonormal
    ones, because the other entries are their coordinates.
    """
    stack, k, n = matrix.shape
    # Gauss-Jordan with complete pivoting, all matrices of the stack at once.
    work = np.concatenate([matrix, np.broadcast_to(np.eye(k), (stack, k, k))], axis=2)
    pivots, waiting, each = np.full((stack, k), -1), np.ones((stack, k, 1)), np.arange(stack)
    for _ in range(k):
        size = np.abs(work[:, :, :n]) * waiting
        row, column = np.divmod(size.reshape(stack, -1).argmax(axis=1), n)
        pivots[each, row], waiting[each, row] = column, 0.0
        top = work[each, row] / work[each, row, column][:, None]
        work -= work[each, :, column][:, :, None] * top[:, None]
        work[each, row] = top
    each = each[:, None]
    chosen = np.zeros((stack, n), bool)
    chosen[each, pivots] = True
    others = np.argsort(chosen, axis=1, kind="stable")[:, : n - k]
    solution, null = np.zeros((stack, n, k)), np.zeros((stack, n, n - k))
    solution[each, pivots] = work[:, :, n:]
    null[each, pivots] = -np.take_along_axis(work[:, :, :n], others[:, None], axis=2)
    null[each, others, np.arange(n - k)] = 1.0
    return solution, null


def _tied(matrix: Sparse) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Rows, columns and blocks of the entries that belong together, blocks of the same shape stacked."""
    if not matrix.nnz:
        return
    m, row = matrix.shape[0], matrix.rows
    used, column = np.unique(matrix.indices, return_inverse=True)
    size = m + len(used)
    label = components(size, row, m + column)
    by_row, by_column = np.argsort(label[:m], kind="stable"), np.argsort(label[m:], kind="stable")
    heights, widths = (np.bincount(x, minlength=int(label.max()) + 1) for x in (label[:m], label[m:]))
    top, left = np.cumsum(heights) - heights, np.cumsum(widths) - widths
    place = np.empty(size, int)
    place[by_row] = np.arange(m) - top[label[by_row]]
    place[m + by_column] = np.arange(len(used)) - left[label[m + by_column]]
    for height, width in sorted({*zip(heights.tolist(), widths.tolist(), strict=True)}):
        if not width:
            continue
        members = np.flatnonzero((heights == height) & (widths == width))
        number = np.full(len(heights), -1)
        number[members] = np.arange(len(members))
        there = number[label[row]] >= 0
        dense = np.zeros((len(members), height, width))
        dense[number[label[row[there]]], place[row[there]], place[m + column[there]]] = matrix.data[there]
        yield (
            by_row[top[members, None] + np.arange(height)],
            used[by_column[left[members, None] + np.arange(width)]],
            dense,
        )


def _consistent(dense: FloatArray, fixed: FloatArray, tolerance: float, order: IntArray) -> np.ndarray:
    """Which rows `dense` y = -`fixed` to keep so that they can hold together; the first in `order` stay."""

    def violation(chosen: np.ndarray) -> float:
        y = least_squares(dense[chosen], -fixed[chosen], RANK_TOLERANCE)
        return float(np.abs(product(dense[chosen], y) + fixed[chosen]).max(initial=0.0))

    kept = np.ones(len(dense), bool)
    if not fixed.any() or violation(kept) <= tolerance:
        return kept
    kept[:] = False
    for i in np.argsort(order, kind="stable"):
        kept[i] = True
        kept[i] = violation(kept) <= tolerance
    return kept
