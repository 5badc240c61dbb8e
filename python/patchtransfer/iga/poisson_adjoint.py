"""Derivatives of solutions of Poisson's equation by the geometry's control points, by the adjoint method.

With K u = F inside and the boundary values fitted, a function J of the coefficients and of the geometry has the
derivative of ``J + λᵀ (F - K u)`` at held coefficients, where K λ = ∂J/∂u inside and λ = 0 where values are given, plus
that of the fitted boundary values in the direction of what is left, ``∂J/∂u - K λ`` there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csc_array

from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from ..numeric.definite import DefiniteFactor
from ..numeric.dense import product
from .fluxes import Flux, add_flux_work
from .nodes import GeometryAt, ScalarFunction, SideNodes, sampled
from .shape import Sensitivity, slope_of
from .space import SplineSpace

__all__ = ["PoissonAdjoint", "add_boundary_values", "isotropic"]


@dataclass(frozen=True, eq=False)
class PoissonAdjoint:
    """A solved problem, with what its derivatives need.

    Attributes
    ----------
    mp : MultiPatch
    space : SplineSpace
    u : (n,) array
        Coefficients of the solution.
    make_matrix, make_stiffness : callable
        Give K, (n, n) sparse, of all unknowns, with what fluxes add and without.
    solve : callable
        K⁻¹ on the free unknowns, for right-hand sides (n,); zero on the others.
    maps : list of GeometryAt
    sides : list of SideNodes
        Where values are given ...
    data : list of callable
        ... and these.
    f : callable
        Right-hand side.
    fluxes : list of Flux
        Sides with a condition on the flux.
    """

    mp: MultiPatch
    space: SplineSpace
    u: FloatArray
    make_matrix: Callable[[], csc_array]
    make_stiffness: Callable[[], csc_array]
    solve: Callable[[FloatArray], FloatArray]
    maps: list[GeometryAt]
    sides: list[SideNodes]
    data: list[ScalarFunction]
    f: ScalarFunction
    fluxes: list[Flux]

    @cached_property
    def _matrix(self) -> csc_array:
        return self.make_matrix()

    def vjp(self, w: FloatArray) -> FloatArray:
        """Derivative (n_points, 2) of a function with the derivative `w` (n,) by the coefficients."""
        out = Sensitivity(self.mp)
        self._add_solution(out, w)
        return out.gradient

    def integral(self, weight: ScalarFunction) -> tuple[float, FloatArray]:
        """∫ weight u dx and its derivative (n_points, 2)."""
        out, total, by_u = Sensitivity(self.mp), 0.0, []
        slope = slope_of(weight, self.mp.diameter)
        for at in self.maps:
            place = f"patch {at.index}"
            values = sampled(weight, at.x, "weight", place)
            u = at.nodes.value(self._patch(self.u, at))
            total += float((at.dx * values * u).sum())
            by_u.append(at.nodes.tested(at.dx * values))
            out.add(at, isotropic(values * u), slope(at.x, "weight", place) * u)
        self._add_solution(out, self.space.gather(by_u))
        return total, out.gradient

    def energy(self) -> tuple[float, FloatArray]:
        """½ ∫ |∇u|² dx and its derivative (n_points, 2)."""
        out, total = Sensitivity(self.mp), 0.0
        for at in self.maps:
            gradient = at.gradient(self._patch(self.u, at))
            total += float((at.dx * (gradient * gradient).sum(axis=0)).sum() / 2)
            out.add(at, _stress(gradient, gradient) / 2)
        self._add_solution(out, self.make_stiffness() @ self.u)
        return total, out.gradient

    def _patch(self, coefficients: FloatArray, at: GeometryAt) -> FloatArray:
        return np.asarray(coefficients[self.space.points[at.index]])

    def _add_solution(self, out: Sensitivity, w: FloatArray) -> None:
        adjoint = self.solve(w)
        slope = slope_of(self.f, self.mp.diameter)
        for at in self.maps:
            place = f"patch {at.index}"
            c = self._patch(adjoint, at)
            value, load = at.nodes.value(c), sampled(self.f, at.x, "right-hand side", place)
            stress = isotropic(load * value) - _stress(at.gradient(self._patch(self.u, at)), at.gradient(c))
            out.add(at, stress, slope(at.x, "right-hand side", place) * value)
        add_flux_work(out, self.space, self.fluxes, self.u, adjoint, self.mp.diameter)
        left = w - self._matrix @ adjoint
        add_boundary_values(out, self.space, self.sides, self.data, self.u, left, self.mp)


def add_boundary_values(
    out: Sensitivity,
    space: SplineSpace,
    sides: list[SideNodes],
    data: list[ScalarFunction],
    u: FloatArray,
    w: FloatArray,
    mp: MultiPatch,
) -> None:
    """Of the fitted boundary values u along `w` (n,): ∫ μ ((g - u) d(ds) + dg ds), where μ solves the fit's system."""
    if not sides:
        return
    numbers = [side.side.of(space.points[side.patch]) for side in sides]
    known = np.unique(np.concatenate(numbers))
    bases = [side.nodes.field[side.side.axis][0] for side in sides]
    rows, columns, entries = [], [], []
    for side, basis, number in zip(sides, bases, numbers, strict=True):
        i, j = np.meshgrid(*[np.searchsorted(known, number)] * 2, indexing="ij")
        rows.append(i.ravel())
        columns.append(j.ravel())
        entries.append(product(basis.T, side.ds[:, None] * basis).ravel())
    shape = (len(known), len(known))
    mass = csc_array((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
    weight = np.zeros(len(w))
    weight[known] = DefiniteFactor(mass).solve(w[known])
    for side, basis, number, g in zip(sides, bases, numbers, data, strict=True):
        mu, missed = product(basis, weight[number]), sampled(g, side.x, "Dirichlet data", side.name)
        missed = missed - product(basis, u[number])
        slope = slope_of(g, mp.diameter)(side.x, "Dirichlet data", side.name)
        out.add_side(side, mu * missed * side.tangent, mu * slope)


def isotropic(values: FloatArray) -> FloatArray:
    """Multiples of the identity, (2, 2, ...)."""
    return np.multiply.outer(np.eye(2), values)


def _stress(a: FloatArray, b: FloatArray) -> FloatArray:
    """S of ∫ a·b dx for two gradients (2, m_u, m_v): (a·b) I - a bᵀ - b aᵀ."""
    both = np.einsum("iuv,juv->ijuv", a, b)
    return np.asarray(isotropic((a * b).sum(axis=0)) - both - both.swapaxes(0, 1))
