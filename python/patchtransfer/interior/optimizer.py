"""Stage 8, the spline optimiser: control points of low distortion with det J > 0 at all nodes.

Minimises the energy of Garanzha et al. 2021 (*Foldover-free maps in 50 lines of code*, doi:10.1145/3450626.3459847)
for the map from the source domain to the target, directly on the spline: ``A = J_target J_source^-1`` scaled to
mean determinant 1, sampled at 2p + 1 Gauss–Lobatto nodes a knot span (Gauss nodes alone miss folds at span ends).
The Newton iteration runs in Rust; this module chooses nodes, weights and continuation, one rung after the other,
until the certificate accepts the map. Beyond the paper, which optimises a triangle mesh of the control net.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from .._core import SplineOptimizer as CoreSplineOptimizer
from ..errors import InputError
from ..geometry.patch import Patch
from ..geometry.sides import CORNERS, around_corner
from ..geometry.topology import Topology
from ..numeric.arrays import FloatArray, distinct
from ..numeric.compressed import Compressed
from ..progress import Budget, Progress, reporter
from ..proof.certificate import Cell, Certificate

__all__ = [
    "Measure",
    "OptimizedMap",
    "Settled",
    "SplineOptimizer",
    "degenerate_corners",
    "optimize_with_ladder",
    "same_weights",
    "step_cost",
]


#: Default weight of the area term.
AREA_WEIGHT = 0.3
#: Relative Newton decrement at which a solution is taken ...
TOLERANCE = 1e-8
#: ... and one that only rows follow: speeds across interfaces come out within 1 %, and the finest space seldom has
#: to be solved for it.
ROUGH = 1e-4
#: Rounds of adding nodes where the certificate fails.
NODE_ROUNDS = 8
#: Nodes per degree, direction and knot span, less one.
NODES_PER_DEGREE = 2
#: Newton steps of a rung at most, and of a step of the continuation.
MAX_STEPS, CONTINUATION_STEPS = 200, 60
#: Nodes per degree of the rungs that follow, twice the plain optimiser's, and the area weight of the last of them.
MORE_NODES, LARGE_AREA_WEIGHT = 4, 1.0
#: First step of the continuation, a part of the way, and the step below which it gives up.
FIRST_STEP, SHORTEST_STEP = 0.25, 1e-3
#: What a node apart from the grid costs, over the product of its local functions' number, in nodes of the grid: there
#: is no tensor product to use. Measured for degrees 2 to 4.
EXTRA_NODE = 2.0
#: |sin| of a corner's angle below which it is 0 or 180 degrees but for rounding, and the source is singular there.
STRAIGHT = 1e-12


class Measure(NamedTuple):
    """What a map's distortion is measured with: nodes a degree, those added, and the weight of the area term."""

    nodes_per_degree: int
    extra_nodes: tuple[tuple[int, float, float], ...]
    area_weight: float


class Settled(NamedTuple):
    """A minimum to the last digits; see `SplineOptimizer.settle`.

    `gradient` (n_points, 2) is that of the energy at all points, `residual` the largest component that is left of it
    for the unknowns.
    """

    points: FloatArray
    energy: float
    gradient: FloatArray
    residual: float
    min_determinant: float


class SplineOptimizer:
    """A multi-patch prepared for harmonic maps and distortion minimisation; symbolic work is done once.

    Parameters
    ----------
    topology : Topology
        Gives patches, shared control points and the reference map (the source itself).
    reference : sequence of Patch, optional
        Map that distortion is measured against, patch by patch; default the topology's own patches.
    nodes_per_degree : int, default 2
        Nodes per knot span and direction are ``nodes_per_degree * degree + 1``.
    extra_nodes : sequence of (patch, u, v)
        Additional nodes.
    excluded_corners : sequence of (patch, corner)
        Patch corners left out of the energy because the map is degenerate there.
    null_space : Compressed, optional
        (n_interior, m) by columns, which span the displacements of the interior points
        (``topology.interior_points``) that keep the continuity rows; default all displacements.

    Attributes
    ----------
    step_cost : float
        Work of a Newton step for a `Budget`: nodes of the grid, and what the additional ones cost.
    """

    def __init__(
        self,
        topology: Topology,
        reference: Sequence[Patch] | None = None,
        *,
        nodes_per_degree: int = NODES_PER_DEGREE,
        extra_nodes: Sequence[tuple[int, float, float]] = (),
        excluded_corners: Sequence[tuple[int, int]] = (),
        null_space: Compressed | None = None,
    ) -> None:
        patches = topology.patches if reference is None else reference
        for k, pair in enumerate(zip(patches, topology.patches, strict=True)):
            if not same_weights(*pair):
                raise InputError(f"reference: patch {k} has other weights than the source's, which maps keep")
        extra_nodes = [node for node in extra_nodes if _corner_of(patches, node) not in excluded_corners]
        self._nodes = nodes_per_degree, tuple(extra_nodes)
        self.step_cost = step_cost(patches, nodes_per_degree, extra_nodes)
        triplets = None
        if null_space is not None:
            m = null_space.shape[1]
            columns = np.repeat(np.arange(m), np.diff(null_space.indptr))
            triplets = (np.asarray(null_space.indices, np.int64), columns, null_space.data, m)
        try:
            self._core = CoreSplineOptimizer(
                [patch.to_core() for patch in patches],
                [np.ascontiguousarray(points.ravel()) for points in topology.points],
                topology.n_points,
                topology.interior_points.tolist(),
                nodes_per_degree,
                list(extra_nodes),
                list(excluded_corners),
                triplets,
            )
        except RuntimeError as error:
            raise InputError(f"the source cannot be optimised on: {error}") from None

    def set_basis(self, null_space: Compressed) -> None:
        """Another null-space basis with entries at the same places; symbolic work is kept."""
        self._core.set_basis(null_space.data)

    def harmonic(self, points: FloatArray) -> FloatArray:
        """Spline harmonic map (Galerkin on the reference) with the boundary points of `points`."""
        return self._core.harmonic(points)

    def minimum_determinant(self, points: FloatArray) -> float:
        """Smallest det A over the nodes, relative to the mean."""
        return self._core.determinants(points)[0]

    def gradient(self, points: FloatArray, area_weight: float = AREA_WEIGHT) -> tuple[float, FloatArray]:
        """Energy of a fold-free map and its gradient (n_points, 2), boundary points included, at fixed scale."""
        return self._core.gradient(points, area_weight)

    def linearise(self, points: FloatArray, area_weight: float = AREA_WEIGHT, scale: float | None = None) -> bool:
        """Factorize the Hessian over the unknowns at a fold-free map, for `respond`, `product` and `motions`.

        They hold until the next `minimise` or `set_basis`. False where the exact Hessian is not positive definite, so
        that `points` is no strict minimum: its positive semidefinite part is taken then. `scale` as in `minimise`.
        """
        try:
            self._core.linearise(points, area_weight, scale=scale)
        except RuntimeError:
            self._core.linearise(points, area_weight, exact=False, scale=scale)
            return False
        return True

    def settle(self, corrections: int) -> Settled:
        """Correct the linearised map by ``x -= respond(gradient)`` while the gradient falls and no fold appears.

        Products are at the corrected map from now on, responses by the factorization as it is.
        """
        return Settled(*self._core.settle(corrections))

    def look_from(self, points: FloatArray) -> None:
        """Take products at `points` from now on, responses by the factorization as it is. Needs `linearise`."""
        self._core.look_from(points)

    def respond(self, forces: FloatArray) -> FloatArray:
        """``Z (Zᵀ H Z)⁻¹ Zᵀ q`` for forces (..., n_points, 2); fixed points stay. Needs `linearise`."""
        return _each(self._core.respond, forces)

    def product(self, directions: FloatArray) -> FloatArray:
        """The exact Hessian over all points, fixed ones too, at fixed scale times directions (..., n_points, 2)."""
        return _each(self._core.product, directions)

    def motions(self, begins: Sequence[FloatArray]) -> tuple[list[FloatArray], FloatArray, FloatArray]:
        """How the inside follows motions of the boundary, and the energy along them. Needs `linearise`.

        Parameters
        ----------
        begins : sequence of (n_points, 2) arrays
            Motions of the boundary points; the others do not move.

        Returns
        -------
        fields : list of (n_points, 2) arrays
            The motions with the inside in equilibrium to first order (implicit function theorem).
        slopes : (k,) array
            Slopes of the energy along them.
        hessian : (k, k) array
            Second derivatives of the least energy: the Schur complement of the Hessian on the motions.
        """
        return self._core.motions(list(begins))

    def minimise(
        self,
        points: FloatArray,
        area_weight: float = AREA_WEIGHT,
        max_steps: int = MAX_STEPS,
        progress: Callable[[int, float, float], None] | None = None,
        tolerance: float = TOLERANCE,
        seconds: float | None = None,
        scale: float | None = None,
        power: int = 1,
    ) -> OptimizedMap:
        """Minimise the distortion energy from `points` (n_points, 2); boundary points stay.

        Stops where a Newton step would lower the energy by less than the fraction `tolerance`; with `ROUGH` from a
        smooth start (a harmonic map) already in coarser spaces where the last of them gained no more than that.
        Ctrl-C and the limit of `seconds` are honoured between Newton steps. All Jacobians are multiplied by `scale`, by
        default that which gives `points` the mean determinant 1. With a `power` p the density of the energy, relative
        to its least value, is raised to it: for large p the minimum is that of the largest distortion.
        """
        out = self._core.minimise(points, area_weight, max_steps, tolerance, progress, seconds, scale, power)
        return OptimizedMap(*out, Measure(*self._nodes, area_weight))


def _corner_of(patches: Sequence[Patch], node: tuple[int, float, float]) -> tuple[int, int] | None:
    """The corner (patch, corner) that an additional node lies on, if any."""
    k, *at = node
    for corner, ends in enumerate(CORNERS):
        if all(t == knots[end] for t, knots, end in zip(at, patches[k].knots, ends, strict=True)):
            return k, corner
    return None


def same_weights(a: Patch, b: Patch) -> bool:
    """Whether two patches have the same weights, to the bit."""
    if a.weights is None or b.weights is None:
        return a.weights is b.weights
    return np.array_equal(a.weights, b.weights)


def _each(function: Callable[[list[FloatArray]], list[FloatArray]], fields: FloatArray) -> FloatArray:
    """A function of many fields (n_points, 2) for an array of them."""
    return np.reshape(function(list(fields.reshape(-1, *fields.shape[-2:]))), fields.shape)


@dataclass(frozen=True)
class OptimizedMap:
    """Outcome of the optimiser.

    Attributes
    ----------
    points : (n_points, 2) array
        Shared control points.
    energy : float
        Weighted mean of the distortion; 2 + 2 λ is the least possible (an isometry up to scale).
    min_determinant : float
        Smallest det A at a node, relative to the mean; positive when no node is folded.
    history : (steps, 4) array
        Energy, smallest determinant, regularisation ε and relative Newton decrement before every step.
    stop : str
        "converged", "stalled", "step limit" or "time limit".
    measure : Measure
        What the energy is measured with.
    """

    points: FloatArray
    energy: float
    min_determinant: float
    history: FloatArray
    stop: str
    measure: Measure


def degenerate_corners(patches: Sequence[Patch]) -> list[tuple[int, int]]:
    """Patch corners (patch, corner) where the control polygons meet at 0 or 180 degrees within rounding."""
    found = []
    for k, patch in enumerate(patches):
        for corner in range(4):
            apex, along_u, along_v = around_corner(patch.control_points, corner)
            u, v = along_u - apex, along_v - apex
            if abs(u[0] * v[1] - u[1] * v[0]) <= STRAIGHT * float(np.hypot(*u) * np.hypot(*v)):
                found.append((k, corner))
    return found


class Certify(Protocol):
    """Proof of injectivity for shared control points."""

    def __call__(self, points: FloatArray) -> Certificate: ...


def optimize_with_ladder(
    make: Callable[..., SplineOptimizer],
    start: FloatArray,
    certify: Certify,
    *,
    source: FloatArray,
    boundary: NDArray[np.int64],
    progress: Progress | None = None,
    project: Callable[[FloatArray], FloatArray] | None = None,
    budget: Budget | None = None,
) -> tuple[OptimizedMap, Certificate, list[str]]:
    """Optimise until the certificate accepts the map, trying harder rung by rung.

    The rungs: the plain optimiser; nodes added where the certificate failed; more nodes per span; a larger area
    weight; continuation of the boundary from the source's to the target's.

    Parameters
    ----------
    make : callable
        ``make(nodes_per_degree=..., extra_nodes=...)`` gives an optimizer.
    start : (n_points, 2) array
        Target boundary, any interior.
    certify : callable
        Shared control points to certificate.
    source : (n_points, 2) array
        The source's shared control points, start of the continuation.
    boundary : int array
        Indices of the boundary points.
    progress : callable, optional
    project : callable, optional
        Under continuity rows: takes a map to one that satisfies them. `start` is a good map then, not only a boundary.
    budget : Budget, optional
        Ends the ladder when it is used up; the first rung has `Budget.first_steps`. Default unlimited.

    Returns
    -------
    OptimizedMap, Certificate, list of str
        The certified map or the best one found, its certificate, and what each rung gave.
    """
    ladder = _Ladder(certify, progress, budget or Budget())
    optimizer = make()
    first = optimizer.harmonic(start) if project is None else start
    steps = ladder.budget.first_steps(optimizer.step_cost, MAX_STEPS)
    over = ladder.attempt("optimise", optimizer, first, max_steps=steps)
    if not over and ladder.budget.expired():
        over = ladder.stop()
    extra: list[tuple[int, float, float]] = []
    over = over or ladder.add_nodes(make, extra)
    if not over:
        optimizer = make(nodes_per_degree=MORE_NODES, extra_nodes=extra)
        for rung, weight in (("twice the nodes", AREA_WEIGHT), ("area weight 1", LARGE_AREA_WEIGHT)):
            over = over or ladder.attempt(rung, optimizer, ladder.best[0].points, weight)
    if not over:
        project = project or (lambda points: points)
        continued = _continue_boundary(optimizer, source, start, boundary, project, ladder.budget)
        if not ladder.budget.steps(optimizer.step_cost, MAX_STEPS):
            ladder.stop()
        elif continued is None:
            ladder.log.append("continuation: no fold-free path from the source's boundary was found")
        else:
            ladder.attempt("continuation", optimizer, continued)
    return *ladder.best, ladder.log


class _Ladder:
    """Attempts at a certified map, and what each gave."""

    def __init__(self, certify: Certify, progress: Progress | None, budget: Budget) -> None:
        self.certify, self.progress, self.budget = certify, progress, budget
        self.log: list[str] = []
        self.outcomes: list[tuple[OptimizedMap, Certificate]] = []

    @property
    def best(self) -> tuple[OptimizedMap, Certificate]:
        """The certified map, or that which came nearest."""
        return max(self.outcomes, key=lambda outcome: _rank(outcome[1], outcome[0]))

    def attempt(
        self,
        rung: str,
        optimizer: SplineOptimizer,
        points: FloatArray,
        weight: float = AREA_WEIGHT,
        max_steps: int | None = None,
    ) -> bool:
        """Optimise from `points`, by default in as many steps as the budget has; True if that ends the search."""
        steps = self.budget.steps(optimizer.step_cost, MAX_STEPS) if max_steps is None else max_steps
        if not steps:
            return self.stop()
        report = reporter(self.progress, rung)
        found = optimizer.minimise(points, weight, steps, report, seconds=self.budget.seconds_left())
        self.budget.spend(len(found.history) * optimizer.step_cost)
        certificate = self.certify(found.points)
        self.log.append(
            f"{rung}: {len(found.history)} Newton steps, {found.stop}, smallest determinant "
            f"{found.min_determinant:.3g}, {certificate.status}"
        )
        self.outcomes.append((found, certificate))
        return certificate.injective

    def add_nodes(self, make: Callable[..., SplineOptimizer], extra: list[tuple[int, float, float]]) -> bool:
        """Attempts with nodes where the proof failed, which are added to `extra`; True if one ends the search."""
        for _ in range(NODE_ROUNDS):
            found, certificate = self.outcomes[-1]
            new = sorted(set(_nodes_of(certificate.cells)) - set(extra))
            if found.min_determinant <= 0 or not new:
                return False
            extra += new
            if self.attempt("nodes added where the proof failed", make(extra_nodes=extra), found.points):
                return True
        return False

    def stop(self) -> bool:
        """End the search for want of budget."""
        self.log.append(self.budget.reason())
        return True


def step_cost(
    patches: Sequence[Patch], nodes_per_degree: int = 2, extra_nodes: Sequence[tuple[int, float, float]] = ()
) -> float:
    """Work of a Newton step in nodes of the grid, extra ones counted for what they cost."""
    cost = 0.0
    for patch in patches:
        spans = [len(distinct(knots)) - 1 for knots in patch.knots]
        cost += math.prod(n * (nodes_per_degree * p + 1) for n, p in zip(spans, patch.degrees, strict=True))
    local = [EXTRA_NODE * (patch.degrees[0] + 1) * (patch.degrees[1] + 1) for patch in patches]
    return cost + sum(local[node[0]] for node in extra_nodes)


def _nodes_of(cells: Sequence[Cell]) -> Iterator[tuple[int, float, float]]:
    """The worst point of every failing cell and a few around it: a single node only moves the fold aside."""
    for cell in cells:
        if cell.kind != "degenerate":
            u0, u1, v0, v1 = cell.bounds
            yield cell.patch, *cell.point
            for u in (u0, (u0 + u1) / 2, u1):
                for v in (v0, (v0 + v1) / 2, v1):
                    yield cell.patch, u, v


def _rank(certificate: Certificate, found: OptimizedMap) -> tuple[bool, bool, float]:
    return certificate.injective, certificate.status == "undecided", found.min_determinant


def _continue_boundary(
    optimizer: SplineOptimizer,
    source: FloatArray,
    target: FloatArray,
    boundary: NDArray[np.int64],
    project: Callable[[FloatArray], FloatArray],
    budget: Budget | None = None,
) -> FloatArray | None:
    """Move the boundary from the source's (after a similarity) to the target's in adaptive steps, fold-free.

    Every step starts from the previous map moved by a harmonic displacement; None when the step gets too small, or the
    budget is used up.
    """
    budget = budget or Budget()
    a, b = source[boundary], target[boundary]
    za, zb = (x[:, 0] + 1j * x[:, 1] for x in (a - a.mean(axis=0), b - b.mean(axis=0)))
    w = (za.conj() * zb).sum() / (abs(za) ** 2).sum()
    z = (source[:, 0] - a[:, 0].mean() + 1j * (source[:, 1] - a[:, 1].mean())) * w
    points = project(np.column_stack([z.real, z.imag]) + b.mean(axis=0))
    begin, at, step = points[boundary].copy(), 0.0, FIRST_STEP
    while at < 1.0:
        max_steps = budget.steps(optimizer.step_cost, CONTINUATION_STEPS)
        if not max_steps:
            return None
        step = min(step, 1.0 - at)
        moved = points.copy()
        moved[boundary] = (1 - at - step) * begin + (at + step) * b
        # The harmonic correction is linear in the boundary: it moves the interior along smoothly.
        shift = np.zeros_like(points)
        shift[boundary] = moved[boundary] - points[boundary]
        near = points + optimizer.harmonic(project(shift))
        trial = optimizer.minimise(near, max_steps=max_steps, seconds=budget.seconds_left())
        budget.spend(len(trial.history) * optimizer.step_cost)
        if trial.min_determinant > 0:
            points, at, step = trial.points, at + step, 2 * step
        else:
            step /= 2
            if step < SHORTEST_STEP:
                return None
    points[boundary] = b
    return project(np.asarray(points))
