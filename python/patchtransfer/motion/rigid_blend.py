"""As-rigid-as-possible blend of two control nets: rotations are blended as rotations.

After M. Alexa, D. Cohen-Or, D. Levin, *As-Rigid-As-Possible Shape Interpolation*, SIGGRAPH 2000: on every triangle the
map from one mesh to the other is split into a rotation and a symmetric stretch, both are blended, and the vertices
follow in the least-squares sense. Here from both ends, so that the blend is the same backwards.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from ..mesh.background_mesh import TriangleMesh
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.definite import DefiniteFactor

__all__ = ["RigidBlend", "Similarity"]


class Similarity:
    """The similarity x -> scale · R(angle) x + shift that takes corresponding points closest to each other.

    Centroids meet, spreads (root mean square distances from them) become equal, the rotation is the least-squares
    one: the similarity of b and a is the inverse. It can be taken to any fraction: scale^t, R(t angle), and a centroid
    that moves on a straight line.
    """

    def __init__(self, a: FloatArray, b: FloatArray) -> None:
        self._from, self._to = a.mean(axis=0), b.mean(axis=0)
        za, zb = _complex(a - self._from), _complex(b - self._to)
        self.scale = float(np.sqrt((abs(zb) ** 2).sum() / (abs(za) ** 2).sum()))
        self.angle = float(np.angle((za.conj() * zb).sum()))

    def apply(self, points: FloatArray, t: float) -> FloatArray:
        """The similarity taken to the fraction t (0: nothing, 1: all of it)."""
        z = _complex(points - self._from) * self.scale**t * np.exp(1j * t * self.angle)
        return np.asarray(_plane(z) + (1 - t) * self._from + t * self._to)

    def undo(self, points: FloatArray) -> FloatArray:
        """Points of b's place back at a's."""
        z = _complex(points - self._to) / self.scale * np.exp(-1j * self.angle)
        return np.asarray(_plane(z) + self._from)


class RigidBlend:
    """Blend between the vertices of a mesh and other positions of them.

    Parameters
    ----------
    mesh : TriangleMesh
        At one end; connected.
    positions : (n, 2) array
        Its vertices at the other end. Triangles may be folded there.
    """

    def __init__(self, mesh: TriangleMesh, positions: FloatArray) -> None:
        self._start, self._end = mesh.points, positions
        self._triangles = mesh.triangles
        corners = mesh.points[mesh.triangles]
        double = 2 * mesh.areas()
        opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        # Gradients of the hat functions, (m, 3, 2).
        self._gradients = np.stack([-opposite[..., 1], opposite[..., 0]], axis=2) / double[:, None, None]
        self._areas = double / 2
        jacobian = np.einsum("fic,fid->fcd", positions[mesh.triangles], self._gradients)
        rotation = _complex(
            np.stack([jacobian[:, 0, 0] + jacobian[:, 1, 1], jacobian[:, 1, 0] - jacobian[:, 0, 1]], axis=1)
        )
        self._angles = _continued(np.angle(rotation), mesh.triangles, self._areas)
        self._stretches = _turned(-self._angles) @ jacobian
        # One vertex is held; a shift does not matter.
        self._factor = DefiniteFactor(mesh.laplacian()[1:][:, 1:])

    def at(self, t: float) -> FloatArray:
        """Positions (n, 2) at the fraction t; those given at 0 and 1."""
        wanted = _turned(t * self._angles) @ ((1 - t) * np.eye(2) + t * self._stretches)
        load = np.einsum("f,fcd,fid->fic", self._areas, wanted, self._gradients)
        right = np.zeros_like(self._start)
        np.add.at(right, self._triangles.ravel(), load.reshape(-1, 2))
        x = np.zeros_like(right)
        x[1:] = self._factor.solve(right[1:])
        centre = (1 - t) * self._start.mean(axis=0) + t * self._end.mean(axis=0)
        return np.asarray(x - x.mean(axis=0) + centre)


def _continued(angles: FloatArray, triangles: IntArray, areas: FloatArray) -> FloatArray:
    """Angles moved by full turns so that neighbouring triangles differ least, their mean within half a turn."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, edge = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    face = np.tile(np.arange(len(triangles)), 3)
    order = np.argsort(edge.ravel(), kind="stable")
    twins = np.flatnonzero(edge.ravel()[order][1:] == edge.ravel()[order][:-1])
    i, j = face[order][twins], face[order][twins + 1]
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(len(triangles),) * 2).tocsr()
    found, before = breadth_first_order(graph, int(np.argmax(areas)), directed=False)
    out = angles.copy()
    for f in found[1:].tolist():
        out[f] += 2 * np.pi * np.round((out[before[f]] - out[f]) / (2 * np.pi))
    mean = float((areas * out).sum() / areas.sum())
    return np.asarray(out - 2 * np.pi * np.round(mean / (2 * np.pi)))


def _turned(angles: FloatArray) -> FloatArray:
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def _complex(points: FloatArray) -> np.ndarray:
    return np.asarray(points[:, 0] + 1j * points[:, 1])


def _plane(z: np.ndarray) -> FloatArray:
    return np.column_stack([z.real, z.imag])
