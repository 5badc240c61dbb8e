"""How boundary points follow the control points of the curves that they were fitted to, everything else held.

Every side is the least squares fit to points of the target. Where on the target these are, and which parameters of the
side belong to them, is frozen, and the fit is linear then.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..fitting.fit import SMOOTH_ANGLE
from ..geometry.basis import knot_spans
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.outline import Outline
from ..geometry.rational import rational_basis
from ..geometry.topology import BoundarySide, Topology
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.dense import least_squares, product

__all__ = ["OutlineMap"]

#: Samples per control point of a side: enough for the fit to be that of the curve.
SAMPLES = 6
#: Singular values of a side's basis at its samples are far above rounding.
RANK = 1e-12
#: Farther from the target than this part of the diameter, a boundary was not fitted to it: transfers miss by less.
AWAY = 0.05


class OutlineMap:
    """Linear map from the control points of target curves to boundary points; called with control points.

    A joint's point moves with the target's there, and where two sides meet smoothly the legs of both turn with the
    target's tangent, so that they stay on one line. The other points of a side are fitted.

    Attributes
    ----------
    control_points : (m, 2) array
        Of all curves, in the order of ``target.loops``, curve after curve: the last one of a curve is the first of the
        next once more, and both should move together.
    boundary : (n_b, 2) array
        The frozen boundary, which these control points give.
    matrix : (n_b, m) sparse array
        From motions of the control points to those of boundary points.
    """

    def __init__(self, topology: Topology, points: FloatArray, target: Boundary) -> None:
        from scipy.sparse import csr_array

        if not isinstance(target, Boundary):
            raise InputError(f"outline: target must be a Boundary (see read_boundary), got {type(target).__name__}")
        curves = [curve for loop in target.loops for curve in loop]
        self.control_points = np.concatenate([curve.control_points for curve in curves])
        self.boundary = points[topology.boundary_points]
        first = np.cumsum([0, *(len(curve.control_points) for curve in curves)])
        of_loops = np.cumsum([0, *(len(loop) for loop in target.loops)])
        feet = [_Feet(loop, first[a:b]) for loop, a, b in zip(target.loops, of_loops[:-1], of_loops[1:], strict=True)]
        diameter = float(np.hypot(*np.ptp(self.boundary, axis=0)))
        rows = np.zeros((len(self.boundary), len(self.control_points)))
        for k, loop in enumerate(topology.loops):
            at = np.concatenate([_side_points(side, topology, points, SAMPLES) for side in loop])
            distances = np.array([f.outline.nearest(at)[1].max() for f in feet])
            nearest = int(np.argmin(distances))
            if distances[nearest] > AWAY * diameter:
                raise InputError(
                    f"outline: boundary loop {k} is up to {distances[nearest]:.3g} away from every loop of the target; "
                    "give the target that the map was made for"
                )
            _fit_loop(rows, loop, topology, self.boundary, feet[nearest])
        self.matrix = csr_array(rows)

    def __repr__(self) -> str:
        return f"<OutlineMap: {self.matrix.shape[1]} control points to {self.matrix.shape[0]} boundary points>"

    def __call__(self, control_points: FloatArray) -> FloatArray:
        """Boundary points (n_b, 2) for control points (m, 2) of the target's curves."""
        given = np.asarray(control_points, float)
        if given.shape != self.control_points.shape:
            raise InputError(f"outline: expected control points {self.control_points.shape}, got {given.shape}")
        return np.asarray(self.boundary + self.matrix @ (given - self.control_points))

    def transpose(self, derivative: FloatArray) -> FloatArray:
        """Derivatives by the control points (m, 2) of a function with these by boundary points (n_b, 2), a `vjp`."""
        return np.asarray(self.matrix.T @ np.asarray(derivative, float))


class _Feet:
    """Points of a target loop as combinations of the control points of its curves."""

    def __init__(self, loop: Sequence[BSplineCurve], first: IntArray) -> None:
        self.outline = Outline(loop)
        self._first = first

    def rows(self, at: FloatArray, width: int) -> tuple[FloatArray, FloatArray]:
        """Weights of the control points in the feet of points (n, 2), and in derivatives by arc length there."""
        s, _ = self.outline.nearest(at)
        joints, curves = self.outline.joints, self.outline.curves
        values, slopes = (np.zeros((len(at), width)) for _ in range(2))
        # A foot on a joint is one of both curves' ends, each with half of the weight.
        near = 1e-9 * self.outline.length
        for k, curve in enumerate(curves):
            here = np.flatnonzero((s >= joints[k] - near) & (s <= joints[k + 1] + near))
            closing = np.flatnonzero(s <= near) if k == len(curves) - 1 else np.empty(0, int)
            opening = np.flatnonzero(s >= joints[-1] - near) if k == 0 else np.empty(0, int)
            where = np.concatenate([s[here], np.full(len(closing), joints[k + 1]), np.full(len(opening), joints[0])])
            index = np.concatenate([here, closing, opening])
            if not len(index):
                continue
            value, slope = _curve_rows(curve, self._parameters(k, where, at[index]))
            columns = self._first[k] + np.arange(value.shape[1])
            values[index[:, None], columns] += value
            slopes[index[:, None], columns] += slope
        share = values.sum(axis=1, keepdims=True)
        return values / share, slopes / share

    def _parameters(self, k: int, s: FloatArray, at: FloatArray) -> FloatArray:
        """Parameters of the feet of points on a curve: from arc lengths, corrected by Newton's method."""
        curve = self.outline.curves[k]
        t = np.interp(np.linspace(0, 1, 1025), [0, 1], curve.domain)
        found = np.interp(s, self.outline.arc_length(k, t), t)
        ends = (s <= self.outline.joints[k]) | (s >= self.outline.joints[k + 1])
        for _ in range(3):
            d = curve(found) - at
            slope, bend = curve(found, 1), curve(found, 2)
            curvature = (slope * slope + d * bend).sum(axis=1)
            still = ends | (curvature <= 0)
            step = np.where(still, 0.0, (d * slope).sum(axis=1) / np.where(still, 1.0, curvature))
            found = np.clip(found - step, *curve.domain)
        return found


def _curve_rows(curve: BSplineCurve, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Basis functions (n, m) of a curve with its weights, and their derivatives by arc length."""
    value, slope = rational_basis(curve.knots, curve.degree, curve.weights, t)
    return value, slope / np.hypot(*product(slope, curve.control_points).T)[:, None]


def _side_points(side: BoundarySide, topology: Topology, points: FloatArray, samples: int) -> FloatArray:
    return product(_basis(side, topology, samples)[0], points[side.side.of(topology.points[side.patch])])


def _basis(side: BoundarySide, topology: Topology, samples: int) -> tuple[FloatArray, FloatArray]:
    """Basis functions of a side at parameters even in every span, and these."""
    patch, axis = topology.patches[side.patch], side.side.axis
    knots, degree = patch.knots[axis], patch.degrees[axis]
    breaks = knot_spans(knots)
    inner = np.arange(samples * (len(breaks) - 1) + 1) / samples
    t = np.interp(inner, np.arange(len(breaks)), breaks)
    weights = None if patch.weights is None else side.side.of(patch.weights)
    return rational_basis(knots, degree, weights, t)[0], t


def _fit_loop(
    rows: FloatArray, loop: Sequence[BoundarySide], topology: Topology, points: FloatArray, feet: _Feet
) -> None:
    """Weights of the target's control points in the boundary points of a loop, written into `rows`."""
    width = rows.shape[1]
    numbers = topology.boundary_points
    along = [np.searchsorted(numbers, side.points(topology.points[side.patch])) for side in loop]
    joints = np.array([index[0] for index in along])
    rows[joints], slopes = feet.rows(points[joints], width)
    held: list[list[int]] = [[0, len(index) - 1] for index in along]
    for j in range(len(loop)):
        before, after = along[j - 1], along[j]
        # A side of three points has none of its own for both ends.
        if min(len(before), len(after)) < 4:
            continue
        legs = points[after[1]] - points[after[0]], points[before[-1]] - points[before[-2]]
        (ax, ay), (bx, by) = legs
        if abs(np.arctan2(bx * ay - by * ax, ax * bx + ay * by)) > SMOOTH_ANGLE:
            continue
        sense = 1.0 if (feet.outline.area > 0) == (_area(points, along) > 0) else -1.0
        rows[after[1]] = rows[after[0]] + sense * np.hypot(ax, ay) * slopes[j]
        rows[before[-2]] = rows[after[0]] - sense * np.hypot(bx, by) * slopes[j]
        held[j].append(1)
        held[j - 1].append(len(before) - 2)
    for side, index, fixed in zip(loop, along, held, strict=True):
        inner = np.setdiff1d(np.arange(len(index)), fixed)
        if not len(inner):
            continue
        basis, _ = _basis(side, topology, SAMPLES * topology.patches[side.patch].degrees[side.side.axis])
        basis = basis[:, ::-1] if side.reversed else basis
        wanted, _ = feet.rows(product(basis, points[index]), width)
        known = np.unique(fixed)
        rest = wanted - product(np.ascontiguousarray(basis[:, known]), rows[index[known]])
        rows[index[inner]] = least_squares(np.ascontiguousarray(basis[:, inner]), rest, RANK)


def _area(points: FloatArray, along: Sequence[IntArray]) -> float:
    """Signed area of a loop's control polygon."""
    x, y = (points[np.concatenate([index[:-1] for index in along])]).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
