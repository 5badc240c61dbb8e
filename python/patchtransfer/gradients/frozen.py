"""The map from boundary points to all points with everything else held: smooth, with an exact derivative.

A transfer decides many things on the way: what corresponds, which continuity rows hold, at which corners they are
released, which corners and nodes the energy counts. These decisions jump, so a transfer has no derivative. Frozen, they
leave a minimisation whose minimum depends smoothly on the boundary. See ``docs/gradients.md``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..continuity.null_space import RowSpace
from ..errors import InfeasibleTargetError, InputError, TransferError
from ..geometry.boundary import Boundary
from ..geometry.straight_corners import corner_triangles, straighten
from ..interior.optimizer import AREA_WEIGHT, NODES_PER_DEGREE, Measure, SplineOptimizer, optimize_with_ladder
from ..interior.solver import FAR, InteriorSolver
from ..numeric.arrays import FloatArray, IntArray
from ..proof.certificate import certify, check_boundary
from ..proof.feasibility import check_corners, check_report
from .filled import Filled
from .inner_product import InnerProduct
from .outline_map import OutlineMap
from .problem import Problem

__all__ = ["Frozen", "freeze"]

#: Corrections at most after Newton's iteration; the second reaches rounding nearly always.
CORRECTIONS = 4
#: Newton steps from the frozen map, few of which are needed where it is near, and from the harmonic map.
STEPS, MORE_STEPS = 60, 200
#: With points that are held: who moves them by hand takes small steps, which need ten at most, and waits for no others.
PINNED_STEPS = 25


class Frozen:
    """A parameterization as a smooth function of its boundary; see `TransferPlan.freeze` and `TransferResult.freeze`.

    Continuity rows, released ends, excluded corners and the energy's nodes are constants. A map is a function of its
    boundary alone: filling changes nothing, and gives the same bits in any order and for any number of threads.

    Attributes
    ----------
    source : MultiPatch
        Whose patches are filled.
    points : (n_points, 2) array
        The certified map that was frozen.
    boundary_points : (n_b,) int array
        Which of them are on the boundary: ``source.topology.boundary_points``.
    excluded : tuple of (patch, corner)
        Corners left out of the energy because the target is straight there.
    """

    def __init__(
        self,
        problem: Problem,
        points: FloatArray,
        straight: Sequence[tuple[int, int]],
    ) -> None:
        self._problem, self.points = problem, points
        self._unpinned, self.excluded = problem, tuple(straight)
        self.source, self.boundary_points = problem.source, problem.boundary_points
        self._triangles = corner_triangles(self.source.topology, straight)
        on = self.boundary
        centre, self._diameter = on.mean(axis=0), float(np.hypot(*np.ptp(on, axis=0)))
        # Far from the origin rounding of coordinates would reach the derivative; near it they stay as they are.
        self._centre = centre if float(np.hypot(*centre)) > FAR * self._diameter else np.zeros(2)

    def __repr__(self) -> str:
        return (
            f"<Frozen: {len(self.source)} patches, {len(self.boundary_points)} boundary points, "
            f"{self._problem.n_rows} continuity rows>"
        )

    @property
    def boundary(self) -> FloatArray:
        """Boundary points (n_b, 2) of the map that was frozen."""
        return np.asarray(self.points[self.boundary_points])

    @property
    def pins(self) -> IntArray:
        """Inner points that are held like those of the boundary; none unless it comes from `pinned`."""
        return self._problem.pins

    def pinned(self, pins: ArrayLike) -> Frozen:
        """The same map with inner points that are held, so that `fill` can move them.

        Parameters
        ----------
        pins : (n_p,) int array
            Numbers of shared points, as those of ``source.topology.vertices``.

        Returns
        -------
        Frozen
            These points are held, and none that were held before.

        Raises
        ------
        InputError
            When a point is not inside, or continuity rows leave it no freedom.
        """
        other = copy(self)
        other._problem = self._unpinned.pinned(np.asarray(pins, np.int64).reshape(-1), self.points)
        return other

    def fill(self, boundary_points: ArrayLike, *, near: Filled | None = None, pins: ArrayLike | None = None) -> Filled:
        """The map of least distortion with this boundary.

        Parameters
        ----------
        boundary_points : (n_b, 2) array
            In the order of ``source.topology.boundary_points``.
        near : Filled, optional
            A map to start from, the last one of a line search, say: it saves steps where the boundary is far from the
            frozen one. The result depends on it by rounding. Default the map that was frozen.
        pins : (n_p, 2) array, optional
            Where the points that are held go, in the order of `Frozen.pins`; by default they stay. Moved ones are
            followed for a few steps only: go far in several, each `near` the last.

        Returns
        -------
        Filled
            Its ``certificate``, made when asked for, says whether the map is proved injective.

        Raises
        ------
        InputError
            On another shape or NaN.
        InfeasibleTargetError
            When the boundary encloses no area, or no map without folds was found and the boundary rules one out.
        """
        given = self._given(boundary_points, "fill")
        held = self.points[self.pins] if pins is None else np.asarray(pins, float)
        if held.shape != (len(self.pins), 2) or not np.isfinite(held).all():
            raise InputError(f"fill: expected finite places of {len(self.pins)} held points, got shape {held.shape}")
        boundary = given - self._centre
        area = self._problem.area(boundary)
        if not area > 0:
            raise InfeasibleTargetError("fill: the boundary points enclose no area; step back")
        scale = self._problem.scale(area)
        optimizer, weight = self._problem.optimizer(), self._problem.measure.area_weight
        for start, steps in self._starts(optimizer, boundary, held - self._centre, near):
            found = optimizer.minimise(start, weight, steps, scale=scale)
            if found.min_determinant > 0:
                break
        else:
            self._check(given)
        if found.min_determinant > 0 and optimizer.linearise(found.points, weight, scale):
            settled = optimizer.settle(CORRECTIONS)
            moved, energy, linearised = settled.points, settled.energy, found.points
            residual = settled.residual
        else:
            moved, energy, linearised, residual = found.points, found.energy, None, np.inf
        points = moved + self._centre
        # To the bit, but for straight corners on the right side of straight.
        points[self.boundary_points] = self._straight(given)
        points[self.pins] = held
        filled = Filled(self._problem, points, moved, linearised, scale, energy, residual * self._diameter)
        if linearised is not None:
            self._problem.keep_for(filled)
        return filled

    def area(self, boundary_points: ArrayLike) -> tuple[float, FloatArray]:
        """The area inside a boundary, exactly, and its derivative (n_b, 2) by the boundary points."""
        boundary = self._given(boundary_points, "area") - self._centre
        return self._problem.area(boundary), self._problem.area.gradient(boundary)

    def outline(self, target: Boundary) -> OutlineMap:
        """How the boundary follows the control points of the curves that it was fitted to.

        Parameters
        ----------
        target : Boundary
            Its curves run along the frozen boundary, within the error of the fit; loops in any order and sense.

        Returns
        -------
        OutlineMap

        Raises
        ------
        InputError
            When the target is elsewhere.
        """
        return OutlineMap(self.source.topology, self.points, target)

    @cached_property
    def inner_product(self) -> InnerProduct:
        """The H¹ inner product of motions of the frozen boundary, for smooth steps."""
        return InnerProduct(self.source.topology, self.points, self._problem.area(self.boundary - self._centre))

    def _given(self, boundary_points: ArrayLike, what: str) -> FloatArray:
        given = np.asarray(boundary_points, float)
        if given.shape != (len(self.boundary_points), 2) or not np.isfinite(given).all():
            expected = (len(self.boundary_points), 2)
            raise InputError(f"{what}: expected finite boundary points of shape {expected}, got {given.shape}")
        return given

    def _starts(
        self, optimizer: SplineOptimizer, boundary: FloatArray, held: FloatArray, near: Filled | None
    ) -> Iterator[tuple[FloatArray, int]]:
        """Maps to start from, with steps to make: a known one moved harmonically, then the harmonic one."""
        known = self.points - self._centre if near is None else near._moved
        shift = self._problem.lift((boundary - known[self.boundary_points])[None], held - known[self.pins])[0]
        moved = known + optimizer.harmonic(shift)
        moved[self.boundary_points] = boundary
        moved[self.pins] = held
        if len(self.pins):
            yield moved, PINNED_STEPS
            return
        yield moved, STEPS
        yield optimizer.harmonic(self._problem.lift(boundary[None])[0]), MORE_STEPS

    def _straight(self, boundary: FloatArray) -> FloatArray:
        if not len(self._triangles.rows):
            return boundary
        points = self.points.copy()
        points[self.boundary_points] = boundary
        return straighten(points, self._triangles)[0][self.boundary_points]

    def _check(self, boundary: FloatArray) -> None:
        """Raise if the boundary itself rules out a map without folds."""
        points = self.points.copy()
        points[self.boundary_points] = self._straight(boundary)
        model = self.source.with_shared_points(points)
        topology = self.source.topology
        curves = [[side.curve(model.patches) for side in loop] for loop in topology.loops]
        check_report(check_boundary(curves), "fill: boundary")
        valence = {vertex.point: vertex.valence for vertex in topology.vertices}
        starts: list[IntArray] = [
            np.array([side.points(topology.points[side.patch])[0] for side in loop]) for loop in topology.loops
        ]
        single = [[valence[int(point)] == 1 for point in loop] for loop in starts]
        check_corners(curves, single, "fill: boundary")


def freeze(
    solver: InteriorSolver, space: RowSpace | None, excluded: Sequence[tuple[int, int]], points: FloatArray
) -> Frozen:
    """Freeze the rows and corners of a certified map, and the nodes that its proof needs.

    Parameters
    ----------
    solver : InteriorSolver
    space : RowSpace or None
        The rows that hold; None for none.
    excluded : sequence of (patch, corner)
        Corners left out of the energy, besides those where the source is degenerate.
    points : (n_points, 2) array
        The map.

    Raises
    ------
    TransferError
        When no certified map is found on its boundary under the rows.
    """
    plain = Frozen(Problem(solver, space, excluded, Measure(NODES_PER_DEGREE, (), AREA_WEIGHT)), points, excluded)
    filled = plain.fill(plain.boundary)
    if filled.certificate.injective:
        plain.points = filled.points
        return plain
    topology = solver.source.topology
    found, certificate, log = optimize_with_ladder(
        lambda **nodes: solver.optimizer(excluded, null_space=None if space is None else space.columns, **nodes),
        points,
        lambda x: certify(solver.model(x)),
        source=topology.coordinates,
        boundary=topology.boundary_points,
        project=np.array if space is None else space.project,
    )
    if not certificate.injective:
        raise TransferError(f"freeze: no certified map on this boundary ({certificate.status}): {log[-1]}")
    frozen = Frozen(Problem(solver, space, excluded, found.measure), found.points, excluded)
    frozen.points = frozen.fill(frozen.boundary).points
    return frozen
