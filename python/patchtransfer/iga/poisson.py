"""Poisson's equation on a multi-patch (§4 of the paper, Fig. 11)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from dataclasses import field as data_field
from functools import partial
from math import isqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csc_array

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Side
from ..numeric.arrays import FloatArray
from ..progress import Clock, Progress
from .conditions import Conditions, Dirichlet, Load, problem
from .fluxes import Flux, Neumann, Robin, add_flux_matrix, as_function, flux_load
from .nodes import GeometryAt, ScalarFunction, SideNodes, all_nodes, boundary_nodes, geometry_at, sampled, sides_at
from .norms import ErrorNorms, VectorFunction, error_norms
from .poisson_adjoint import PoissonAdjoint
from .space import Field, SplineSpace
from .system import Assembler, DefiniteSystem, boundary_fit

__all__ = ["LinearSystem", "PoissonResult", "PoissonSolver", "poisson"]

#: GB that a solution may take if nothing else is said.
MEMORY = 8.0
#: Bytes an unknown, and for each of its (2p + 1)² matrix entries: peak memory of solutions of 20,000 to a million
#: unknowns, nodes, factor and error norms included, is 5.4, 6.8, 8.6 and 17 kB an unknown at degrees 1, 2, 3 and 6.
BYTES, BYTES_AN_ENTRY = 4700, 80

GRADIENT = ((1, 0), (0, 1))
"""Parametric derivatives in the gradient: orders in u and v."""


def stiffness(at: GeometryAt) -> FloatArray:
    """Coefficients of ∫ ∇φ·∇ψ dx = ∫ Σ_kl G_kl ∂_k φ ∂_l ψ, G = |det J| J⁻¹J⁻ᵀ: G_uu, G_uv, G_vv at the nodes."""
    (ux, uy), (vx, vy) = at.inverse
    return np.asarray(at.dx * np.stack([ux * ux + uy * uy, ux * vx + uy * vy, vx * vx + vy * vy]))


@dataclass(frozen=True)
class LinearSystem:
    """K u = F on all unknowns of a space, before the boundary values are put in.

    Attributes
    ----------
    values : array
        Upper triangle of K in the solver's pattern.
    load : (n,) array
    known : (n,) array
        Boundary coefficients, zero inside.
    """

    values: FloatArray
    load: FloatArray
    known: FloatArray

    def __repr__(self) -> str:
        return f"<LinearSystem: {len(self.load)} unknowns, {len(self.values)} matrix entries>"


@dataclass(frozen=True, eq=False)
class PoissonResult:
    """Solution of Poisson's equation with its evidence.

    Attributes
    ----------
    field : Field
        The solution; `field.grid` evaluates it on a patch.
    multipatch : MultiPatch
    errors : ErrorNorms or None
        None when no exact solution is known.
    residual : float
        Largest residual of the linear system, relative to the largest sum of a row's terms.
    timings : dict
        Seconds per stage.
    exact : callable or None
    """

    field: Field
    multipatch: MultiPatch
    errors: ErrorNorms | None
    residual: float
    timings: dict[str, float]
    exact: ScalarFunction | None
    _adjoint: PoissonAdjoint = data_field(repr=False)

    @property
    def components(self) -> tuple[Field, ...]:
        """The solution, for `patchtransfer.write`."""
        return (self.field,)

    def __call__(self, points: ArrayLike) -> FloatArray:
        """The solution at points (..., 2) of the plane; NaN outside of the model. See `MultiPatch.locate`."""
        return self.field.at(*self.multipatch.locate(points))

    def vjp(self, w: ArrayLike) -> FloatArray:
        """Derivative of a function of the solution by the geometry's control points.

        Parameters
        ----------
        w : (dofs,) array
            Its derivative by the coefficients of `field`.

        Returns
        -------
        (n_points, 2) array
            By the shared control points of `multipatch`, the `w` of `Filled.vjp`: to rounding the derivative of what
            was computed, but for the gradients of callables, which are taken by differences (1e-10).

        Raises
        ------
        InputError
            On another shape or NaN.

        Examples
        --------
        >>> from patchtransfer import examples, iga
        >>> source, _, _ = examples.load("star")
        >>> result = iga.poisson(source, f=1.0)
        >>> torsion, gradient = result.integral()
        >>> gradient.shape == (source.topology.n_points, 2)
        True
        """
        given = np.asarray(w, float)
        if given.shape != (self.dofs,) or not np.isfinite(given).all():
            raise InputError(f"vjp: expected finite derivatives of shape ({self.dofs},), got {given.shape}")
        return self._adjoint.vjp(given)

    def integral(self, weight: ScalarFunction | float = 1.0) -> tuple[float, FloatArray]:
        """∫ weight u dx and its derivative (n_points, 2) by the geometry's control points; see `vjp`."""
        return self._adjoint.integral(as_function(weight))

    def energy(self) -> tuple[float, FloatArray]:
        """½ ∫ |∇u|² dx and its derivative (n_points, 2) by the geometry's control points; see `vjp`."""
        return self._adjoint.energy()

    def __repr__(self) -> str:
        errors = "" if self.errors is None else f", L2 error {self.errors.l2:.2e}"
        return f"<PoissonResult: {self.dofs} unknowns{errors}, residual {self.residual:.1e}>"

    @property
    def dofs(self) -> int:
        """Number of unknowns, those on the boundary included."""
        return self.field.space.size

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        e = self.errors
        return {
            "l2_error": None if e is None else e.l2,
            "h1_error": None if e is None else e.h1,
            "max_error": None if e is None else e.max,
            "exact_l2": None if e is None else e.exact_l2,
            "exact_max": None if e is None else e.exact_max,
            "dofs": self.dofs,
            "degree": self.field.space.degree,
            "points": list(self.field.space.shape),
            "residual": self.residual,
            "timings": self.timings,
        }


def _check_memory(mp: MultiPatch, degree: int | None, points: int, memory: float) -> None:
    """Refuse a field whose solution would take more than `memory` GB."""
    p = max(max(patch.degrees) for patch in mp.patches) if degree is None else degree
    # A degree below 1 has an error of its own.
    largest = isqrt(int(1e9 * memory / (BYTES + BYTES_AN_ENTRY * (2 * max(p, 1) + 1) ** 2)) // len(mp))
    if points > max(largest, p + 1):
        raise InputError(
            f"{points} points are too many: at degree {p} and {len(mp)} patches the solution takes more than "
            f"{memory:g} GB with more than {largest} per patch and direction"
        )


class PoissonSolver:
    """Poisson's equation −Δu = f, u = g on the boundary, on many models that share patches and interfaces.

    Space, quadrature, sparsity and the symbolic factorization are made once, from one of the models (the source of a
    transfer, say); :meth:`solve` does the rest for every model.

    Parameters
    ----------
    mp : MultiPatch
        Polynomial or rational.
    degree, points : int, optional
        The field's degree and its number of control points per patch and direction, independent of the geometry's.
        Default: the geometry's own space.
    knots : {"auto", "uniform"}, default "auto"
        Whether the field's knots contain the geometry's where there are points enough; see :class:`SplineSpace`.
    quadrature : int, optional
        Gauss nodes per span and direction; default one more than the larger degree of field and geometry.
    memory : float, default 8
        GB that the solution may take, as estimated from the number of `points`.
    progress : callable, optional
        Told of stages, as in `patchtransfer.transfer`.

    Raises
    ------
    InputError
        On a degree or number of points that does not exist, or too many points.

    Notes
    -----
    Galerkin's method, coefficients shared. Dirichlet data are fitted in L² by the boundary's basis, loop by loop.

    Examples
    --------
    >>> from patchtransfer import examples
    >>> source, _, _ = examples.load("star")
    >>> solver = PoissonSolver(source, degree=3, points=8)
    >>> bigger = source.with_control_points([2 * patch.control_points for patch in source.patches])
    >>> round(solver.solve(bigger, f=1.0).integral()[0] / solver.solve(source, f=1.0).integral()[0])
    16
    """

    def __init__(
        self,
        mp: MultiPatch,
        degree: int | None = None,
        points: int | None = None,
        *,
        knots: str = "auto",
        quadrature: int | None = None,
        memory: float = MEMORY,
        progress: Progress | None = None,
    ) -> None:
        self._progress, clock = progress, Clock(progress)
        with clock("setup") as stage:
            if points is not None:
                _check_memory(mp, degree, points, memory)
            self.space = SplineSpace(mp, degree, points, knots=knots)
            self.nodes = all_nodes(self.space, mp, quadrature)
            self._boundary_nodes = boundary_nodes(self.space, mp, quadrature)
            self.assembler = Assembler(self.space, self.nodes)
            self._knots = [patch.knots for patch in mp.patches]
            self._degrees = [patch.degrees for patch in mp.patches]
            self._systems: dict[tuple[tuple[int, Side], ...], DefiniteSystem] = {}
            self._unknowns_off(tuple(sorted(self.space.boundaries)))
            stage.found = f"{self.space.size} unknowns"
        self.setup_seconds = clock.seconds["setup"]

    def __repr__(self) -> str:
        return f"<PoissonSolver: {self.space.size} unknowns on {len(self.space.bases)} patches>"

    def _unknowns_off(self, sides: tuple[tuple[int, Side], ...]) -> DefiniteSystem:
        """The solver of the unknowns that vanish on these sides, analysed once."""
        if sides not in self._systems:
            known = np.concatenate([s.of(self.space.points[k]) for k, s in sides] or [np.empty(0, int)])
            free = np.setdiff1d(np.arange(self.space.size), known).astype(np.int64)
            self._systems[sides] = DefiniteSystem(self.assembler.indptr, self.assembler.indices, free)
        return self._systems[sides]

    def system(self, mp: MultiPatch, f: Load = None, g: Dirichlet = None) -> LinearSystem:
        """Stiffness, load and boundary values on a model.

        Parameters
        ----------
        mp : MultiPatch
            Same patches, knots and interfaces as the solver's.
        f, g : callable, optional
            As in :func:`poisson`.
        """
        f, g, _, _ = problem(mp, f, g, None, None)
        return self._system(mp, f, Conditions.of(mp, g, None, None))[0]

    def _system(
        self, mp: MultiPatch, f: ScalarFunction, given: Conditions
    ) -> tuple[LinearSystem, FloatArray, list[GeometryAt], list[SideNodes], list[Flux]]:
        """The system, its matrix without fluxes, and the geometry that it was integrated on."""
        self._check(mp)
        maps = geometry_at(mp, self.nodes)
        pure = self.assembler.values(GRADIENT, [stiffness(at) for at in maps])
        load = self.space.gather(
            [at.nodes.tested(at.dx * sampled(f, at.x, "right-hand side", f"patch {at.index}")) for at in maps]
        )
        every = sides_at(self.space, mp, self._boundary_nodes)
        sides = [side for side in every if (side.patch, side.side) in given.values]
        known = boundary_fit(self.space, sides, [given.values[side.patch, side.side] for side in sides])
        through = [
            Flux(side, *given.fluxes[side.patch, side.side])
            for side in every
            if (side.patch, side.side) in given.fluxes
        ]
        values = add_flux_matrix(pure, self.assembler.indptr, self.assembler.indices, self.space, through)
        system = LinearSystem(values, load + flux_load(self.space, through), known)
        return system, pure, maps, sides, through

    def matrix(self, system: LinearSystem) -> csc_array:
        """Stiffness matrix of all unknowns, both triangles."""
        return self.assembler.matrix(system.values)

    def solve(
        self,
        mp: MultiPatch,
        f: Load = None,
        g: Dirichlet = None,
        exact: ScalarFunction | None = None,
        gradient: VectorFunction | None = None,
        *,
        neumann: Neumann | None = None,
        robin: Robin | None = None,
    ) -> PoissonResult:
        """Solve on a model with the solver's patches, knots and interfaces; see :func:`poisson`."""
        f, g, exact, gradient = problem(mp, f, g, exact, gradient, bool(neumann or robin))
        clock = Clock(self._progress)
        with clock("assembly"):
            given = Conditions.of(mp, g, neumann, robin)
            data = given.values
            system, pure, maps, sides, through = self._system(mp, f, given)
        with clock("solve") as stage:
            free = self._unknowns_off(tuple(sorted(data)))
            u, residual = free.solve(system.values, system.load, system.known)
            stage.found = f"residual {residual:.1e}"
        field = Field(self.space, u)
        with clock("errors"):
            errors = None if exact is None else error_norms(field, mp, exact, gradient)
        adjoint = PoissonAdjoint(
            mp,
            self.space,
            u,
            partial(self.matrix, system),
            partial(self.assembler.matrix, pure),
            lambda w: free.solve(system.values, w, np.zeros(len(u)))[0],
            maps,
            sides,
            [data[side.patch, side.side] for side in sides],
            f,
            through,
        )
        return PoissonResult(field, mp, errors, residual, clock.seconds, exact, adjoint)

    def _check(self, mp: MultiPatch) -> None:
        same = len(mp) == len(self._knots) and mp.interfaces == self.space.interfaces
        if not same:
            raise InputError("the model has other patches or interfaces than the solver's; make a solver for it")
        for k, patch in enumerate(mp.patches):
            knots = zip(patch.knots, self._knots[k], strict=True)
            if patch.degrees != self._degrees[k] or not all(np.array_equal(a, b) for a, b in knots):
                raise InputError(f"patch {k} has another degree or other knots than the solver's; make a solver for it")


def poisson(
    mp: MultiPatch,
    f: Load = None,
    g: Dirichlet = None,
    degree: int | None = None,
    points: int | None = None,
    exact: ScalarFunction | None = None,
    gradient: VectorFunction | None = None,
    *,
    neumann: Neumann | None = None,
    robin: Robin | None = None,
    knots: str = "auto",
    quadrature: int | None = None,
    memory: float = MEMORY,
    progress: Progress | None = None,
) -> PoissonResult:
    """Solve −Δu = f with values, fluxes or both (Robin) on the sides of labels, by isogeometric analysis.

    Parameters
    ----------
    mp : MultiPatch
        An injective model, patches of any orientation, polynomial or rational.
    f : callable or float, optional
        Right-hand side ``f(x, y)`` of arrays; default that of the known solution sin(πx/L) sin(πy/L), with L = 1, the
        paper's, for models of about unit size, and the power of ten nearest to half the diameter for others.
    g : callable or float, or mapping of labels to these, optional
        Boundary values; default those of `exact`, zero without it. Of a mapping, the sides of every label of
        `mp.sides` that it names have values, and on the others the solution has no flux (∂u/∂n = 0). Where sides with
        values meet, these should agree.
    neumann : mapping of labels to callables or floats, optional
        Flux ∂u/∂n (n outwards) through the sides of labels. Where `g` is no mapping, it holds on the sides that are not
        named here or in `robin`.
    robin : mapping of labels to pairs (α, h), optional
        ``∂u/∂n + α u = h`` on the sides of labels, α >= 0: with h = α u_0 the exchange of heat with what has the
        temperature u_0.
    degree, points : int, optional
        The field's degree and control points per patch and direction; default the geometry's own space.
    exact : callable, optional
        Known solution, for errors; with neither f, g nor exact that of the default `f`.
    gradient : callable, optional
        ``gradient(x, y)`` gives (u_x, u_y) of the known solution, for the H¹ error.
    knots : {"auto", "uniform"}, default "auto"
        As in :class:`SplineSpace`; "uniform" is the paper's choice.
    quadrature : int, optional
        Gauss nodes per span and direction; default one more than the larger degree of field and geometry.
    memory : float, default 8
        GB that the solution may take, as estimated from the number of `points`.
    progress : callable, optional
        Told of stages, as in `patchtransfer.transfer`.

    Returns
    -------
    PoissonResult

    Raises
    ------
    InputError
        When the model is folded, when a callable raises or returns NaN or another shape (the message names patch and
        side), on a label that the model does not have, on a degree or number of points that does not exist, or too
        many points.

    Examples
    --------
    >>> from patchtransfer import examples, iga
    >>> source, _, _ = examples.load("star")
    >>> result = iga.poisson(source, degree=4, points=12)
    >>> result.dofs, result.errors.max < 2.5e-5
    (793, True)

    A bar that is warm at one end and cold at the other:

    >>> from patchtransfer import MultiPatch, Patch
    >>> bar = MultiPatch([Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 1]], [[4, 0], [4, 1]]])])
    >>> bar = bar.with_labels({"warm": [(0, "west")], "cold": [(0, "east")]})
    >>> u = iga.poisson(bar, f=0.0, g={"warm": 20.0, "cold": 0.0}).field
    >>> round(float(u.grid(0, [0.25], [0.5])[0, 0]), 9)
    15.0

    The cold end in air of 10 degrees instead, and the flux through it:

    >>> bent = iga.poisson(bar, f=0.0, g={"warm": 20.0}, robin={"cold": (0.25, 2.5)})
    >>> [round(float(u), 9) for u in bent([[0, 0.5], [2, 0.5], [4, 0.5]])]
    [20.0, 17.5, 15.0]
    """
    solver = PoissonSolver(mp, degree, points, knots=knots, quadrature=quadrature, memory=memory, progress=progress)
    result = solver.solve(mp, f, g, exact, gradient, neumann=neumann, robin=robin)
    return replace(result, timings={"setup": solver.setup_seconds, **result.timings})
