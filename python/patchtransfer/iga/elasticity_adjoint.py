"""Derivatives of plane stress by the geometry's control points, by the adjoint method; see `poisson_adjoint`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from ..numeric.dense import product
from .nodes import GeometryAt, ScalarFunction, SideNodes, sampled
from .poisson_adjoint import add_boundary_values, isotropic
from .shape import Sensitivity, slope_of
from .space import SplineSpace

__all__ = ["ElasticityAdjoint", "Material"]


class Material(NamedTuple):
    """Lamé's constants of plane stress: λ = E ν / (1 - ν²) and μ."""

    first: float
    second: float

    def stress(self, gradient: FloatArray) -> FloatArray:
        """Stress (2, 2, ...) of a displacement's gradient ∂_j u_i."""
        trace = gradient[0, 0] + gradient[1, 1]
        return np.asarray(isotropic(self.first * trace) + self.second * (gradient + gradient.swapaxes(0, 1)))


@dataclass(frozen=True, eq=False)
class ElasticityAdjoint:
    """A solved problem, with what its derivatives need.

    Attributes
    ----------
    mp : MultiPatch
    space : SplineSpace
    u : (2 n,) array
        Coefficients of the displacement, along x first.
    matrix : (2 n, 2 n) sparse array
    solve : callable
        Its inverse on the free unknowns, for right-hand sides (2 n,); zero on the others.
    material : Material
    maps : list of GeometryAt
    body : list of callable
        Force an area, both components.
    tractions : list of (SideNodes, list of callable)
        Forces a length, both components.
    held, values : lists of lists
        Sides where a component is given, and the functions.
    """

    mp: MultiPatch
    space: SplineSpace
    u: FloatArray
    matrix: csr_array
    solve: Callable[[FloatArray], FloatArray]
    material: Material
    maps: list[GeometryAt]
    body: list[ScalarFunction]
    tractions: list[tuple[SideNodes, list[ScalarFunction]]]
    held: list[list[SideNodes]]
    values: list[list[ScalarFunction]]

    @cached_property
    def load(self) -> FloatArray:
        """Work of the loads by the basis functions, (2 n,)."""
        n = self.space.size
        out = np.zeros(2 * n)
        for c in (0, 1):
            inside = [
                at.nodes.tested(at.dx * sampled(self.body[c], at.x, "body force", f"patch {at.index}"))
                for at in self.maps
            ]
            out[c * n : (c + 1) * n] = self.space.gather(inside)
            for side, t in self.tractions:
                basis = side.nodes.field[side.side.axis][0]
                number = c * n + side.side.of(self.space.points[side.patch])
                np.add.at(out, number, product(basis.T, side.ds * sampled(t[c], side.x, "traction", side.name)))
        return out

    def compliance(self) -> tuple[float, FloatArray]:
        """Work of the loads and its derivative."""
        out = Sensitivity(self.mp)
        self._add_load(out, self.u)
        self._add_solution(out, self.load)
        return float((self.load * self.u).sum()), out.gradient

    def vjp(self, w: FloatArray) -> FloatArray:
        """Derivative of a function with the derivative `w` (n, 2) by the coefficients."""
        out = Sensitivity(self.mp)
        self._add_solution(out, w.T.ravel())
        return out.gradient

    def _add_solution(self, out: Sensitivity, w: FloatArray) -> None:
        adjoint = self.solve(w)
        self._add_load(out, adjoint)
        for at in self.maps:
            a, b = (self._gradient(at, c) for c in (self.u, adjoint))
            of_a, of_b = self.material.stress(a), self.material.stress(b)
            # Of ∂_j V_k: ∂_k λ_i σ_ij(u) + ∂_k u_i σ_ij(λ).
            turned = np.einsum("ikuv,ijuv->kjuv", b, of_a) + np.einsum("ikuv,ijuv->kjuv", a, of_b)
            out.add(at, turned - isotropic((of_a * b).sum(axis=(0, 1))))
        left, n = w - self.matrix @ adjoint, self.space.size
        for c in (0, 1):
            part = slice(c * n, (c + 1) * n)
            add_boundary_values(out, self.space, self.held[c], self.values[c], self.u[part], left[part], self.mp)

    def _add_load(self, out: Sensitivity, v: FloatArray) -> None:
        """Of the work of the loads along a displacement."""
        for at in self.maps:
            place, force, work = f"patch {at.index}", np.zeros_like(at.x), np.zeros_like(at.x[0])
            for f, along in zip(self.body, self._parts(at.index, v), strict=True):
                value = at.nodes.value(along)
                work += sampled(f, at.x, "body force", place) * value
                force += slope_of(f, self.mp.diameter)(at.x, "body force", place) * value
            out.add(at, isotropic(work), force)
        for side, t in self.tractions:
            basis, n = side.nodes.field[side.side.axis][0], self.space.size
            force, work = np.zeros_like(side.x), np.zeros_like(side.x[0])
            for c in (0, 1):
                value = product(basis, v[c * n + side.side.of(self.space.points[side.patch])])
                work += sampled(t[c], side.x, "traction", side.name) * value
                force += slope_of(t[c], self.mp.diameter)(side.x, "traction", side.name) * value
            out.add_side(side, work * side.tangent, force)

    def _parts(self, k: int, v: FloatArray) -> list[FloatArray]:
        numbers = self.space.points[k]
        return [v[numbers], v[self.space.size + numbers]]

    def _gradient(self, at: GeometryAt, v: FloatArray) -> FloatArray:
        """∂_j v_i, (2, 2, m_u, m_v)."""
        return np.stack([at.gradient(part) for part in self._parts(at.index, v)])
