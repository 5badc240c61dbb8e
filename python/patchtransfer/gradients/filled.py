"""A map of a frozen problem: its points, its proof, and its derivative by the boundary.

With the rows frozen the inside is ``X_i = Z y + P X_b`` with ``Zᵀ ∂E/∂X_i = 0`` at the scale ``s = (A_ref / A)^½`` of
the area A inside the boundary. Differentiating that once (implicit function theorem), with ``∂E(sX)/∂s`` expressed by
the Hessian H over all points, and a = ∂ ln A / ∂X_b:

- ``J d = lift(d) - respond(H v)`` for ``lift(d) = (P d, d)``, ``v = lift(d) - ½ (a·d) X``;
- ``Jᵀ w = w_b - r_b + Pᵀ (w_i - r_i) + ½ (X·r) a`` for ``r = H respond(w)``;

where ``respond(q) = Z (Zᵀ H Z)⁻¹ Zᵀ q``. The factorization is of the point that Newton's iteration came to, the Hessian
of the settled one: one refinement of the solution makes up for that.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, TransferError
from ..geometry.multipatch import MultiPatch
from ..interior.optimizer import SplineOptimizer
from ..numeric.arrays import FloatArray
from ..proof.certificate import Certificate, certify
from .problem import Problem

__all__ = ["Filled"]


class Filled:
    """A map of a `Frozen` problem, made by `Frozen.fill`.

    Attributes
    ----------
    points : (n_points, 2) array
        Shared control points; those of the boundary as given.
    energy : float
        The distortion that the map is a minimum of; 2 + 2 λ = 2.6 is the least possible.
    gradient_norm : float
        What is left of the energy's gradient for the unknowns, its largest component times the boundary's diameter.
    """

    def __init__(
        self,
        problem: Problem,
        points: FloatArray,
        moved: FloatArray,
        start: FloatArray | None,
        scale: float,
        energy: float,
        gradient_norm: float,
    ) -> None:
        # `moved`: about the frozen centre; `start`: where the Hessian is factorized, None where it is not definite.
        points.flags.writeable = False
        self.points, self.energy, self.gradient_norm = points, energy, gradient_norm
        self._problem, self._moved, self._start, self._scale = problem, moved, start, scale

    def __repr__(self) -> str:
        return f"<Filled: {len(self.points)} points, energy {self.energy:.4f}, gradient {self.gradient_norm:.1e}>"

    @cached_property
    def multipatch(self) -> MultiPatch:
        """The source's patches with these points."""
        return self._problem.source.with_shared_points(self.points)

    @cached_property
    def certificate(self) -> Certificate:
        """Proof of injectivity, or where it fails; made when asked for."""
        return certify(self.multipatch)

    def jvp(self, d: ArrayLike) -> FloatArray:
        """How all points move with the boundary: the Jacobian of `Frozen.fill` times motions of the boundary.

        Parameters
        ----------
        d : (n_b, 2) or (k, n_b, 2) array
            In the order of ``topology.boundary_points``.

        Returns
        -------
        (n_points, 2) or (k, n_points, 2) array

        Raises
        ------
        InputError
            On another shape or NaN.
        TransferError
            When the map has folds or is no minimum, so that the points are no function of the boundary there.
        """
        problem = self._problem
        motions = self._fields(d, len(problem.boundary_points), "jvp: motions of the boundary")
        optimizer = self._linearised()
        lifted = problem.lift(motions)
        by_area = _dot(motions, self._area_slope)[:, None, None] / 2 * self._moved
        force = optimizer.product(lifted - by_area)
        return (lifted - self._answer(optimizer, force)).reshape(*np.shape(d)[:-2], *self.points.shape)

    def vjp(self, w: ArrayLike) -> FloatArray:
        """Derivatives by the boundary of functions with the derivatives `w` by all points: the transpose of `jvp`.

        Parameters
        ----------
        w : (n_points, 2) or (k, n_points, 2) array
            Several share one factorization.

        Returns
        -------
        (n_b, 2) or (k, n_b, 2) array
            In the order of ``topology.boundary_points``.

        Raises
        ------
        InputError, TransferError
            As `jvp`.
        """
        problem = self._problem
        weights = self._fields(w, len(self.points), "vjp: derivatives by all points")
        optimizer = self._linearised()
        reaction = optimizer.product(self._answer(optimizer, weights))
        by_area = _dot(reaction, self._moved)[:, None, None] / 2 * self._area_slope
        out = problem.drop(weights - reaction) + by_area
        return np.asarray(out.reshape(*np.shape(w)[:-2], *out.shape[-2:]))

    @cached_property
    def _area_slope(self) -> FloatArray:
        """Derivative of the area's logarithm by the boundary points."""
        problem, boundary = self._problem, self._moved[self._problem.boundary_points]
        return problem.area.gradient(boundary) / problem.area(boundary)

    def _answer(self, optimizer: SplineOptimizer, forces: FloatArray) -> FloatArray:
        first = optimizer.respond(forces)
        return first + optimizer.respond(forces - optimizer.product(first))

    def _linearised(self) -> SplineOptimizer:
        if self._start is None:
            raise TransferError(
                "this map has folds, or is no strict minimum of the distortion, so that it has no derivative by the "
                "boundary; step back to a boundary whose map is certified"
            )
        return self._problem.linearised(self, self._start, self._moved, self._scale)

    def _fields(self, given: ArrayLike, n: int, what: str) -> FloatArray:
        fields = np.asarray(given, float)
        if fields.ndim not in (2, 3) or fields.shape[-2:] != (n, 2) or not np.isfinite(fields).all():
            raise InputError(f"{what}: expected finite numbers of shape {(n, 2)} or (k, {n}, 2), got {fields.shape}")
        return fields.reshape(-1, n, 2)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Inner products (k,) of fields (k, n, 2) with one field (n, 2)."""
    return np.asarray((a * b).sum(axis=(1, 2)))
