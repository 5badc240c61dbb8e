"""Derivatives of integrals by the control points of the geometry, coefficients of fields held.

A motion V of the domain changes ``dx`` by ``div V dx`` and the gradient of a field by ``-(∇V)ᵀ∇u``. So every integral
here changes by ``∫ S : ∇V + b · V dx``, plus ``∫ t · ∂V/∂s + c · V ds`` on sides, with S, b, t and c at the
quadrature's nodes: the derivative of what was computed, to rounding, not of what it approximates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from ..numeric.dense import product
from .nodes import GeometryAt, ScalarFunction, SideNodes, sampled

__all__ = ["Sensitivity", "slope_of"]

#: Step of the differences that give the gradient of a user's function, in diameters: they err by 1e-10.
STEP = 1e-5


class Sensitivity:
    """Sums up the derivatives of integrals on a model.

    Parameters
    ----------
    mp : MultiPatch

    Attributes
    ----------
    gradient : (n_points, 2) array
        By the shared control points, of what was added so far.
    """

    def __init__(self, mp: MultiPatch) -> None:
        self._points = mp.topology.points
        self.gradient = np.zeros((mp.topology.n_points, 2))

    def add(self, at: GeometryAt, stress: FloatArray, force: FloatArray | None = None) -> None:
        """∫ S_ij ∂_j V_i + b_i V_i dx of a patch: (2, 2, m_u, m_v) and (2, m_u, m_v) arrays at its nodes."""
        flux = np.einsum("ijuv,kjuv->kiuv", stress, at.inverse) * at.dx
        self._tested(at, flux, np.zeros_like(flux[0]) if force is None else force * at.dx)

    def add_side(self, at: SideNodes, tension: FloatArray, force: FloatArray) -> None:
        """∫ t_i ∂V_i/∂s + c_i V_i ds of a boundary side: (2, m) arrays at its nodes."""
        along, shape = at.side.axis, at.geometry.x.shape
        flux = np.zeros((2, *shape))
        # ∂V/∂s ds is the derivative along the parameter times its weight.
        flux[along] = (tension * at.nodes.weights[along]).reshape(shape)
        self._tested(at.geometry, flux, (force * at.ds).reshape(shape))

    def _tested(self, at: GeometryAt, flux: FloatArray, force: FloatArray) -> None:
        """Sums at nodes of (k, i) fluxes times parametric derivatives of V_i, and of forces times V_i."""
        weights = at.patch.weights
        if weights is not None:
            # R = w N / W, so that ∂R = w (∂N - N ∂W / W) / W.
            w, wu, wv = (at.nodes.evaluate(at.patch, *order)[2] for order in ((0, 0), (1, 0), (0, 1)))
            force = (force - (flux[0] * wu + flux[1] * wv) / w) / w
            flux = flux / w
        (u, v) = at.nodes.geometry
        found = (
            product(product(u[1].T, flux[0]), v[0])
            + product(product(u[0].T, flux[1]), v[1])
            + product(product(u[0].T, force), v[0])
        )
        if weights is not None:
            found = found * weights
        np.add.at(self.gradient, self._points[at.index].ravel(), found.reshape(2, -1).T)


def slope_of(f: ScalarFunction, diameter: float) -> Callable[[FloatArray, str, str], FloatArray]:
    """The gradient (2, ...) of a user's function at points (2, ...), by central differences."""
    steps = STEP * diameter * np.eye(2)

    def slope(x: FloatArray, what: str, place: str) -> FloatArray:
        sides: Sequence[Sequence[FloatArray]] = [
            [sampled(f, x + sign * step.reshape(2, *[1] * (x.ndim - 1)), what, place) for sign in (1, -1)]
            for step in steps
        ]
        return np.stack([(up - down) / (2 * STEP * diameter) for up, down in sides])

    return slope
