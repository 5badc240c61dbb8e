"""Stage 5, initial map of the published method: a reversible harmonic map between two triangulated domains.

Xu et al. 2023, §3.3.2–3, after D. Ezuz, J. Solomon, M. Ben-Chen, *Reversible Harmonic Maps between Discrete
Surfaces*, ACM Transactions on Graphics 38(2), 2019. A map from mesh a to mesh b is a matrix P_ab of barycentric
coordinates, one row a vertex; X_ab ≈ P_ab V_b are the images as free unknowns, and likewise P_ba, X_ba. The energy

    α [D(X_ab) + D(X_ba)] + (1 - α) [‖P_ba X_ab - V_b‖² + ‖P_ab X_ba - V_a‖²]
        + β [‖X_ab - P_ab V_b‖² + ‖X_ba - P_ba V_a‖²] + λ mean over boundary points of ‖X_ab(p) - p_b‖²

is lowered by turns: X by two sparse solves, P by closest points on the other mesh in coordinates that stack a vertex
and its image. Norms are weighted by vertex areas, and both meshes are scaled to area 1 (D = ½ Xᵀ L X).

Why λ = ∞ stands for an exact boundary, of both maps: with any finite λ the Dirichlet energies draw the boundaries
inwards, by some α / λ, so that not even the identity is a minimum. With exact ones every affine map is: it is harmonic,
and what is left of the energy vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csc_array, csr_array

from ..errors import InputError
from ..mesh.background_mesh import TriangleMesh
from ..mesh.harmonic import mesh_harmonic_map
from ..numeric.arrays import FloatArray
from ..progress import Budget
from .vertex_system import Barycentric, VertexSystem

__all__ = ["DescentStep", "ReversibleMap", "barycentric_map", "reverse_boundary", "reversible_harmonic_map"]

#: Weight of the Dirichlet energies, and first coupling weight, of the 2019 paper.
ALPHA, BETA = 5e-4, 5e-3
#: β grows by its first value in each of this many iterations.
BETA_STEPS = 100


@dataclass(frozen=True)
class DescentStep:
    """One iteration: the energy with this iteration's β before it, after the solves, and after the closest points."""

    beta: float
    before: float
    after_solve: float
    after_closest: float


@dataclass(frozen=True, eq=False)
class ReversibleMap:
    """Outcome of `reversible_harmonic_map`.

    Attributes
    ----------
    points : (n_a, 2) array
        X_ab, the images of mesh a's vertices.
    reverse : (n_b, 2) array
        X_ba, the images of mesh b's vertices.
    forward_matrix, reverse_matrix : sparse arrays (n_a, n_b), (n_b, n_a)
        P_ab and P_ba: three barycentric coordinates a row.
    steps : tuple of DescentStep
    converged : bool
        Whether the images had come to rest.
    """

    points: FloatArray
    reverse: FloatArray
    forward_matrix: csr_array
    reverse_matrix: csr_array
    steps: tuple[DescentStep, ...]
    converged: bool


def reversible_harmonic_map(
    mesh_a: TriangleMesh,
    mesh_b: TriangleMesh,
    boundary_indices: ArrayLike,
    boundary_values: ArrayLike,
    start: ArrayLike,
    reverse_start: ArrayLike,
    *,
    null_space: Any = None,
    alpha: float = ALPHA,
    beta: float = BETA,
    weight: float = 1.0,
    max_iterations: int = 200,
    tolerance: float = 1e-4,
    budget: Budget | None = None,
) -> ReversibleMap:
    """Map mesh a to mesh b with little Dirichlet energy both ways, by block coordinate descent.

    Parameters
    ----------
    mesh_a, mesh_b : TriangleMesh
        With n_a and n_b vertices.
    boundary_indices : (k,) ints
    boundary_values : (k, 2) array
        Vertices of mesh a with wanted images; they are wanted softly, with weight λ.
    start : (n_a, 2) array
        First images of mesh a's vertices; they satisfy the constraints.
    reverse_start : (n_b, 2) array
        First images of mesh b's vertices.
    null_space : (n_a, m) sparse or dense array, optional
        Basis, of full column rank, of the displacements that the constraints B u = 0 leave; default all. A vertex
        whose row is empty keeps its start.
    alpha : float, default 5e-4
        Weight of the Dirichlet energies, between 0 and 1.
    beta : float, default 5e-3
        Coupling; iteration i uses ``beta * min(i, 100)``.
    weight : float, default 1
        λ; the papers leave it open. Infinite: the boundary is exact, and that of the reverse map stays at its start.
    max_iterations : int
    tolerance : float
        At rest when no image of mesh a's vertices moves further, in units of the square root of the target's area. With
        a finite λ, β must have stopped growing as well: until then it draws the boundary back outwards.
    budget : Budget, optional
        Its time limit ends the iterations after the first.

    Returns
    -------
    ReversibleMap

    Raises
    ------
    InputError
        When shapes or weights are wrong, a mesh has an inverted triangle or the solve is singular.
    """
    if not (0 <= alpha <= 1 and beta >= 0 and weight >= 0 and max_iterations >= 0 and tolerance >= 0):
        raise InputError(
            "reversible map: needs 0 <= alpha <= 1 and beta, weight, max_iterations, tolerance >= 0, got "
            f"{alpha}, {beta}, {weight}, {max_iterations}, {tolerance}"
        )
    descent = _Descent(mesh_a, mesh_b, boundary_indices, boundary_values, start, reverse_start, null_space, weight)
    descent.alpha = alpha
    growth = 0 if np.isinf(weight) or beta == 0 else BETA_STEPS
    steps: list[DescentStep] = []
    converged = False
    for iteration in range(1, max_iterations + 1):
        descent.beta = beta * min(iteration, BETA_STEPS)
        before, old = descent.energy(), descent.x_ab
        descent.solve()
        solved = descent.energy()
        descent.project()
        steps.append(DescentStep(descent.beta, before, solved, descent.energy()))
        moved = float(np.abs(descent.x_ab - old).max())
        converged = moved <= tolerance and iteration >= growth
        if converged or (budget is not None and budget.expired()):
            break
    return ReversibleMap(
        descent.x_ab / descent.scale_b,
        descent.x_ba / descent.scale_a,
        descent.p_ab.matrix(len(mesh_b.points)),
        descent.p_ba.matrix(len(mesh_a.points)),
        tuple(steps),
        converged,
    )


def reverse_boundary(mesh_a: TriangleMesh, mesh_b: TriangleMesh) -> FloatArray:
    """Start of the reverse map: polygon vertices back to where they came from, the rest harmonic.

    `mesh_b` is the `target_mesh` of the images of mesh a's loops, in the same order; its Steiner points on polygon
    edges take the same fraction of the source's edge. Returns (n_b, 2).
    """
    polygon = np.concatenate([mesh_a.points[loop] for loop in mesh_a.loops])
    offsets = np.concatenate([[0], np.cumsum([len(loop) for loop in mesh_a.loops])])
    indices, values = [], []
    for loop, (first, last) in zip(mesh_b.loops, pairwise(offsets.tolist()), strict=True):
        closed = np.append(loop, loop[0])
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(mesh_b.points[closed], axis=0), axis=1))])
        joints = np.append(np.flatnonzero(loop < len(polygon)), len(loop))
        if len(joints) != last - first + 1:
            raise InputError("reverse map: mesh b's loops are not the images of mesh a's")
        source = polygon[np.append(np.arange(first, last), first)]
        values.append(np.stack([np.interp(length[:-1], length[joints], source[:, c]) for c in (0, 1)], axis=1))
        indices.append(loop)
    return mesh_harmonic_map(mesh_b, np.concatenate(indices), np.concatenate(values))


def barycentric_map(queries: FloatArray, vertices: FloatArray, triangles: Any) -> csr_array:
    """Matrix P (m, n) of barycentric coordinates, so that P vertices are the mesh's points closest to `queries`.

    Both in stacked coordinates: arrays (m, 4) and (n, 4).
    """
    return Barycentric.closest(queries, vertices, triangles).matrix(len(vertices))


class _Descent:
    """The two blocks of unknowns, in coordinates scaled to unit areas, and the two ways to lower the energy."""

    alpha: float
    beta: float

    def __init__(
        self,
        mesh_a: TriangleMesh,
        mesh_b: TriangleMesh,
        boundary_indices: ArrayLike,
        boundary_values: ArrayLike,
        start: ArrayLike,
        reverse_start: ArrayLike,
        null_space: Any,
        weight: float = 1.0,
    ) -> None:
        n_a, n_b = len(mesh_a.points), len(mesh_b.points)
        self.scale_a, self.scale_b = (float(mesh.areas().sum()) ** -0.5 for mesh in (mesh_a, mesh_b))
        self.x_ab = _checked("start", start, n_a) * self.scale_b
        self.x_ba = _checked("reverse start", reverse_start, n_b) * self.scale_a
        self.boundary = np.asarray(boundary_indices, np.int64)
        self.wanted = _checked("boundary values", boundary_values, len(self.boundary)) * self.scale_b
        self.v_a, self.v_b = mesh_a.points * self.scale_a, mesh_b.points * self.scale_b
        self.triangles_a, self.triangles_b = mesh_a.triangles, mesh_b.triangles
        self.mass_a, self.mass_b = _vertex_areas(mesh_a) * self.scale_a**2, _vertex_areas(mesh_b) * self.scale_b**2
        basis = None if null_space is None else csr_array(csc_array(null_space))
        if basis is not None and basis.shape[0] != n_a:
            raise InputError(f"null space: expected {n_a} rows, one for each vertex, got {basis.shape[0]}")
        exact = np.isinf(weight)
        if exact:
            self.x_ab[self.boundary] = self.wanted
        fixed = [self.boundary, mesh_b.boundary] if exact else [self.boundary[:0]] * 2
        self.system_a = VertexSystem(mesh_a, fixed[0], basis)
        self.system_b = VertexSystem(mesh_b, fixed[1])
        self.pull = np.zeros(n_a)
        if not exact:
            self.pull[self.boundary] = weight / max(len(self.boundary), 1)
        # The first P are closest points of the given images alone.
        self.alpha, self.beta = 1.0, 1.0
        self.project()

    def energy(self) -> float:
        """The energy in the module's docstring."""

        def square(mass: FloatArray, difference: FloatArray) -> float:
            return float((mass * (difference**2).sum(axis=1)).sum())

        dirichlet = sum(
            0.5 * float(np.sum(x * (system.laplacian @ x)))
            for x, system in ((self.x_ab, self.system_a), (self.x_ba, self.system_b))
        )
        back = square(self.mass_b, self.p_ba.of(self.x_ab) - self.v_b) + square(
            self.mass_a, self.p_ab.of(self.x_ba) - self.v_a
        )
        coupling = square(self.mass_a, self.x_ab - self.p_ab.of(self.v_b)) + square(
            self.mass_b, self.x_ba - self.p_ba.of(self.v_a)
        )
        boundary = square(self.pull[self.boundary], self.x_ab[self.boundary] - self.wanted)
        return self.alpha * dirichlet + (1 - self.alpha) * back + self.beta * coupling + boundary

    def solve(self) -> None:
        """The best X for these P: two quadratic problems, X_ab under the constraints."""
        towards = np.zeros_like(self.v_a)
        towards[self.boundary] = self.pull[self.boundary, None] * self.wanted
        self.x_ab = self._best(
            self.system_a, self.x_ab, self.mass_a, self.mass_b, self.p_ab, self.p_ba, self.v_b, self.pull, towards
        )
        nothing = np.zeros_like(self.v_b)
        self.x_ba = self._best(
            self.system_b, self.x_ba, self.mass_b, self.mass_a, self.p_ba, self.p_ab, self.v_a, nothing[:, 0], nothing
        )

    def _best(
        self,
        system: VertexSystem,
        x: FloatArray,
        mass: FloatArray,
        other_mass: FloatArray,
        forward: Barycentric,
        reverse: Barycentric,
        other: FloatArray,
        pull: FloatArray,
        towards: FloatArray,
    ) -> FloatArray:
        """Where half the gradient of the energy in one of the X vanishes."""
        diagonal = self.beta * mass + pull
        half_gradient = (
            0.5 * self.alpha * (system.laplacian @ x)
            + (1 - self.alpha) * reverse.transposed(other_mass[:, None] * (reverse.of(x) - other), len(x))
            + diagonal[:, None] * x
            - self.beta * mass[:, None] * forward.of(other)
            - towards
        )
        try:
            system.factorize(0.5 * self.alpha, diagonal, reverse, (1 - self.alpha) * other_mass)
        except RuntimeError as error:
            why = f"reversible map: the solve is singular ({error}); give boundary points or weights"
            raise InputError(why) from None
        return x - system.solve(half_gradient)

    def project(self) -> None:
        """The best P for these X: closest points in stacked coordinates, row by row."""
        a, b = np.sqrt(1 - self.alpha), np.sqrt(self.beta)
        here_a, there_a = np.hstack([a * self.v_a, b * self.x_ab]), np.hstack([a * self.x_ba, b * self.v_b])
        here_b, there_b = np.hstack([a * self.v_b, b * self.x_ba]), np.hstack([a * self.x_ab, b * self.v_a])
        self.p_ab = Barycentric.closest(here_a, there_a, self.triangles_b)
        self.p_ba = Barycentric.closest(here_b, there_b, self.triangles_a)


def _vertex_areas(mesh: TriangleMesh) -> FloatArray:
    """A third of the area around every vertex."""
    areas = np.repeat(mesh.areas() / 3, 3)
    return np.asarray(np.bincount(mesh.triangles.ravel(), areas, len(mesh.points)), float)


def _checked(name: str, array: ArrayLike, n: int) -> FloatArray:
    values = np.asarray(array, float)
    if values.shape != (n, 2) or not np.isfinite(values).all():
        raise InputError(f"reversible map, {name}: expected finite values of shape ({n}, 2), got {values.shape}")
    return values
