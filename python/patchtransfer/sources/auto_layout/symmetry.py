"""Symmetries of an outline, and multi-patches that have them exactly.

A drawing that is its own mirror image should get patches that are. Which isometries map the outline to itself is found
by trial; which of them a layout shares is a matter of its connectivity; control points are then the mean of their
images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.curve import BSplineCurve
from ...geometry.multipatch import MultiPatch
from ...geometry.outline import Outline
from ...numeric.arrays import FloatArray, IntArray

__all__ = ["Isometry", "layout_symmetry", "outline_symmetries", "symmetrised"]

#: Largest distance of an outline from its image, relative to its diameter: drawings by hand are no more exact.
SAME = 4e-3
#: Distance up to which the nearest axis tried is worth refining.
NEARLY = 3e-2
#: Points on all loops that are compared, and of the finer polygon that they are compared with on every loop.
COMPARED, FINE = 1000, 4000
#: Radians to which an axis is found by trial, before steps of Newton's method square its error.
NEAR, NEWTON = 1e-5, 3
#: Sum of squared speeds of images, relative to that of distances, below which an outline is round.
FLAT = 1e-4
#: Points of a Gauss rule a knot span: polynomials of degree 20 are exact, arcs of 90° as rational curves to rounding.
GAUSS = 32
#: Highest order of a rotation that is looked for.
HIGHEST_ORDER = 12
#: Elements above which an outline is taken to be round: of infinitely many symmetries those of a square are kept.
ROUND = 30
#: Boundary vertices of patches that are nearer than this, relative to the diameter, to another's image are its image.
SAME_VERTEX = 2e-2


@dataclass(frozen=True, eq=False)
class Isometry:
    """A rotation or reflection of the plane about a point.

    Attributes
    ----------
    matrix : (2, 2) array
        Orthogonal.
    centre : (2,) array
    """

    matrix: FloatArray
    centre: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Images of points (..., 2)."""
        # Term by term: products of matrices may go to BLAS.
        x, y = points[..., 0] - self.centre[0], points[..., 1] - self.centre[1]
        m = self.matrix
        image = np.stack([m[0, 0] * x + m[0, 1] * y, m[1, 0] * x + m[1, 1] * y], axis=-1)
        return np.asarray(image + self.centre)

    @property
    def mirrors(self) -> bool:
        """Whether it is a reflection."""
        return bool(self.matrix[0, 0] * self.matrix[1, 1] - self.matrix[0, 1] * self.matrix[1, 0] < 0)


def outline_symmetries(outlines: Sequence[Outline]) -> list[Isometry]:
    """Isometries that map the loops to themselves, without the identity.

    Of a round outline, which has any number of them, those of a square.
    """
    from scipy.spatial import cKDTree

    total = sum(outline.length for outline in outlines)
    points = np.concatenate([o.polygon(max(50, round(COMPARED * o.length / total))) for o in outlines])
    fine = np.concatenate([outline.polygon(FINE) for outline in outlines])
    outer = max(outlines, key=lambda outline: abs(outline.area))
    centre, diameter = _centroid(outer.curves), outer.diameter
    tree = cKDTree(fine)

    def distance(matrix: FloatArray) -> float:
        return float(tree.query(Isometry(matrix, centre)(points))[0].max()) / diameter

    found = []
    angles = np.radians(np.arange(180.0))
    tried = np.array([distance(_reflection(angle)) for angle in angles])
    for k, angle in enumerate(angles):
        if tried[k] < NEARLY and tried[k] <= tried[k - 1] and tried[k] <= tried[(k + 1) % len(angles)]:
            step = np.radians(0.5)
            while step > NEAR:
                best = min((angle - step, angle, angle + step), key=lambda a: distance(_reflection(a)))
                step = step / 2 if best == angle else step
                angle = best
            angle = _sharpened(float(angle), centre, points, outlines)
            if distance(_reflection(angle)) < SAME:
                found.append(_reflection(angle))
    for order in range(HIGHEST_ORDER, 1, -1):
        if distance(_rotation(2 * np.pi / order)) < SAME:
            found += [_rotation(2 * np.pi * k / order) for k in range(1, order)]
            break
    if len(found) > ROUND:
        quarter = np.arange(1, 4) * np.pi / 2
        found = [_reflection(k * np.pi / 4) for k in range(4)] + [_rotation(angle) for angle in quarter]
    return [Isometry(matrix, centre) for matrix in found]


def layout_symmetry(
    quads: IntArray,
    on_boundary: IntArray,
    places: FloatArray,
    isometry: Isometry,
    diameter: float,
    near: float = SAME_VERTEX,
) -> IntArray | None:
    """The layout's symmetry that goes with an isometry of the outline.

    Parameters
    ----------
    quads : (m, 4) array of int
    on_boundary : (b,) array of int
        Boundary vertices.
    places : (b, 2) array
        Where they lie.
    isometry : Isometry
    diameter : float
        Of the outline.
    near : float
        Largest distance of a boundary vertex from the image of another, relative to the diameter, to be its image.

    Returns
    -------
    (n,) array of int or None
        Image of every vertex; None where the layout does not have the symmetry.
    """
    images = isometry(places)
    distance = np.hypot(*(images[:, None] - places[None]).transpose(2, 0, 1))
    nearest = distance.argmin(axis=1)
    if distance.min(axis=1).max() > near * diameter or len(np.unique(nearest)) < len(nearest):
        return None
    image = np.full(int(quads.max()) + 1, -1)
    image[on_boundary] = on_boundary[nearest]
    # Two neighbours on a quad and their images fix those of the whole quad, and so on inwards.
    turned = quads[:, ::-1] if isometry.mirrors else quads
    at = {(int(q[k]), int(q[(k + 1) % 4])): (q, k) for q in turned for k in range(4)}
    for _ in range(len(quads)):
        before = image.copy()
        for quad in quads:
            for k in range(4):
                a, b = image[quad[k]], image[quad[(k + 1) % 4]]
                if a < 0 or b < 0:
                    continue
                if (int(a), int(b)) not in at:
                    return None
                other, j = at[int(a), int(b)]
                for step in range(4):
                    v, w = quad[(k + step) % 4], other[(j + step) % 4]
                    if image[v] not in (-1, w):
                        return None
                    image[v] = w
        if np.array_equal(before, image):
            break
    return image if (image >= 0).all() and len(np.unique(image)) == len(image) else None


def symmetrised(multipatch: MultiPatch, quads: IntArray, group: Sequence[tuple[Isometry, IntArray]]) -> MultiPatch:
    """Control points as the mean of their images under all symmetries.

    Parameters
    ----------
    multipatch : MultiPatch
        A patch a quad, u along the first edge, the same knots in all directions.
    quads : (m, 4) array of int
    group : sequence of (Isometry, (n,) array of int)
        Symmetries with the images of the vertices, without the identity.
    """
    quad_of = {frozenset(quad.tolist()): k for k, quad in enumerate(quads)}
    sums = [patch.control_points.copy() for patch in multipatch.patches]
    for isometry, image in group:
        for quad, patch in zip(quads, multipatch.patches, strict=True):
            mapped = image[quad]
            target = quad_of[frozenset(mapped.tolist())]
            sums[target] += _turned(isometry(patch.control_points), mapped, quads[target])
    return multipatch.with_control_points([total / (len(group) + 1) for total in sums])


def _turned(net: FloatArray, corners: IntArray, wanted: IntArray) -> FloatArray:
    """A net whose corners come in the order wanted: (0, 0), (1, 0), (1, 1), (0, 1)."""
    for turns in range(4):
        for candidate, order in ((net, corners), (net.swapaxes(0, 1), corners[[0, 3, 2, 1]])):
            if np.array_equal(np.roll(order, turns), wanted):
                return np.asarray(np.rot90(candidate, turns))
    raise AssertionError("a symmetry maps quads to quads")


def _centroid(curves: Sequence[BSplineCurve]) -> FloatArray:
    """Of the area within a loop, to rounding: polygons of a symmetric loop's samples are not symmetric."""
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
    origin = curves[0].start
    area, moment = 0.0, np.zeros(2)
    for curve in curves:
        breaks = np.unique(curve.knots)
        half = np.diff(breaks)[:, None] / 2
        t = (breaks[:-1, None] + half * (nodes + 1)).ravel()
        (x, y), (dx, dy) = (curve(t) - origin).T, (half * weights).ravel() * curve(t, 1).T
        area += float((x * dy - y * dx).sum()) / 2
        moment += [(x * x * dy).sum() / 2, -(y * y * dx).sum() / 2]
    return np.asarray(origin + moment / area)


def _sharpened(angle: float, centre: FloatArray, points: FloatArray, outlines: Sequence[Outline]) -> float:
    """The angle of an axis to rounding, by Newton's method on the distances of images from the outline."""
    for _ in range(NEWTON):
        image = Isometry(_reflection(angle), centre)(points)
        found = [outline.nearest(image) for outline in outlines]
        nearest = np.argmin([distance for _, distance in found], axis=0)
        slope = miss = 0.0
        for k, outline in enumerate(outlines):
            at = nearest == k
            s = found[k][0][at]
            tangent, away, arm = outline.tangent(s), image[at] - outline.point(s), image[at] - centre
            # The image turns twice as fast as the axis.
            speed = 2 * (arm * tangent).sum(axis=1)
            gap = away[:, 1] * tangent[:, 0] - away[:, 0] * tangent[:, 1]
            slope += float((speed * speed).sum())
            miss += float((speed * gap).sum())
        # Circles have no axis that is better than others.
        if slope <= FLAT * float(((points - centre) ** 2).sum()):
            break
        angle -= miss / slope
    return angle


def _reflection(axis: float) -> FloatArray:
    return np.array([[np.cos(2 * axis), np.sin(2 * axis)], [np.sin(2 * axis), -np.cos(2 * axis)]])


def _rotation(angle: float) -> FloatArray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
