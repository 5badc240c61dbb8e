"""The elimination of continuity rows once more, in NumPy and SciPy: what the core's is compared with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from patchtransfer.continuity.rows import ContinuityRows


class Eliminated(NamedTuple):
    """What remains of the rows."""

    #: Dropped because the boundary contradicts them, sorted.
    dropped: np.ndarray
    #: How many of the others follow from each other.
    redundant: int
    #: (n_interior, m), columns span the null space of the others.
    basis: np.ndarray
    #: (n_points, 2), the nearest map to the given one that satisfies the others.
    nearest: np.ndarray


def eliminate(rows: ContinuityRows, interior: np.ndarray, points: np.ndarray) -> Eliminated:
    """All groups of rows that common free points tie together, each by a dense singular value decomposition.

    No substitutions, and no interfaces before others: another order of steps than the core's, on the same numbers. Of
    rows that cannot hold together the first in `order` stay, or an interface loses all where there are no slaves.
    """
    tolerance = 1e-9 * float(np.linalg.norm(np.ptp(points, axis=0)))
    matrix = csr_array(rows.matrix)
    m, free = matrix.shape[0], matrix[:, interior]
    label = connected_components(abs(free) @ abs(free).T, directed=False)[1] if m else np.zeros(0, int)
    at_fixed = matrix @ np.where(np.isin(np.arange(len(points)), interior)[:, None], 0.0, points)
    dropped: list[int] = []
    for group in (np.flatnonzero(label == k) for k in range(label.max(initial=-1) + 1)):
        dense = free[group].toarray()
        if misfit(dense, at_fixed[group]) > tolerance:
            dropped += group[~holding(dense, at_fixed[group], tolerance, sequence(rows, group))].tolist()
    if dropped and (rows.slave < 0).all():
        lost = np.isin(rows.interface, rows.interface[dropped])
        inner = eliminate(rows.select(np.flatnonzero(~lost)), interior, points)
        return inner._replace(dropped=np.union1d(np.flatnonzero(lost), np.flatnonzero(~lost)[inner.dropped]))
    kept = np.setdiff1d(np.arange(m), dropped)
    label, there = label[kept], free[kept].toarray()
    null, start, redundant = np.zeros((len(interior), 0)), np.array(points[interior]), 0
    touched = np.zeros(len(interior), bool)
    for k in np.unique(label):
        group = np.flatnonzero(label == k)
        columns = np.flatnonzero(np.abs(there[group]).max(axis=0) > 0)
        touched[columns] = True
        u, sigma, vt = np.linalg.svd(there[np.ix_(group, columns)])
        rank = int((sigma > 1e-9).sum())
        redundant += len(group) - rank
        wide = np.zeros((len(interior), len(columns) - rank))
        wide[columns] = vt[rank:].T
        null = np.hstack([null, wide])
        residual = matrix[kept[group]] @ points
        start[columns] -= vt[:rank].T @ ((u[:, :rank].T @ residual) / sigma[:rank, None])
    moved = np.array(points)
    moved[interior] = start
    return Eliminated(
        np.array(sorted(dropped), int), redundant, np.hstack([null, np.eye(len(interior))[:, ~touched]]), moved
    )


def sequence(rows: ContinuityRows, group: np.ndarray) -> np.ndarray:
    """Substitutions, one a slave, come first: they are never dropped."""
    slaves = rows.slave[group]
    first = np.zeros(len(group), bool)
    first[np.unique(slaves, return_index=True)[1]] = True
    first &= slaves >= 0
    return np.lexsort([np.arange(len(group)), rows.order[group], ~first])


def misfit(dense: np.ndarray, fixed: np.ndarray) -> float:
    """What the least-squares solution of ``dense y = -fixed`` leaves, at most."""
    y = np.linalg.lstsq(dense, -fixed, rcond=1e-10)[0]
    return float(np.abs(dense @ y + fixed).max(initial=0.0))


def holding(dense: np.ndarray, fixed: np.ndarray, tolerance: float, order: np.ndarray) -> np.ndarray:
    """Which rows to keep so that they can hold together; the first ones stay."""
    kept = np.zeros(len(dense), bool)
    for i in order:
        kept[i] = True
        kept[i] = misfit(dense[kept], fixed[kept]) <= tolerance
    return kept


def same_span(one: np.ndarray, other: np.ndarray) -> float:
    """Sine of the largest angle between the spans of two matrices' columns, which must be as many."""
    assert one.shape == other.shape
    q, p = (np.linalg.qr(x)[0] for x in (one, other))
    return float(np.linalg.norm(q - p @ (p.T @ q), 2)) if q.size else 0.0
