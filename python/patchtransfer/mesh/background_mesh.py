"""Stage 4, background meshes: triangulate the source's control points and the target's boundary.

Xu et al. 2023, §3.3.1. M_a is the constrained Delaunay triangulation (CDT) of all shared control points with
the boundary control polygons as constraints; M_b that of the target's boundary control polygons with Steiner
points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_array

from .._core import DEGENERATE_TRIANGLE, TriangulationError, cotan_laplacian, triangulate
from ..errors import InputError
from ..numeric.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from ..geometry.topology import Topology

__all__ = ["TriangleMesh", "source_mesh", "target_mesh"]


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A triangulated planar domain.

    Attributes
    ----------
    points : (n, 2) array
    triangles : (m, 3) int array
        Counter-clockwise. They tile the domain, unless `source_mesh` says otherwise.
    loops : tuple of int arrays
        Boundary vertices, loop by loop, the domain on the left.
    """

    points: FloatArray
    triangles: IntArray
    loops: tuple[IntArray, ...]

    @property
    def boundary(self) -> IntArray:
        """Sorted indices of the boundary vertices."""
        return np.unique(np.concatenate([np.empty(0, np.int64), *self.loops]))

    @property
    def interior(self) -> IntArray:
        """Sorted indices of the other vertices."""
        return np.setdiff1d(np.arange(len(self.points)), self.boundary)

    def areas(self) -> FloatArray:
        """Signed areas (m,)."""
        return _double_areas(self.points, self.triangles) / 2

    def laplacian(self) -> csc_array:
        """Cotan Laplacian L = Σ area GᵀG, (n, n).

        L_ij = -(cot α + cot β) / 2, so that ½ uᵀLu is the Dirichlet energy, which equals
        ¼ Σ_edges (cot α + cot β)(u_i - u_j)² (Eq. 9 with these weights, each edge counted once).

        Raises
        ------
        InputError
            When a triangle is inverted or degenerate.
        """
        try:
            data, indices, indptr, shape = cotan_laplacian(self.points, self.triangles)
        except ValueError as error:
            raise InputError(f"mesh without a Laplacian: {error}") from error
        return csc_array((data, indices, indptr), shape=shape)


def source_mesh(topology: Topology) -> tuple[TriangleMesh, list[str]]:
    """M_a: triangulate the shared control points of the source.

    The CDT need not exist: control points of a perfectly good patch may lie outside the boundary control
    polygon, and that polygon may cross itself. Then every cell of the control nets is split into two
    triangles instead. Some of those may be folded; they are turned counter-clockwise, so that a map preserves
    orientation on such a face if its image is folded as the source is. Triangles overlap there, hence the
    mesh's harmonic maps reproduce affine maps only approximately.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    mesh : TriangleMesh
        Vertex i is the shared control point i.
    warnings : list of str
        Empty, or why the control nets were split and where they are folded.
    """
    points = topology.coordinates
    loops = tuple(
        np.concatenate([side.points(topology.points[side.patch])[:-1] for side in loop]).astype(np.int64)
        for loop in topology.loops
    )
    try:
        _, triangles = triangulate(points, list(loops))
        flat = _degenerate(points, triangles)
        if not flat.any():
            return TriangleMesh(points, triangles, loops), []
        reason = f"triangle {triangles[np.argmax(flat)].tolist()} has no area"
    except TriangulationError as error:
        message, _, involved = error.args
        where = "; ".join(f"point {i} = {_place(points[i])}" for i in involved)
        reason = f"{message} ({where})" if where else message
    warnings = [
        f"the control points have no constrained Delaunay triangulation: {reason}; the control nets are "
        "split into triangles instead"
    ]
    triangles, cells = _split_nets(topology)
    double = _double_areas(points, triangles)
    folded = double < 0
    if folded.any():
        patch, i, j = cells[int(np.argmax(folded)) // 2]
        warnings.append(
            f"{np.count_nonzero(folded)} of {len(triangles)} triangles of the split control nets are folded, "
            f"first in cell ({i}, {j}) of patch {patch}; knot insertion into the source unfolds its net"
        )
        triangles[folded] = triangles[folded][:, ::-1]
    return TriangleMesh(points, triangles[~_degenerate(points, triangles)], loops), warnings


def target_mesh(loops: Sequence[ArrayLike], max_area: float | None = None, min_angle: float = 20.0) -> TriangleMesh:
    """M_b: triangulate a domain bounded by control polygons, with Steiner points.

    Parameters
    ----------
    loops : sequence of (n_i, 2) arrays
        Closed polygons (the last point is not the first again), the domain on the left: the outer one
        counter-clockwise, holes clockwise.
    max_area : float, optional
        Largest area of a triangle; default none.
    min_angle : float
        Smallest angle in degrees, at most 30; angles of the polygons themselves may be smaller.

    Returns
    -------
    TriangleMesh
        The polygons' points first, in their order, then Steiner points, on polygon edges as well.

    Raises
    ------
    InputError
        When polygons cross or touch, have the wrong sense, or the limits cannot be met.
    """
    if not 0 <= min_angle <= 30:
        raise InputError(f"min_angle must lie between 0 and 30 degrees, got {min_angle}")
    if max_area is not None and not max_area > 0:
        raise InputError(f"max_area must be positive, got {max_area}")
    polygons = [np.asarray(loop, float) for loop in loops]
    if not polygons or any(p.ndim != 2 or p.shape[1] != 2 for p in polygons):
        raise InputError("target mesh: expected at least one polygon, each of shape (n, 2)")
    offsets = np.concatenate([[0], np.cumsum([len(p) for p in polygons])])
    indices = [np.arange(a, b) for a, b in pairwise(offsets)]
    corners = np.concatenate(polygons)
    try:
        points, triangles = triangulate(corners, indices, min_angle, max_area)
    except TriangulationError as error:
        message, _, involved = error.args
        owner = np.searchsorted(offsets, involved, side="right") - 1
        where = "; ".join(
            f"point {i} = point {i - offsets[k]} of loop {k}, {_place(corners[i])}"
            for i, k in zip(involved, owner, strict=True)
        )
        raise InputError(
            f"target boundary's control polygons cannot be meshed: {message}{f' ({where})' if where else ''}"
        ) from error
    return TriangleMesh(points, triangles, _boundary_loops(triangles, offsets[:-1].tolist()))


def _boundary_loops(triangles: IntArray, starts: Sequence[int]) -> tuple[IntArray, ...]:
    """Chains of edges that belong to one triangle, from each of `starts`."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    twins = {(int(b), int(a)) for a, b in edges}
    following = {int(a): int(b) for a, b in edges if (int(a), int(b)) not in twins}
    loops = []
    for start in starts:
        loop = [start]
        while following[loop[-1]] != start:
            loop.append(following[loop[-1]])
        loops.append(np.array(loop, np.int64))
    return tuple(loops)


def _split_nets(topology: Topology) -> tuple[IntArray, list[tuple[int, int, int]]]:
    """Split cells along the diagonal whose smaller triangle is larger; also (patch, i, j) of the cells."""
    triangles, cells = [], []
    for k, net in enumerate(topology.points):
        corners = [net[:-1, :-1], net[1:, :-1], net[1:, 1:], net[:-1, 1:]]
        quads = np.stack([c.ravel() for c in corners], axis=1)
        if topology.orientation[k] < 0:
            quads = quads[:, ::-1]
        splits = np.array([quads[:, [[0, 1, 2], [0, 2, 3]]], quads[:, [[0, 1, 3], [1, 2, 3]]]])
        smaller = _double_areas(topology.coordinates, splits.reshape(-1, 3)).reshape(2, -1, 2).min(axis=2)
        triangles.append(splits[np.argmax(smaller, axis=0), np.arange(len(quads))].reshape(-1, 3))
        cells += [(k, i, j) for i in range(net.shape[0] - 1) for j in range(net.shape[1] - 1)]
    return np.concatenate(triangles).astype(np.int64), cells


def _double_areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    d, e = b - a, c - a
    return np.asarray(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])


def _degenerate(points: FloatArray, triangles: IntArray) -> NDArray[np.bool_]:
    corners = points[triangles]
    longest = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
    return np.asarray(_double_areas(points, triangles) <= 4 * DEGENERATE_TRIANGLE * longest)


def _place(point: FloatArray) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g})"
