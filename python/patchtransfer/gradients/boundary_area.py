"""The area inside the boundary as a function of the boundary's control points, exactly, with its derivative."""

from __future__ import annotations

import numpy as np

from ..geometry.areas import AROUND, area_form, rational_area_form
from ..geometry.patch import Patch
from ..geometry.sides import Side
from ..geometry.topology import Topology
from ..numeric.arrays import FloatArray

__all__ = ["BoundaryArea", "patch_area"]


class BoundaryArea:
    """½ ∮ x dy - y dx over all loops: the form xᵀ Q y of the boundary points' coordinates, Q skew.

    Parameters
    ----------
    topology : Topology
        Boundary points are in the order of its ``boundary_points``.
    """

    def __init__(self, topology: Topology) -> None:
        from scipy.sparse import csr_array

        n = len(topology.boundary_points)
        rows, columns, values = [np.empty(0, int)], [np.empty(0, int)], [np.empty(0)]
        for side in (side for loop in topology.loops for side in loop):
            form = _form(topology.patches[side.patch], side.side)
            at = np.searchsorted(topology.boundary_points, side.side.of(topology.points[side.patch]))
            i, j = np.meshgrid(at, at, indexing="ij")
            rows.append(i.ravel())
            columns.append(j.ravel())
            values.append((-0.5 if side.reversed else 0.5) * (form - form.T).ravel())
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        self._form = csr_array(entries, shape=(n, n))

    def __call__(self, boundary: FloatArray) -> float:
        """The area, positive where the domain is on the left of its loops."""
        return float((boundary[:, 0] * (self._form @ boundary[:, 1])).sum())

    def gradient(self, boundary: FloatArray) -> FloatArray:
        """Its derivative (n_b, 2) by the boundary points."""
        return np.column_stack([self._form @ boundary[:, 1], -(self._form @ boundary[:, 0])])


def patch_area(patch: Patch) -> float:
    """Signed area of a patch, with its weights."""
    total = 0.0
    for side, sign in AROUND:
        x, y = side.of(patch.control_points - patch.control_points[0, 0]).T
        form = _form(patch, side)
        total += 0.5 * sign * float((x[:, None] * (form - form.T) * y).sum())
    return total


def _form(patch: Patch, side: Side) -> FloatArray:
    """Matrix of ∫ R_i R_j' dt along a side."""
    knots, degree = patch.knots[side.axis].tobytes(), patch.degrees[side.axis]
    if patch.weights is None:
        return area_form(knots, degree)
    return rational_area_form(knots, degree, np.ascontiguousarray(side.of(patch.weights)).tobytes())
