"""A map of the domain whose isolines follow the cross field.

The crosses are scaled by exp(φ), where φ solves Δφ = curvature: with indices as the curvature of points, the map is
nearly conformal and needs no sizes (Jezdimirović et al. 2021). The mesh is cut open along paths between singularities,
holes and the outline. The map fits the scaled crosses in the least-squares sense; across the cut it is continuous up to
a quarter turn and a translation, and along the outline one coordinate is constant between corners (Bommes et al. 2009,
without the integers). These constraints hold exactly. Where the map folds, its weights are raised and it is solved anew
("stiffening", ibid.).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..._core import LayoutError, layout_map
from ...numeric.arrays import FloatArray, IntArray
from .cross_field import CrossField
from .mesh import LayoutMesh
from .reasons import NoLayoutError

__all__ = ["SeamlessMap", "compute_seamless_map"]

#: Rounds of stiffening. Where a map without folds exists, a few do.
ROUNDS = 12


@dataclass(frozen=True, eq=False)
class SeamlessMap:
    """Coordinates (u, v) on every triangle.

    Attributes
    ----------
    uv : (m, 3, 2) array
        Images of the corners. Together the images have about the domain's area.
    rotation : (m, 3) array of int
        Quarter turns r, 0 to 3, to the neighbour across edge i (opposite vertex i): ``uv_neighbour = R**r uv + t``.
    seam : (m, 3) array of bool
        Whether the cut runs along edge i.
    folds : int
        Triangles whose image is not counter-clockwise. Some remain where no map of these indices exists; a T-mesh may
        be correct nevertheless.
    residual : float
        Largest violation of a constraint, in parts of the image's diameter: rounding.
    rounds : int
        Rounds of stiffening.
    """

    uv: FloatArray
    rotation: IntArray
    seam: NDArray[np.bool_]
    folds: int
    residual: float
    rounds: int


def compute_seamless_map(mesh: LayoutMesh, field: CrossField, rounds: int = ROUNDS) -> SeamlessMap:
    """Integrate a cross field.

    Parameters
    ----------
    mesh : LayoutMesh
    field : CrossField
    rounds : int
        Most rounds of stiffening.

    Returns
    -------
    SeamlessMap

    Raises
    ------
    NoLayoutError
        When the constraints leave nothing but a degenerate map.
    """
    try:
        uv, rotation, seam, folds, residual, used = layout_map(
            mesh.points, mesh.triangles, field.theta, field.index, rounds
        )
    except LayoutError as error:
        raise NoLayoutError("seamless map", str(error)) from error
    uv.flags.writeable = rotation.flags.writeable = seam.flags.writeable = False
    return SeamlessMap(uv, rotation, seam, folds, residual, used)
