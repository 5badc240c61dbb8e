"""Stage 7, bounded distortion: remove the foldovers of a mesh map under boundary values and continuity rows.

Xu et al. 2023, §3.3.3, Eq. 13–18, after their references [9] (Zheng et al., foldover-free maps) and [16]
(Su et al., signed singular values).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..mesh.background_mesh import TriangleMesh
from ..mesh.harmonic import mesh_solver
from ..numeric.arrays import FloatArray
from ..progress import Budget

__all__ = ["BoundedDistortionResult", "remove_foldovers"]

#: Largest bound a face can get: beyond it the images are slivers that no spline can use.
LARGEST_K = 1e3


@dataclass(frozen=True, eq=False)
class BoundedDistortionResult:
    """Outcome of `remove_foldovers`.

    Attributes
    ----------
    points : (n, 2) array
        Images of the vertices. With flips left, those of the iteration that had the fewest.
    flips : list of int
        Number of faces with σ₂ ≤ 0: of the given map, then after every iteration.
    energy : list of float
        Σ area ‖J - H‖² at the same moments; falls as long as k stays the same.
    k_max, k_mean : list of float
        Largest and mean bound of the conformal distortion at the same moments.
    k : (m,) array
        Final bound of every face.
    iterations : int
        Number of local–global steps.
    converged : bool
        Whether `points` has no flips.
    """

    points: FloatArray
    flips: list[int]
    energy: list[float]
    k_max: list[float]
    k_mean: list[float]
    k: FloatArray
    iterations: int
    converged: bool


def remove_foldovers(
    mesh: TriangleMesh,
    u: ArrayLike,
    fixed: ArrayLike,
    null_space: Any = None,
    *,
    k0: float = 3.0,
    beta: float = 1.5,
    beta_growth: float = 1.1,
    max_iterations: int = 2000,
    stall: float = 1e-4,
    steps_per_bound: int = 200,
    budget: Budget | None = None,
) -> BoundedDistortionResult:
    """Find a map with 1 ≤ σ₁/σ₂ ≤ k_i on every face, raising k_i where that is not possible.

    Local–global steps minimise Σ area_i ‖J_i - H_i‖² over matrices H_i of bounded distortion and
    admissible maps (Eq. 18; the paper omits the area weights) until they stall or `steps_per_bound` are done. If
    faces are still flipped, k_i ← β k_i on the faces that violate their bound (Eq. 17), β grows, and the steps go
    on. Zero flips of the mesh map do not imply an injective spline.

    Parameters
    ----------
    mesh : TriangleMesh
        With n vertices and m faces.
    u : (n, 2) array
        Initial map. It must satisfy boundary values and constraints; only admissible displacements are added.
    fixed : (b,) ints
        Vertices that do not move; at least one in every connected component of the mesh.
    null_space : (n - b, n_z) sparse or dense array, optional
        Basis, of full column rank, of the displacements that the constraints leave to the other vertices (in
        increasing order); default all displacements.
    k0 : float
        First bound, greater than 1.
    beta, beta_growth : float
        First factor β of Eq. 17, greater than 1, and what it is multiplied by each time, at least 1.
    max_iterations : int
        Largest number of local–global steps.
    stall : float
        A step that lowers the energy by less than this fraction counts as a stall. Steps converge linearly:
        large values raise bounds too early and end with more flips.
    steps_per_bound : int
        Bounds are raised after this many steps even without a stall: too low bounds let the energy creep for
        thousands of steps, to no avail. Less than about 150 ends with more flips.
    budget : Budget, optional
        Its time limit ends the steps.

    Returns
    -------
    BoundedDistortionResult
        Flips that are left are reported there (`converged` is False), not raised.

    Raises
    ------
    InputError
        When shapes or parameters are wrong, a face of the mesh is inverted or a vertex is tied to no fixed
        one.
    """
    if not (
        1 < k0 <= LARGEST_K
        and beta > 1
        and beta_growth >= 1
        and max_iterations >= 0
        and stall >= 0
        and steps_per_bound > 0
    ):
        raise InputError(
            f"foldover removal needs 1 < k0 <= {LARGEST_K:g}, beta > 1, beta_growth >= 1, max_iterations "
            f">= 0, stall >= 0 and steps_per_bound > 0, got {k0}, {beta}, {beta_growth}, {max_iterations}, {stall}, "
            f"{steps_per_bound}"
        )
    points = np.array(u, float)
    if points.shape != mesh.points.shape or not np.isfinite(points).all():
        raise InputError(f"initial map: expected finite positions of shape {mesh.points.shape}, got {points.shape}")
    solver = mesh_solver(mesh, np.asarray(fixed, np.int64), null_space)
    k = np.full(len(mesh.triangles), float(k0))
    best, fewest = points, solver.flips(points)
    flips: list[int] = []
    energy: list[float] = []
    k_max: list[float] = []
    k_mean: list[float] = []
    iterations = 0
    budget = budget or Budget()
    while True:
        points, new_flips, new_energy = solver.iterate(
            points, k, min(steps_per_bound, max_iterations - iterations), stall, budget.seconds_left()
        )
        # The first entry is the map at hand, already recorded under the previous bounds.
        new = slice(1 if flips else 0, None)
        flips += new_flips[new]
        energy += new_energy[new]
        k_max += [float(k.max())] * len(new_flips[new])
        k_mean += [float(k.mean())] * len(new_flips[new])
        iterations += len(new_flips) - 1
        if new_flips[-1] < fewest:
            best, fewest = points, new_flips[-1]
        if new_flips[-1] == 0 or iterations >= max_iterations or budget.expired():
            break
        first, second = solver.singular_values(points).T
        raised = (first > k * second) & (k < LARGEST_K)
        if not raised.any():
            break
        k[raised] = np.minimum(beta * k[raised], LARGEST_K)
        beta *= beta_growth
    return BoundedDistortionResult(best, flips, energy, k_max, k_mean, k, iterations, fewest == 0)
