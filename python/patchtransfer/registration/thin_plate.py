"""Bending energy of the smoothest map of the plane that takes matched points to each other.

The thin-plate spline through matched points has second derivatives only where the correspondence needs them: it costs
nothing when the boundaries differ by an affine map, little when by a smooth one, such as a bend that stretches one side
and compresses the other. Points that slide along the target to lower it are the *sliding semilandmarks* of geometric
morphometrics (Bookstein: *Landmark methods for forms without landmarks*, Medical Image Analysis 1(3), 1997; Gunz,
Mitteroecker, Bookstein: *Semilandmarks in three dimensions*, 2005).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._core import bending_matrix as core_bending_matrix
from ..numeric.arrays import FloatArray
from ..numeric.dense import svd
from .sampled_boundary import BoundaryShape

__all__ = ["bending_matrix", "plate"]

#: Mean square distance (relative to the squared size) by which the plate may miss its points, per unit of energy:
#: caps the cost of a sharp crease, as necks of turned limbs have it.
SLACK = 1e-4


def bending_matrix(points: FloatArray, slack: float = SLACK) -> FloatArray:
    """Symmetric matrix B (n, n) with yᵀ B y the bending energy of the thin plate over `points` (n, 2) with heights y.

    Parameters
    ----------
    points : (n, 2) array
        Scaled to a root mean square distance of 1 from their centroid first.
    slack : float
        Weight of the smoothing spline: B is that of min ∫ ‖∇²f‖² + Σ (f(pᵢ) - yᵢ)² / slack.

    Returns
    -------
    (n, n) array
        Positive semidefinite; zero exactly on affine functions of the points.
    """
    return core_bending_matrix(points, slack)


def plate(
    source: BoundaryShape, target: BoundaryShape, partners: Sequence[int], weight: float
) -> tuple[FloatArray, FloatArray, float, float]:
    """What sliding needs of the bending energy of the source's first loops matched to their `partners`.

    Returns
    -------
    matrix : (n, n) array
        See `bending_matrix`.
    affine : (n, 3) array
        Orthonormal basis of the affine functions of the source's points, which cost nothing; fewer on a line.
    size : float
        Root mean square distance of the target's outer nodes from their centroid.
    weight : float
        As given.
    """
    points = np.concatenate([source.outlines[k].point(source.s[k]) for k in range(len(partners))])
    u, sigma, _ = svd(np.column_stack([np.full(len(points), np.ptp(points)), points - points.mean(axis=0)]))
    outer = target.outlines[partners[0]].point(target.s[partners[0]])
    size = float(np.sqrt(((outer - outer.mean(axis=0)) ** 2).sum(axis=1).mean()))
    return bending_matrix(points), u[:, sigma > 1e-9 * sigma[0]], size, weight
