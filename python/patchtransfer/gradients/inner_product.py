"""The H¹ inner product of motions of the boundary: gradients that are smooth steps.

A gradient by control points depends on how the knots divide the boundary, and steps along it roughen the outline. The
Riesz representative of the same derivative in H¹ does neither (Paganini, Wechsung, Farrell, *Higher-order moving mesh
methods for PDE-constrained shape optimization*, SIAM J. Sci. Comput. 40(4), 2018).
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..geometry.basis import knot_spans
from ..geometry.rational import rational_basis
from ..geometry.topology import Topology
from ..numeric.arrays import FloatArray
from ..numeric.dense import product

if TYPE_CHECKING:
    from ..numeric.definite import DefiniteFactor

__all__ = ["InnerProduct"]


class InnerProduct:
    """∮ a·b + ℓ² a'·b' ds over the boundary of a map, for motions of its control points.

    ℓ is the radius of the disc of the same area: motions that are longer than that count by their size, shorter ones by
    their slope. What it gives does not depend on the unit of length but for the factor of ds.

    Parameters
    ----------
    topology : Topology
        Motions are in the order of its ``boundary_points``.
    points : (n_points, 2) array
        The map.
    area : float
        Inside its boundary.

    Attributes
    ----------
    matrix : (n_b, n_b) sparse array
        Symmetric positive definite; both components of a motion have the same.
    """

    def __init__(self, topology: Topology, points: FloatArray, area: float) -> None:
        from scipy.sparse import csc_array

        n, squared = len(topology.boundary_points), area / np.pi
        rows, columns, values = [np.empty(0, int)], [np.empty(0, int)], [np.empty(0)]
        for side in (side for loop in topology.loops for side in loop):
            patch, axis = topology.patches[side.patch], side.side.axis
            index = side.side.of(topology.points[side.patch])
            weights = None if patch.weights is None else side.side.of(patch.weights)
            local = _side_matrix(patch.knots[axis], patch.degrees[axis], weights, points[index], squared)
            at = np.searchsorted(topology.boundary_points, index)
            i, j = np.meshgrid(at, at, indexing="ij")
            rows.append(i.ravel())
            columns.append(j.ravel())
            values.append(local.ravel())
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        self.matrix = csc_array(entries, shape=(n, n))

    def __repr__(self) -> str:
        return f"<InnerProduct: {self.matrix.shape[0]} boundary points>"

    @cached_property
    def _factor(self) -> DefiniteFactor:
        from ..numeric.definite import DefiniteFactor

        return DefiniteFactor(self.matrix)

    def __call__(self, a: FloatArray, b: FloatArray) -> float:
        """The inner product of two motions (n_b, 2)."""
        return float((a * (self.matrix @ b)).sum())

    def gradient(self, derivative: FloatArray) -> FloatArray:
        """The motion (n_b, 2) whose inner product with any other is what `derivative` (n_b, 2), a `vjp`, gives it."""
        return self._factor.solve(np.asarray(derivative, float))


def _side_matrix(
    knots: FloatArray, degree: int, weights: FloatArray | None, points: FloatArray, squared: float
) -> FloatArray:
    """∫ N_i N_j + ℓ² N_i' N_j' ds of one side."""
    breaks = knot_spans(knots)
    t, w = np.polynomial.legendre.leggauss(degree + 2)
    half = np.diff(breaks)[:, None] / 2
    nodes, w = (breaks[:-1, None] + half * (t + 1)).ravel(), (half * w).ravel()
    value, slope = rational_basis(knots, degree, weights, nodes)
    speed = np.hypot(*product(slope, points).T)
    return product(value.T * (w * speed), value) + squared * product(slope.T * (w / speed), slope)
