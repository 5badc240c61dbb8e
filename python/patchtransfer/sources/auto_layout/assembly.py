"""A layout by its connectivity and the places of its boundary vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...numeric.arrays import FloatArray, IntArray

__all__ = ["AbstractLayout"]


@dataclass(frozen=True, eq=False)
class AbstractLayout:
    """Conforming quads that may need curved sides.

    Attributes
    ----------
    quads : (m, 4) array of int
        Counter-clockwise.
    boundary_vertices : (b,) array of int
    boundary_loop : (b,) array of int
        The user's loop that each lies on.
    boundary_s : (b,) array
        Arc length there, on the user's own outline.
    corner : (b,) array of bool
        Whether the outline has a corner there.
    points : (n, 2) array
        Guess of every vertex's place.
    valence : (n,) array of int
        Number of quads at every vertex.
    """

    quads: IntArray
    boundary_vertices: IntArray
    boundary_loop: IntArray
    boundary_s: FloatArray
    corner: NDArray[np.bool_]
    points: FloatArray
    valence: IntArray
