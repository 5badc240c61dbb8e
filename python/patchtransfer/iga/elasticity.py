"""Linear elasticity of a thin plate (plane stress): displacements, stresses, compliance, derivatives by the geometry.

The form ``∫ λ div u div v + 2 μ ε(u) : ε(v) dx``, with λ = E ν / (1 - ν²) and μ = E / (2 + 2 ν), couples the components
by ``λ φ_x ψ_y + μ φ_y ψ_x``. Its skew part ``φ_x ψ_y - φ_y ψ_x`` is a divergence: what is left of it is ``∮ φ dψ``,
which does not depend on the geometry.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import block_array, csc_array, csr_array

from ..errors import InputError
from ..geometry.areas import area_form
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Side
from ..numeric.arrays import FloatArray
from ..numeric.definite import DefiniteFactor
from .conditions import dirichlet_data
from .elasticity_adjoint import ElasticityAdjoint, Material
from .nodes import GeometryAt, ScalarFunction, all_nodes, boundary_nodes, geometry_at, sides_at
from .space import Field, SplineSpace
from .system import Assembler, boundary_fit

__all__ = ["ElasticityResult", "elasticity"]

#: A component of a displacement, a traction or a body force.
Component = ScalarFunction | float | None
#: Both components on the sides of labels; None leaves one free.
OnLabels = Mapping[str, Sequence[Component]]

GRADIENT = ((1, 0), (0, 1))
"""Parametric derivatives in the gradient: orders in u and v."""


@dataclass(frozen=True, eq=False)
class ElasticityResult:
    """Displacement of a plate, with what follows from it.

    Attributes
    ----------
    displacement : (Field, Field)
        Components along x and y, of one space.
    multipatch : MultiPatch
    residual : float
        Largest residual of the linear system, relative to the largest load or reaction.
    """

    displacement: tuple[Field, Field]
    multipatch: MultiPatch
    residual: float
    _adjoint: ElasticityAdjoint = field(repr=False)

    def __repr__(self) -> str:
        return f"<ElasticityResult: {2 * self.dofs} unknowns, residual {self.residual:.1e}>"

    def __call__(self, points: ArrayLike) -> FloatArray:
        """The displacement (..., 2) at points (..., 2) of the plane; NaN outside. See `MultiPatch.locate`."""
        found = self.multipatch.locate(points)
        return np.stack([component.at(*found) for component in self.displacement], axis=-1)

    @property
    def dofs(self) -> int:
        """Number of coefficients of a component."""
        return self.displacement[0].space.size

    def stress(self, k: int, u: ArrayLike, v: ArrayLike) -> FloatArray:
        """Stresses σ_xx, σ_yy, σ_xy on the grid `u` x `v` of patch k, (3, len(u), len(v))."""
        patch = self.multipatch.patches[k]
        jacobian = np.stack([np.moveaxis(patch.grid(u, v, *order), 2, 0) for order in GRADIENT], axis=1)
        (a, b), (c, d) = jacobian
        inverse = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
        slopes = [[f.grid(k, u, v, *order) for order in GRADIENT] for f in self.displacement]
        gradient = np.einsum("ikuv,kjuv->ijuv", np.array(slopes), inverse)
        stress = self._adjoint.material.stress(gradient)
        return np.stack([stress[0, 0], stress[1, 1], stress[0, 1]])

    def von_mises(self, k: int, u: ArrayLike, v: ArrayLike) -> FloatArray:
        """Von Mises' equivalent stress on the grid `u` x `v` of patch k, (len(u), len(v))."""
        xx, yy, xy = self.stress(k, u, v)
        return np.asarray(np.sqrt(xx * xx - xx * yy + yy * yy + 3 * xy * xy))

    @property
    def components(self) -> tuple[Field, Field]:
        """The displacement, for `patchtransfer.write`."""
        return self.displacement

    def compliance(self) -> tuple[float, FloatArray]:
        """Work of the loads, ∫ t · u ds + ∫ b · u dx, and its derivative (n_points, 2) by the control points."""
        return self._adjoint.compliance()

    def vjp(self, w: ArrayLike) -> FloatArray:
        """Derivative (n_points, 2) by the control points of a function of the displacement.

        Parameters
        ----------
        w : (dofs, 2) array
            Its derivative by the coefficients of both components.

        Raises
        ------
        InputError
            On another shape or NaN.
        """
        given = np.asarray(w, float)
        if given.shape != (self.dofs, 2) or not np.isfinite(given).all():
            raise InputError(f"vjp: expected finite derivatives of shape {(self.dofs, 2)}, got {given.shape}")
        return self._adjoint.vjp(given)


def elasticity(
    mp: MultiPatch,
    displacement: OnLabels,
    traction: OnLabels | None = None,
    body: Sequence[Component] = (0.0, 0.0),
    *,
    modulus: float = 1.0,
    ratio: float = 0.3,
    degree: int | None = None,
    points: int | None = None,
    quadrature: int | None = None,
) -> ElasticityResult:
    """Solve plane stress, ``-div σ(u) = body``, on a plate of unit thickness.

    Parameters
    ----------
    mp : MultiPatch
        An injective model, polynomial or rational.
    displacement : mapping of labels to pairs
        Given displacements (u_x, u_y) on the sides of labels of `mp.sides`: numbers, callables of (x, y), or None for a
        component that is free. On a line of symmetry only the component across it is given, 0.
    traction : mapping of labels to pairs, optional
        Forces a length (t_x, t_y) on sides; sides without any are free.
    body : pair, optional
        Force an area; default none.
    modulus : float, default 1
        Young's modulus E.
    ratio : float, default 0.3
        Poisson's ratio ν.
    degree, points : int, optional
        As of `poisson`.
    quadrature : int, optional
        As of `poisson`.

    Returns
    -------
    ElasticityResult

    Raises
    ------
    InputError
        When the model is folded, on labels that it does not have, on a material that does not exist, and when the plate
        is not held.

    Examples
    --------
    A bar that is pulled: it grows longer by the stress over E, and thinner by ν times that.

    >>> from patchtransfer import MultiPatch, Patch, iga
    >>> bar = MultiPatch([Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 1]], [[4, 0], [4, 1]]])])
    >>> bar = bar.with_labels({"left": [(0, "west")], "right": [(0, "east")], "bottom": [(0, "south")]})
    >>> held = {"left": (0.0, None), "bottom": (None, 0.0)}
    >>> result = iga.elasticity(bar, held, {"right": (2.0, 0.0)}, modulus=100.0)
    >>> [round(float(f.grid(0, [1.0], [1.0])[0, 0]), 9) for f in result.displacement]
    [0.08, -0.006]
    >>> round(result.compliance()[0], 9)
    0.16
    """
    if not (modulus > 0 and -1 < ratio < 1):
        raise InputError(f"elasticity: modulus {modulus} must be positive, ratio {ratio} between -1 and 1")
    material = Material(modulus * ratio / (1 - ratio**2), modulus / (2 + 2 * ratio))
    space = SplineSpace(mp, degree, points)
    nodes = all_nodes(space, mp, quadrature)
    maps, sides = geometry_at(mp, nodes), sides_at(space, mp, boundary_nodes(space, mp, quadrature))
    given = [_data(mp, displacement, c, "displacement") for c in (0, 1)]
    loads = [_data(mp, traction or {}, c, "traction") for c in (0, 1)]
    matrix = _stiffness(space, mp, Assembler(space, nodes), maps, material)
    held = [[side for side in sides if (side.patch, side.side) in data] for data in given]
    values = [[data[s.patch, s.side] for s in of] for of, data in zip(held, given, strict=True)]
    known = np.concatenate([boundary_fit(space, of, g) for of, g in zip(held, values, strict=True)])
    fixed = [np.concatenate([side.side.of(space.points[side.patch]) for side in of]) for of in held]
    free = np.setdiff1d(np.arange(2 * space.size), np.concatenate([fixed[0], fixed[1] + space.size]))
    try:
        factor = DefiniteFactor(matrix[free][:, free])
    except RuntimeError as error:
        raise InputError(
            f"elasticity: the plate is not held, or the geometry is nearly singular ({error}); give displacements that "
            "leave it no rigid motion"
        ) from None

    def solve(w: FloatArray) -> FloatArray:
        x = np.zeros(len(w))
        x[free] = factor.solve(w[free])
        return x

    forces = [_function(f) for f in body]
    pulls = [(s, [_function(d.get((s.patch, s.side))) for d in loads]) for s in sides]
    pulled = [(s, t) for s, t in pulls if any((s.patch, s.side) in d for d in loads)]
    adjoint = ElasticityAdjoint(mp, space, known, matrix, solve, material, maps, forces, pulled, held, values)
    u = known + solve(adjoint.load - matrix @ known)
    adjoint.u[:] = u
    gap, size = matrix @ u - adjoint.load, max(float(np.abs(matrix @ u).max()), float(np.abs(adjoint.load).max()))
    residual = float(np.abs(gap[free]).max(initial=0.0)) / size if size > 0 else 0.0
    parts = Field(space, u[: space.size]), Field(space, u[space.size :])
    return ElasticityResult(parts, mp, residual, adjoint)


def _function(value: Component) -> ScalarFunction:
    return value if callable(value) else lambda x, y: np.full_like(x, 0.0 if value is None else value)


def _data(mp: MultiPatch, given: OnLabels, component: int, what: str) -> dict[tuple[int, Side], ScalarFunction]:
    """Values of a component on the sides that have some."""
    for label, pair in given.items():
        if not isinstance(pair, (tuple, list)) or len(pair) != 2:
            raise InputError(f"{what}: label {label!r} needs two components, (x, y), got {pair!r}")
    values: dict[str, ScalarFunction | float] = {}
    for label, pair in given.items():
        value = pair[component]
        if value is not None:
            values[label] = value
    if not values and what == "traction":
        return {}
    return dirichlet_data(mp, values, f"{what} along {'xy'[component]}")


def _stiffness(
    space: SplineSpace, mp: MultiPatch, assembler: Assembler, maps: list[GeometryAt], material: Material
) -> csr_array:
    """The matrix of both components, those along x first."""
    first, second = material.first, material.second

    def form(by: Callable[[FloatArray, FloatArray], FloatArray]) -> csc_array:
        """∫ of a symmetric form in physical derivatives, given for pairs of parametric ones."""
        pairs = ((0, 0), (0, 1), (1, 1))
        coefficients = [np.stack([at.dx * by(at.inverse[k], at.inverse[j]) for k, j in pairs]) for at in maps]
        return assembler.matrix(assembler.values(GRADIENT, coefficients))

    along_x = form(lambda k, j: (first + 2 * second) * k[0] * j[0] + second * k[1] * j[1])
    along_y = form(lambda k, j: (first + 2 * second) * k[1] * j[1] + second * k[0] * j[0])
    mixed = form(lambda k, j: (first + second) / 2 * (k[0] * j[1] + k[1] * j[0]))
    skew = (first - second) / 2 * _around(space, mp)
    return csr_array(block_array([[along_x, mixed + skew], [mixed + skew.T, along_y]]))


def _around(space: SplineSpace, mp: MultiPatch) -> csr_array:
    """∮ φ dψ = ∫ φ_x ψ_y - φ_y ψ_x dx."""
    rows, columns, values = [], [], []
    for side in (side for loop in mp.topology.loops for side in loop):
        basis = space.bases[side.patch][side.side.axis]
        number = side.side.of(space.points[side.patch])
        i, j = np.meshgrid(number, number, indexing="ij")
        rows.append(i.ravel())
        columns.append(j.ravel())
        values.append((-1.0 if side.reversed else 1.0) * area_form(basis.knots.tobytes(), basis.degree).ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return csr_array(entries, shape=(space.size, space.size))
