"""The biharmonic equation (clamped plate) with C¹ fields."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csc_array, csr_array

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from ..numeric.definite import upper_triangle
from .c1_space import C1Space
from .manufactured import Wave
from .nodes import (
    GeometryAt,
    ScalarFunction,
    SideNodes,
    all_nodes,
    boundary_nodes,
    geometry_at,
    sampled,
    sampled_vector,
    sides_at,
)
from .norms import ErrorNorms, VectorFunction, error_norms
from .space import Field, SplineSpace
from .system import Assembler, DefiniteSystem

__all__ = ["BiharmonicResult", "biharmonic", "sine_hessian"]

sine = Wave()
SECOND = ((2, 0), (1, 1), (0, 2), (1, 0), (0, 1))
"""Parametric derivatives in the Laplacian: orders in u and v."""


def sine_hessian(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Second derivatives u_xx, u_xy, u_yy of sin(πx) sin(πy)."""
    mixed = np.pi**2 * np.cos(np.pi * x) * np.cos(np.pi * y)
    return -(np.pi**2) * sine(x, y), mixed, -(np.pi**2) * sine(x, y)


def sine_double_laplacian(x: FloatArray, y: FloatArray) -> FloatArray:
    """Δ² of sin(πx) sin(πy)."""
    return 4 * np.pi**4 * sine(x, y)


def laplacian(at: GeometryAt) -> FloatArray:
    """Coefficients of Δφ = Σ_k c_k D_k φ over the derivatives `SECOND`, (5, m_u, m_v).

    With A = J⁻¹ and M = A Aᵀ: Δφ = M : (φ's parametric Hessian) − Σ (∇φ) · (M : the map's Hessian).
    """
    a = at.inverse
    m = np.einsum("ka...,la...->kl...", a, a)
    second = np.stack([m[0, 0], 2 * m[0, 1], m[1, 1]])
    bend = np.einsum("o...,oc...->c...", second, at.curvature)
    first = -np.einsum("kc...,c...->k...", a, bend)
    return np.concatenate([second, first])


def bending(at: GeometryAt) -> FloatArray:
    """Coefficients of ∫ Δφ Δψ dx = ∫ Σ_kl C_kl (D_k φ)(D_l ψ)."""
    c = laplacian(at)
    return np.stack([at.dx * c[k] * c[m] for k in range(len(c)) for m in range(k, len(c))])


@dataclass(frozen=True, eq=False)
class BiharmonicResult:
    """Solution of the biharmonic equation with its evidence.

    Attributes
    ----------
    field : Field
    multipatch : MultiPatch
    errors : ErrorNorms or None
        With the H² seminorm; None when no exact solution is known.
    dofs : int
        Number of C¹ basis functions, those on the boundary included.
    as_g1_residual : float
        Largest over the interfaces; above 1e-9 the model is not analysis-suitable, and the field has kinks.
    c1_residual : float
        Largest residual of the C¹ conditions (orthonormal rows), relative to the largest coefficient.
    residual : float
        Residual of the linear system, relative to the largest sum of a row's terms.
    timings : dict
        Seconds per stage.
    """

    field: Field
    multipatch: MultiPatch
    errors: ErrorNorms | None
    dofs: int
    as_g1_residual: float
    c1_residual: float
    residual: float
    timings: dict[str, float]

    def __repr__(self) -> str:
        errors = "" if self.errors is None else f", L2 error {self.errors.l2:.2e}"
        return f"<BiharmonicResult: {self.dofs} unknowns{errors}, residual {self.residual:.1e}>"

    def __call__(self, points: ArrayLike) -> FloatArray:
        """The solution at points (..., 2) of the plane; NaN outside of the model. See `MultiPatch.locate`."""
        return self.field.at(*self.multipatch.locate(points))

    @property
    def components(self) -> tuple[Field, ...]:
        """The field, for `patchtransfer.write`."""
        return self.field.components

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        e = self.errors
        return {
            "l2_error": None if e is None else e.l2,
            "h1_error": None if e is None else e.h1,
            "h2_error": None if e is None else e.h2,
            "max_error": None if e is None else e.max,
            "dofs": self.dofs,
            "degree": self.field.space.degree,
            "as_g1_residual": self.as_g1_residual,
            "c1_residual": self.c1_residual,
            "residual": self.residual,
            "timings": self.timings,
        }


def biharmonic(
    mp: MultiPatch,
    f: ScalarFunction | None = None,
    exact: ScalarFunction | None = None,
    gradient: VectorFunction | None = None,
    hessian: VectorFunction | None = None,
    *,
    degree: int | None = None,
    divisions: int = 1,
    smoothness: int | None = None,
    gluing: str = "exact",
    quadrature: int | None = None,
) -> BiharmonicResult:
    """Solve Δ²u = f with u and its normal derivative given on the boundary.

    Parameters
    ----------
    mp : MultiPatch
        Polynomial and injective, patches of any orientation, with analysis-suitable G1 (AS-G1) interfaces.
    f : callable, optional
        Right-hand side ``f(x, y)`` of arrays; default 4π⁴ sin(πx) sin(πy), with the solution sin(πx) sin(πy).
    exact, gradient : callable, optional
        Known solution and its gradient (u_x, u_y): boundary data, and for errors. Without them the plate is clamped:
        both are zero on the boundary, and there are no errors.
    hessian : callable, optional
        Second derivatives (u_xx, u_xy, u_yy) for the error in H².
    degree : int, optional
        The field's degree, at least 3; default the geometry's, 3 if that is lower.
    divisions : int, default 1
        Parts that the geometry's knot spans are divided into.
    smoothness : int, optional
        Continuous derivatives at the knots inside, 1 to ``degree - 2`` (the default).
    gluing : {"exact", "nearest"}, default "exact"
        Whether interfaces that are not AS-G1 are refused, or glued as nearly as can be; see :class:`C1Space`.
    quadrature : int, optional
        Gauss nodes per span and direction; default one more than the larger degree of field and geometry.

    Returns
    -------
    BiharmonicResult

    Raises
    ------
    InputError
        When a callable fails, the model is folded, rational or not AS-G1, or degree and smoothness do not allow C¹
        fields.

    Notes
    -----
    Galerkin's method for ∫ Δu Δv in the C¹ space of :class:`C1Space`. The boundary data are fitted in least squares,
    the normal derivative weighted by the squared mean length of a boundary span.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> plate = pt.parameterize(pt.Boundary.from_points([(0, 0), (1, 0), (1, 1), (0, 1)])).multipatch
    >>> result = pt.iga.biharmonic(plate, lambda x, y: 1 + 0 * x, degree=4)
    >>> round(float(result([0.5, 0.5])), 5)  # a clamped square's deflection
    0.00127
    """
    begin = time.perf_counter()
    highest = max(max(patch.degrees) for patch in mp.patches)
    p = max(3, highest) if degree is None else degree
    r = p - 2 if smoothness is None else smoothness
    if p < 3 or not 1 <= r <= p - 2:
        raise InputError(
            f"degree {p} with smoothness {r}: C¹ fields of full order need degree 3 or more and a smoothness of 1 to "
            "degree - 2"
        )
    if f is None:
        if exact is not None:
            raise InputError("a known solution needs its right-hand side f = Δ² exact too")
        f, exact, gradient, hessian = sine_double_laplacian, sine, sine.gradient, sine_hessian
    if exact is not None and gradient is None:
        raise InputError("the exact solution needs its gradient too: the normal derivative on the boundary is given")
    space = SplineSpace(mp, p, divisions=divisions, smoothness=r)
    fields = C1Space(space, mp, gluing)
    clock = [begin, time.perf_counter()]
    nodes = all_nodes(space, mp, quadrature)
    maps = geometry_at(mp, nodes)
    assembler = Assembler(space, nodes)
    stiffness = assembler.matrix(assembler.values(SECOND, [bending(at) for at in maps]))
    load = space.gather(
        [at.nodes.tested(at.dx * sampled(f, at.x, "right-hand side", f"patch {at.index}")) for at in maps]
    )
    u = np.zeros(space.size)
    if exact is not None and gradient is not None:
        u = _fitted(fields, mp, exact, gradient, quadrature)
    clock.append(time.perf_counter())
    z = fields.inside
    c, residual = _solve(z.T @ stiffness @ z, z.T @ (load - stiffness @ u))
    u = u + z @ c
    clock.append(time.perf_counter())
    field = Field(space, u)
    errors = None if exact is None else error_norms(field, mp, exact, gradient, hessian)
    clock.append(time.perf_counter())
    gap = float(np.abs(fields.rows @ u).max(initial=0.0) / max(np.abs(u).max(), 1e-300))
    stages = dict(zip(("space", "assembly", "solve", "errors"), np.diff(clock).tolist(), strict=True))
    dofs = fields.inside.shape[1] + fields.boundary.shape[1]
    return BiharmonicResult(field, mp, errors, dofs, fields.as_g1_residual, gap, residual, stages)


def _solve(matrix: csc_array, rhs: FloatArray) -> tuple[FloatArray, float]:
    upper = upper_triangle(csc_array(matrix))
    system = DefiniteSystem(upper.indptr.astype(np.int64), upper.indices.astype(np.int64))
    return system.solve(upper.data, rhs, np.zeros(len(rhs)))


def _fitted(
    fields: C1Space, mp: MultiPatch, exact: ScalarFunction, gradient: VectorFunction, quadrature: int | None
) -> FloatArray:
    """A C¹ field nearest to the given value and normal derivative on the boundary."""
    space = fields.space
    sides = sides_at(space, mp, boundary_nodes(space, mp, quadrature))
    spans = sum(len(space.bases[s.patch][s.side.axis].breaks) - 1 for s in sides)
    h = sum(float(s.ds.sum()) for s in sides) / spans
    rows, values = [], []
    for s in sides:
        for order, scale in ((0, 1.0), (1, h)):
            weight = scale * np.sqrt(s.ds)
            if order == 0:
                given = sampled(exact, s.x, "boundary value", s.name)
            else:
                given = (sampled_vector(gradient, s.x, 2, "boundary gradient", s.name) * s.normal).sum(axis=0)
            rows.append((weight[:, None] * _trace(s, order), s))
            values.append(weight * given)
    table = csc_array(_boundary_rows(space, rows) @ fields.boundary)
    c, _ = _solve(csc_array(table.T @ table), table.T @ np.concatenate(values))
    return np.asarray(fields.boundary @ c)


def _trace(s: SideNodes, order: int) -> FloatArray:
    """Value or normal derivative at a side's nodes of its two rows of basis functions, (m, 2 n)."""
    along, across = s.nodes.field[s.side.axis], s.nodes.field[1 - s.side.axis]
    ends = across[:, 0, ::-1] if s.side.at_end else across[:, 0]
    if order == 0:
        return np.concatenate([ends[0, row] * along[0] for row in (0, 1)], axis=1)
    # n·∇φ = Σ_k (n·∇t_k) ∂_k φ with the parameters t_k.
    slopes = (s.geometry.inverse.reshape(2, 2, -1) * s.normal).sum(axis=1)[..., None]
    by_along, by_across = slopes[s.side.axis], slopes[1 - s.side.axis]
    return np.concatenate(
        [by_along * ends[0, row] * along[1] + by_across * ends[1, row] * along[0] for row in (0, 1)], axis=1
    )


def _boundary_rows(space: SplineSpace, blocks: list[tuple[FloatArray, SideNodes]]) -> csr_array:
    """Rows of all sides over all unknowns."""
    data, i, j, count = [], [], [], 0
    for block, s in blocks:
        numbers = np.concatenate([s.side.of(space.points[s.patch], row) for row in (0, 1)])
        data.append(block.ravel())
        i.append(count + np.repeat(np.arange(len(block)), block.shape[1]))
        j.append(np.tile(numbers, len(block)))
        count += len(block)
    index = (np.concatenate(i), np.concatenate(j))
    return csr_array(coo_array((np.concatenate(data), index), shape=(count, space.size)))
