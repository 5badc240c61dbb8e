"""Final step of the published method: least conformal distortion of a flip-free mesh map.

Xu et al. 2023, end of §3.3.3. Newton steps in Rust, on σ₁/σ₂ + σ₂/σ₁ weighted by area.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._core import DistortionDescent
from ..errors import InputError
from ..mesh.background_mesh import TriangleMesh
from ..mesh.harmonic import null_space_arrays
from ..numeric.arrays import FloatArray

__all__ = ["DistortionDescentResult", "minimise_distortion"]


@dataclass(frozen=True, eq=False)
class DistortionDescentResult:
    """Outcome of `minimise_distortion`.

    Attributes
    ----------
    points : (n, 2) array
        Images of the vertices.
    energy : list of float
        Mean over the area of σ₁/σ₂ + σ₂/σ₁, at least 2: of the given map, then after every step.
    stop : str
        "converged", "step limit", "time limit", "stalled" (rounding), or "flipped": a flipped map is returned as it is.
    """

    points: FloatArray
    energy: list[float]
    stop: str


def minimise_distortion(
    mesh: TriangleMesh,
    u: ArrayLike,
    fixed: ArrayLike,
    null_space: Any = None,
    *,
    max_steps: int = 100,
    tolerance: float = 1e-6,
    seconds: float | None = None,
) -> DistortionDescentResult:
    """Lower the mean conformal distortion of a map without ever flipping a face.

    Parameters
    ----------
    mesh : TriangleMesh
        With n vertices.
    u : (n, 2) array
        Map that satisfies boundary values and constraints; only admissible displacements are added.
    fixed : (b,) ints
        Vertices that do not move.
    null_space : (n - b, n_z) sparse or dense array, optional
        Basis, of full column rank, of the displacements that the constraints B u = 0 leave to the other vertices (in
        increasing order); default all.
    max_steps : int
    tolerance : float
        Ends when the squared Newton decrement is below this fraction of the energy.
    seconds : float, optional
        Limit, looked at before every step.

    Returns
    -------
    DistortionDescentResult

    Raises
    ------
    InputError
        When shapes are wrong or a face of the mesh is inverted.
    """
    if not (max_steps >= 0 and tolerance >= 0):
        raise InputError(f"distortion descent: needs max_steps and tolerance >= 0, got {max_steps}, {tolerance}")
    try:
        descent = DistortionDescent(
            mesh.points, mesh.triangles, np.asarray(fixed, np.int64), null_space_arrays(null_space)
        )
        points, energy, stop = descent.minimise(np.asarray(u, float), max_steps, tolerance, seconds)
    except ValueError as error:
        raise InputError(f"distortion descent: {error}") from error
    return DistortionDescentResult(points, energy, stop)
