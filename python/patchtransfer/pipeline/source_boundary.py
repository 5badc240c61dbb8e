"""The source's boundary: targets are registered to it, fitted with its knots, and posed as problems for the inside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..continuity.joint_ratios import LegWish
from ..errors import InfeasibleTargetError, InputError
from ..fitting.fit import FREE, SMOOTH_ANGLE, STIFF, FittedBoundary, fit_boundary
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.outline import Outline
from ..geometry.sides import CORNERS
from ..geometry.topology import Topology
from ..measure.quality import Quality
from ..numeric.arrays import FloatArray, among
from ..proof.certificate import BoundaryReport, check_boundary
from ..proof.feasibility import Corner, check_corners, check_loops, check_report, check_target_corners
from ..registration.register import Registration, register
from ..registration.same_curves import with_same_curves
from ..registration.sampled_boundary import BoundaryShape
from .options import Run
from .posed import FITTED, Posed, Registered, no_fit

__all__ = ["SourceBoundary"]

#: A fit that misses the target by more than so many tolerances is tried once more.
MISSED = 2.0


class FitCheck(NamedTuple):
    """Bound of the scaled Jacobian by a fit's corners, its degenerate corners, its proof, and what is wrong with it."""

    corner_bound: float
    degenerate: tuple[tuple[int, int], ...]
    report: BoundaryReport
    failure: str | None


class SourceBoundary:
    """The boundary of a source.

    Parameters
    ----------
    loops : sequence of loops of curves
        Of the source with shared points.
    topology : Topology
        Of the source.
    quality : callable, optional
        Returns the source's quality, for what is expected of its maps.
    """

    def __init__(
        self,
        loops: Sequence[Sequence[BSplineCurve]],
        topology: Topology,
        quality: Callable[[], Quality] | None = None,
    ) -> None:
        self.loops, self._quality = loops, quality
        self._topology = topology
        self.outlines = [Outline(loop) for loop in loops]
        valence = {vertex.point: vertex.valence for vertex in topology.vertices}
        of_sides = [[side.points(topology.points[side.patch]) for side in loop] for loop in topology.loops]
        #: Loop by loop, how many patches meet at each joint, and whether one alone fills it.
        self.valence = [[valence[int(points[0])] for points in loop] for loop in of_sides]
        self.single = [[patches == 1 for patches in loop] for loop in self.valence]
        self._points_of = of_sides
        self._side_points = np.concatenate([points for loop in of_sides for points in loop])
        # The last fit looked at: whoever takes it looks again.
        self._checked: tuple[FittedBoundary, FitCheck] | None = None

    @cached_property
    def _sampled(self) -> BoundaryShape:
        """What matching by shape needs of the source, whatever the target."""
        return BoundaryShape.sample(self.outlines)

    @cached_property
    def _scaled_jacobian(self) -> tuple[float, float] | None:
        """Mean and least scaled Jacobian of the source, if anyone knows."""
        if self._quality is None:
            return None
        found = self._quality().scaled_jacobian
        return found.mean, found.min

    def register(self, target: Boundary, landmarks: ArrayLike | None, run: Run) -> Registered:
        """Correspondence of the boundaries, on a target that allows an injective map."""
        with run.clock("feasibility"):
            # Before what depends on a correspondence is blamed on landmarks. As given, so that messages name the user's
            # own loops, curves and parameters. Registration itself refuses another number of loops.
            same = len(target.loops) == len(self.loops)
            notes = check_loops(target.loops, "target boundary") if same else []
        with run.clock("registration") as stage:
            paper, chosen = run.options.method == "paper", run.options.paper_options
            snap = chosen is None or chosen.snap_corners
            registration = register(
                self.outlines,
                target,
                landmarks,
                marked_curves=paper,
                single_patch=self.single,
                sampled=lambda: self._sampled,
                snap=snap,
            )
            if run.options.correspondence == "runner-up":
                second = registration.runner_up
                if second is None:
                    raise InputError(
                        'correspondence="runner-up": there is none, landmarks decide or no other one fits; leave it out'
                    )
                registration = register(self.outlines, target, second.landmarks, single_patch=self.single, snap=snap)
            registration = replace(registration, _source_quality=self._scaled_jacobian)
            loose = registration
            if not paper:
                registration = with_same_curves(registration, landmarks)
            joints = sum(len(loop.joints) - 1 for loop in registration.loops)
            stage.found = f"{joints} joints, confidence {registration.confidence:.2f}"
            if registration.by_shape and self._quality is not None:
                stage.found += f", {registration.expected}"
            doubts = registration.doubts
            run.warn(doubts)
        with run.clock("feasibility"):
            images = [loop.joints[:-1] for loop in registration.loops]
            check_target_corners(
                [loop.target.point(s) for loop, s in zip(registration.loops, images, strict=True)],
                [loop.target.turn(s) for loop, s in zip(registration.loops, images, strict=True)],
                self.single,
                SMOOTH_ANGLE,
            )
        found = [replace(x, warnings=(*doubts, *x.warnings, *notes)) for x in (registration, loose)]
        return Registered(found[0], notes[0] if notes else None, loose=None if registration is loose else found[1])

    def registered(self, registration: Registration) -> Registration:
        """The same correspondence with this boundary's curves, where the source got more knots."""
        pairs = zip(registration.loops, self.outlines, strict=True)
        return replace(registration, loops=tuple(replace(loop, source=outline) for loop, outline in pairs))

    def fit(self, registration: Registration, run: Run) -> FittedBoundary:
        """The fit, made more freely where it misses the target by far."""
        tolerance = run.options.fit_tolerance
        with run.clock("fitting") as stage:
            if run.options.method == "paper":
                chosen = run.options.paper_options
                samples = "source" if chosen is None else chosen.boundary_samples
                fitted = fit_boundary(registration, parameters=samples, tolerance=tolerance)
            else:
                fitted = self.free_fit(registration, tolerance)
            stage.found = f"boundary error {fitted.error:.1e} of the diameter"
        return fitted

    def free_fit(self, registration: Registration, tolerance: float) -> FittedBoundary:
        """The first of the fits that meets the target, else the best that allows an injective map.

        Rules give way in this order: first sides need not stay near the source's shape, then corners of one patch need
        not turn as the target does there. Sides with a single point between their ends have no freedom for both.
        """
        best = fit_boundary(registration, self.single, tolerance=tolerance)
        for single, stiffness in ((self.single, FREE), (None, STIFF)):
            if best.error <= MISSED * tolerance:
                break
            freer = fit_boundary(registration, single, tolerance=tolerance, stiffness=stiffness)
            if freer.error < best.error and self.check(freer).failure is None:
                best = freer
        report = self.check(best).report
        if not report.simple:
            even = fit_boundary(_evened(registration, report), self.single, tolerance=tolerance)
            if self.check(even).failure is None and self.check(even).report.simple:
                best = even
        return best

    def check(self, fitted: FittedBoundary) -> FitCheck:
        """Loops and corners of a fit.

        The target passed these checks, so a failure is the fit's: the source's knots are too coarse for it.
        """
        last = self._checked
        if last is None or last[0] is not fitted:
            last = self._checked = fitted, self._check(fitted)
        return last[1]

    def _check(self, fitted: FittedBoundary) -> FitCheck:
        curves = [[side.curve for side in sides] for sides in fitted.loops]
        report = check_boundary(curves)
        try:
            check_report(report, FITTED)
            corners = check_corners(curves, self.single, FITTED)
        except InfeasibleTargetError as error:
            return FitCheck(-1.0, (), report, str(error))
        return FitCheck(self._corner_bound(corners), self.degenerate(corners), report, None)

    def _corner_bound(self, corners: Sequence[Corner]) -> float:
        """The best that equal shares of the corners' angles allow: unequal ones have a smaller sine among them."""
        shared = (
            corner.bound
            if corner.single_patch
            else float(np.sin(np.radians(corner.angle) / self.valence[corner.loop][corner.joint]))
            for corner in corners
        )
        return min(shared, default=1.0)

    def pose(self, registered: Registered, fitted: FittedBoundary, run: Run) -> Posed:
        """The problem for the inside that a fit poses."""
        with run.clock("feasibility") as stage:
            bound, degenerate, report, reason = self.check(fitted)
            stage.found = reason or f"corners allow a scaled Jacobian of at most {bound:.3f}"
            failure = None if reason is None else no_fit(registered, fitted.error, reason)
            registration, doubt = registered[:2]
            points = self.points(fitted)
            return Posed(registration, doubt, fitted, points, degenerate, bound, report, failure)

    def degenerate(self, corners: Sequence[Corner]) -> tuple[tuple[int, int], ...]:
        """(patch, corner) of all corners where one patch fills a straight angle."""
        found = []
        for corner in corners:
            if corner.kind == "degenerate":
                side = self._topology.loops[corner.loop][corner.joint]
                points = self._topology.points[side.patch]
                start = side.points(points)[0]
                found.append((side.patch, next(c for c, (i, j) in enumerate(CORNERS) if points[i, j] == start)))
        return tuple(found)

    def curves(self, points: FloatArray) -> list[list[BSplineCurve]]:
        """The boundary loops of shared control points."""
        return [
            [
                BSplineCurve._trusted(curve.knots, curve.degree, points[at], curve.weights)
                for curve, at in zip(loop, along, strict=True)
            ]
            for loop, along in zip(self.loops, self._points_of, strict=True)
        ]

    def leg_lengths(self, wishes: Sequence[LegWish], points: FloatArray) -> dict[tuple[int, int], tuple[float, float]]:
        """From (loop, side) to the wished lengths of the legs before and after the side's start."""
        places = {int(on[0]): (k, i) for k, loop in enumerate(self._points_of) for i, on in enumerate(loop)}
        found = {}
        for wish in wishes:
            k, i = places[wish.joint]
            factors = {wish.left: 1 / wish.factor, wish.right: wish.factor}
            ends = int(self._points_of[k][i - 1][-2]), int(self._points_of[k][i][1])
            before, after = (factors[p] * float(np.hypot(*(points[p] - points[wish.joint]))) for p in ends)
            found[k, i] = before, after
        return found

    def points(self, fitted: FittedBoundary) -> FloatArray:
        """Shared control points with the fitted boundary and the source's interior."""
        points = self._topology.coordinates.copy()
        points[self._side_points] = np.concatenate(
            [fit.curve.control_points for sides in fitted.loops for fit in sides]
        )
        return points


def _evened(registration: Registration, report: BoundaryReport) -> Registration:
    """The correspondence in even proportions along sides whose fits meet where they should not.

    Where features close together are matched to ones far apart, speeds jump, and a side on few knots turns back.
    """
    sides = {place[:2] for meeting in report.crossings for place in (meeting.a, meeting.b)}
    loops = []
    for k, loop in enumerate(registration.loops):
        joints, images = loop.source.joints, loop.joints
        side = np.searchsorted(joints, loop.anchors[:, 0], side="right") - 1
        uneven = among(side, [i for m, i in sides if m == k]) & ~among(loop.anchors[:, 0], joints)
        ends = np.column_stack([joints, images])
        kept = np.concatenate([loop.anchors[~uneven], ends[~among(joints, loop.anchors[~uneven, 0])]])
        loops.append(replace(loop, anchors=kept[np.argsort(kept[:, 0], kind="stable")]))
    return replace(registration, loops=tuple(loops))
