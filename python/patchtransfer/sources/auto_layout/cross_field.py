"""The smoothest cross field along the outline, and its singularities.

A cross of angle θ is the complex number u = exp(4iθ). Along the outline it is given, at corners it turns by what the
wanted number of quads leaves over, and inside it is found by diffusion and normalisation in turns (Merriman, Bence,
Osher 1992; for crosses Viertel and Osting 2019) with unknowns on the edges (Beaufort et al. 2017). The index of an
inner vertex is the number of quarter turns of the cross around it, 4 less the valence of a layout there; k on the
outline is the number of quads. They obey Σ_inner (4 - valence) + Σ_outline (2 - k) = 4 χ with Euler's number χ of the
domain, and that is checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..._core import LayoutError, layout_field
from ...numeric.arrays import FloatArray, IntArray
from .mesh import LayoutMesh
from .reasons import NoLayoutError
from .symmetry import Isometry

__all__ = ["CrossField", "EdgeIsometry", "compute_cross_field", "isometry_on_edges"]


@dataclass(frozen=True, eq=False)
class CrossField:
    """A cross on every triangle.

    Attributes
    ----------
    theta : (m,) array
        Angle of one arm in radians.
    index : (N,) array of int
        At inner vertices 4 - valence: 0 where it is regular, 1 for valence 3, -1 for valence 5. On the outline the
        number of quads: 2 where it is smooth.
    """

    theta: FloatArray
    index: IntArray


@dataclass(frozen=True, eq=False)
class EdgeIsometry:
    """An isometry of the outline as it acts on crosses: (g u)(e) = phase · u(source[e]), or of the conjugate.

    Attributes
    ----------
    source : (e,) array of int
        For every edge of the mesh (`LayoutMesh.edges`) the one that the isometry moves there, or nearly there.
    phase : complex
        exp(4iω) for a rotation by ω, exp(8iβ) for a reflection in a line of direction β.
    conjugate : bool
        Whether it is a reflection.
    """

    source: IntArray
    phase: complex
    conjugate: bool


def isometry_on_edges(mesh: LayoutMesh, isometry: Isometry) -> EdgeIsometry:
    """Let an isometry of the outline act on the crosses of a mesh, which need not have the symmetry itself."""
    from scipy.spatial import cKDTree

    middle = mesh.points[mesh.edges].mean(axis=1)
    (a, b), (c, d) = isometry.matrix
    # The inverse of an orthogonal matrix is its transpose.
    x, y = (middle - isometry.centre).T
    origin = isometry.centre + np.column_stack([a * x + c * y, b * x + d * y])
    source = np.asarray(cKDTree(middle).query(origin)[1], np.int64)
    # Its first column is (cos ω, sin ω), or (cos 2β, sin 2β).
    return EdgeIsometry(source, complex(np.exp(4j * np.arctan2(c, a))), isometry.mirrors)


def compute_cross_field(mesh: LayoutMesh, isometries: Sequence[EdgeIsometry] = ()) -> CrossField:
    """Find a smooth cross field.

    Parameters
    ----------
    mesh : LayoutMesh
    isometries : sequence of EdgeIsometry
        The field is averaged over them in every step. With the identity they are a group.

    Returns
    -------
    CrossField

    Raises
    ------
    NoLayoutError
        When the crosses of neighbouring triangles do not add up to indices.
    """
    corners = np.flatnonzero(mesh.corner_valence)
    group = [
        (np.ascontiguousarray(g.source, np.int64), complex(g.phase).real, complex(g.phase).imag, bool(g.conjugate))
        for g in isometries
    ]
    try:
        theta, index = layout_field(mesh.points, mesh.triangles, corners, mesh.corner_valence[corners], group)
    except LayoutError as error:
        raise NoLayoutError("cross field", str(error)) from error
    theta.flags.writeable = index.flags.writeable = False
    return CrossField(theta, index)
