"""Stage 5, initial maps: harmonic maps with boundary values and continuity rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_array

from .._core import LocalGlobal
from ..errors import InputError
from ..numeric.arrays import FloatArray
from .background_mesh import TriangleMesh

__all__ = ["mesh_harmonic_map"]


def mesh_harmonic_map(
    mesh: TriangleMesh,
    boundary_indices: ArrayLike,
    boundary_values: ArrayLike,
    null_space: Any = None,
    particular: ArrayLike | None = None,
) -> FloatArray:
    """Minimise the Dirichlet energy of a piecewise linear map under boundary values and linear constraints.

    Xu et al. 2023, §3.3.2–3, Eq. 8–9. The paper asks for the boundary softly, by the term λ E_b, and
    alternates between the map and its reverse; here the boundary values are exact, as they are in its later
    stages. With exact values, and images inside the target, the alternation reduces to this single solve.

    Parameters
    ----------
    mesh : TriangleMesh
        M_a, with n vertices.
    boundary_indices : (b,) ints
        Vertices with given images; at least one in every connected component of the mesh.
    boundary_values : (b, 2) array
        These images.
    null_space : (n - b, n_z) sparse or dense array, optional
        Basis Z, of full column rank, of the displacements that the constraints B u = 0 leave to the other
        vertices (in increasing order); default all displacements.
    particular : (n - b, 2) array, optional
        Images of the other vertices that satisfy the constraints together with the boundary values; default
        0, which is right when the constraints do not touch the boundary.

    Returns
    -------
    (n, 2) array
        u = particular + Z z on the other vertices, with the least energy.

    Raises
    ------
    InputError
        When shapes do not agree, a triangle is inverted, or a vertex is tied to no boundary value.
    """
    indices, values = np.asarray(boundary_indices, np.int64), np.asarray(boundary_values, float)
    if values.shape != (len(indices), 2) or len(np.unique(indices)) != len(indices):
        raise InputError(f"boundary: expected {len(indices)} distinct vertices and as many values, got {values.shape}")
    solver = mesh_solver(mesh, indices, null_space)
    free = np.setdiff1d(np.arange(len(mesh.points)), indices)
    start = np.zeros((len(free), 2)) if particular is None else np.asarray(particular, float)
    if start.shape != (len(free), 2):
        raise InputError(f"particular solution: expected shape ({len(free)}, 2), got {start.shape}")
    u = np.empty((len(mesh.points), 2))
    u[indices], u[free] = values, start
    try:
        return solver.harmonic(u)
    except ValueError as error:
        raise InputError(f"harmonic map: {error}") from error


def mesh_solver(mesh: TriangleMesh, fixed: NDArray[np.int64], null_space: Any) -> LocalGlobal:
    """Factorize a mesh with fixed vertices once; `null_space` as in `mesh_harmonic_map`."""
    try:
        return LocalGlobal(mesh.points, mesh.triangles, fixed, null_space_arrays(null_space))
    except ValueError as error:
        raise InputError(f"mesh map cannot be solved for: {error}") from error


def null_space_arrays(null_space: Any) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64], Any] | None:
    """A basis in compressed sorted columns, as the core takes it."""
    if null_space is None:
        return None
    z = csc_array(null_space, copy=True)
    z.sum_duplicates()
    return z.data.astype(float), z.indices.astype(np.int64), z.indptr.astype(np.int64), z.shape
