"""How far apart things may be that are the same: by the model's size, its rounding, and the patches' thickness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..numeric.arrays import FloatArray, IntArray, distinct
from .patch import Patch
from .sides import Side

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

__all__ = [
    "COINCIDENCE",
    "OF_THICKNESS",
    "diameter",
    "exact",
    "point_tree",
    "scaled",
    "thickness",
    "thinnest",
    "tolerances",
]

#: Control points of one point may differ by this much, relative to the model's diameter: the last of six digits.
COINCIDENCE = 1e-5
#: ... and by this part of the thickness of the patches. A straight patch's own opposite sides are twice it apart.
OF_THICKNESS = 0.5
#: ... but always by this many units of roundoff of the largest coordinate: sides that were computed one by one.
ROUNDING_ULPS = 16.0
#: Equal in exact arithmetic, in the same units: insertion and elevation of the highest degrees leave half as much.
EXACT_ULPS = 128.0
#: Patch corners that are looked at around the end of a side: more than meet in any point of a valid model.
NEAREST_CORNERS = 64


def diameter(patches: Sequence[Patch]) -> float:
    """Diagonal of the control points' bounding box."""
    points = np.concatenate([patch.control_points.reshape(-1, 2) for patch in patches])
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def exact(patches: Sequence[Patch]) -> float:
    """Gap that remains between sides which are equal in exact arithmetic."""
    largest = max(float(np.abs(patch.control_points).max()) for patch in patches)
    return EXACT_ULPS * float(np.finfo(float).eps) * largest


def scaled(patches: Sequence[Patch]) -> tuple[list[FloatArray], float]:
    """Control points by a power of two of the largest coordinate: areas neither over- nor underflow."""
    size = max(float(np.abs(p.control_points).max()) for p in patches)
    # Kept off the ends of the range, where the power itself would overflow.
    unit = float(np.ldexp(1.0, int(np.clip(np.frexp(size)[1], -1000, 1000))))
    return [p.control_points / unit for p in patches], unit


def tolerances(nets: Sequence[FloatArray]) -> tuple[float, float]:
    """Largest gap by the model's diameter, and the gap that rounding of its coordinates explains."""
    points = np.concatenate([net.reshape(-1, 2) for net in nets])
    diameter = float(np.linalg.norm(np.ptp(points, axis=0)))
    rounding = ROUNDING_ULPS * float(np.finfo(float).eps) * float(np.abs(points).max())
    return COINCIDENCE * diameter, rounding


def thickness(net: FloatArray, rounding: float) -> float:
    """Area of a control net by its circumference, or the shortest side if that is less and no point.

    Moving a side by less than the former cannot take the area away, by less than the latter cannot turn the side.
    """
    a, b, c, d = net[:-1, :-1], net[1:, :-1], net[1:, 1:], net[:-1, 1:]
    area = 0.5 * float(sum(np.abs(_cross(q - p, r - p)).sum() for p, q, r in ((a, b, c), (a, c, d))))
    lengths = [float(np.hypot(*np.diff(side.of(net), axis=0).T).sum()) for side in Side]
    around = sum(lengths)
    if around == 0:
        return 0.0
    return min([area / around, *(length for length in lengths if length > rounding)])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def point_tree(points: FloatArray) -> cKDTree:
    """A tree of points (n, 2)."""
    # Only models without a list of interfaces need it, and it takes as long to load as to check them.
    from scipy.spatial import cKDTree

    return cKDTree(points)


def thinnest(tree: cKDTree, ends: FloatArray, radius: float, thick: FloatArray) -> float:
    """Smallest thickness of the patches with a corner, of four in the tree each, near one of the points."""
    nearest = min(NEAREST_CORNERS, tree.n)
    _, corners = tree.query(ends, nearest, p=np.inf, distance_upper_bound=radius)
    found: IntArray = distinct(np.asarray(corners, dtype=np.int64))
    return float(thick[found[found < tree.n] // 4].min())
