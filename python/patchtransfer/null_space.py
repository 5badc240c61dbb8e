"""A sparse basis of the maps that satisfy the continuity rows, by local elimination.

C1 rows are read as substitutions; what other rows say about the points that remain is solved in the small groups
that they tie together (one around every extraordinary vertex, or around several that are close).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, csc_array, csr_array, diags_array
from scipy.sparse.csgraph import connected_components

from .continuity import ContinuityRows
from .errors import InputError
from .splines import FloatArray
from .topology import IntArray

__all__ = ["RowSpace", "row_space"]

#: Singular values below this fraction of the largest are zero (the gap is from 0.05 to 1e-16).
RANK_TOLERANCE = 1e-10
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
    basis : (n_interior, m) sparse array
        Columns span the displacements of the interior points that keep the rows.
    contradictory : tuple of (interface, vertex)
        Rows that the boundary contradicts; they are not active. Vertex -1: a C1 row.
    redundant : int
        Active rows that follow from the others.
    """

    rows: ContinuityRows
    basis: csc_array
    contradictory: tuple[tuple[int, int], ...]
    redundant: int
    interior: IntArray
    substitution: csr_array
    """All points from the masters."""
    groups: tuple[_Group, ...]

    def project(self, points: FloatArray) -> FloatArray:
        """The map with the boundary of `points` and near it that satisfies the rows."""
        masters = np.array(points)
        for group in self.groups:
            masters[group.masters] = group.project(points)
        moved = np.array(points)
        moved[self.interior] = (self.substitution @ masters)[self.interior]
        return moved

    def residual(self, points: FloatArray) -> float:
        """Largest residual of an active row, a length."""
        return float(np.hypot(*(self.rows.matrix @ points).T).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class _Group:
    """Rows D y = -E x on a few masters y, with x all points (only fixed ones count), solved by SVD."""

    masters: IntArray
    null: FloatArray
    inverse: FloatArray
    fixed: csr_array

    def project(self, points: FloatArray) -> FloatArray:
        particular = self.inverse @ -(self.fixed @ points)
        return np.asarray(particular + self.null @ (self.null.T @ (points[self.masters] - particular)))


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
    tolerance = CONSISTENT * float(np.linalg.norm(np.ptp(points, axis=0)))
    _, first = np.unique(rows.slave, return_index=True)
    first = first[rows.slave[first] >= 0]
    substitution = _substitution(rows, first)
    is_master = free.copy()
    is_master[rows.slave[first]] = False
    masters = np.flatnonzero(is_master)
    others = np.setdiff1d(np.arange(len(rows)), first)
    reduced = csr_array(rows.matrix[others] @ substitution)
    reduced.data[np.abs(reduced.data) < ROUNDING] = 0.0
    reduced.eliminate_zeros()
    on_masters = csr_array(reduced[:, masters])
    on_fixed = csr_array(reduced @ diags_array((~is_master).astype(float)))
    groups: list[_Group] = []
    dropped: list[int] = []
    redundant = 0
    for r, c in _tied(on_masters):
        dense, fixed = on_masters[r][:, c].toarray(), on_fixed[r]
        kept = _consistent(dense, np.asarray(fixed @ points), tolerance, rows.order[others[r]])
        dropped += others[r[~kept]].tolist()
        u, sigma, vt = np.linalg.svd(dense[kept])
        rank = int((sigma > RANK_TOLERANCE * sigma.max(initial=0.0)).sum())
        redundant += int(kept.sum()) - rank
        inverse = vt[:rank].T @ (u[:, :rank].T / sigma[:rank, None])
        groups.append(_Group(masters[c], vt[rank:].T, inverse, csr_array(fixed[kept])))
    active = rows.select(np.setdiff1d(np.arange(len(rows)), np.array(dropped, int)))
    contradictory = tuple((int(rows.interface[i]), int(rows.vertex[i])) for i in sorted(dropped))
    basis = _basis(substitution, masters, interior, groups)
    return RowSpace(active, basis, contradictory, redundant, interior, substitution, tuple(groups))


def _substitution(rows: ContinuityRows, first: IntArray) -> csr_array:
    """All points from those that are no slaves: the sum of the powers of the substitutions."""
    n = rows.matrix.shape[1]
    slaves = rows.slave[first]
    spread = csr_array((np.ones(len(first)), (slaves, np.arange(len(first)))), shape=(n, len(first)))
    once = csr_array(spread @ rows.matrix[first] + diags_array(np.isin(np.arange(n), slaves).astype(float)))
    once.data[np.abs(once.data) < ROUNDING] = 0.0
    once.eliminate_zeros()
    power = csr_array(diags_array((~np.isin(np.arange(n), slaves)).astype(float)))
    power.eliminate_zeros()
    total = power
    for _ in range(DEEPEST):
        power = csr_array(once @ power)
        if power.nnz == 0:
            return total
        total = csr_array(total + power)
    raise InputError(
        "C1 rows depend on each other in a circle: a patch has fewer than three control points across an interface; "
        "raise the degree (MultiPatch.elevate) or use continuity c0"
    )


def _tied(on_masters: csr_array) -> list[tuple[IntArray, IntArray]]:
    """Rows and masters that belong together; rows without masters form a group of their own."""
    m, n = on_masters.shape
    entries = on_masters.tocoo()
    graph = csr_array((np.ones(entries.nnz), (entries.row, m + entries.col)), shape=(m + n, m + n))
    _, label = connected_components(graph, directed=False)
    label[:m][np.diff(on_masters.indptr) == 0] = -1
    by_row, by_master = np.argsort(label[:m], kind="stable"), np.argsort(label[m:], kind="stable")
    sorted_rows, sorted_masters = label[:m][by_row], label[m:][by_master]
    groups = []
    for g in np.unique(sorted_rows):
        r = by_row[slice(*np.searchsorted(sorted_rows, [g, g + 1]))]
        groups.append((r, by_master[slice(*np.searchsorted(sorted_masters, [g, g + 1]))]))
    return groups


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


def _basis(substitution: csr_array, masters: IntArray, interior: IntArray, groups: list[_Group]) -> csc_array:
    """Null vectors on the masters, carried over to all interior points."""
    n = substitution.shape[0]
    alone = np.setdiff1d(masters, np.concatenate([[], *(g.masters for g in groups)]))
    null = block_diag([diags_array(np.ones(len(alone))), *(g.null for g in groups)], format="csr")
    place = np.concatenate([alone.astype(np.int64), *(g.masters for g in groups)])
    spread = csr_array((np.ones(len(place)), (place, np.arange(len(place)))), shape=(n, len(place)))
    basis = csc_array((substitution @ spread @ null)[interior])
    basis.data[np.abs(basis.data) < ROUNDING] = 0.0
    basis.eliminate_zeros()
    basis.sort_indices()
    return basis
