"""Points of an outline moved by hand, its curves kept together and smooth where they were."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.outline import CORNER, Outline
from ..motion.bumps import LoopBumps
from ..numeric.arrays import FloatArray

__all__ = ["PointAddress", "addresses", "check_address", "control_points", "moved", "pulled"]

#: A point that gets less of a bump at it would need a bump several times the drag.
LEAST_SHARE = 0.5


class PointAddress(NamedTuple):
    """A control point of a boundary's curve. A joint is the first point of the curve that starts there."""

    loop: int
    curve: int
    point: int


def addresses(boundary: Boundary) -> list[PointAddress]:
    """All control points, each joint once."""
    return [
        PointAddress(k, i, j)
        for k, loop in enumerate(boundary.loops)
        for i, curve in enumerate(loop)
        for j in range(len(curve.control_points) - 1)
    ]


def check_address(boundary: Boundary, at: PointAddress) -> None:
    """Raise `InputError` where a boundary has no such point."""
    if at not in addresses(boundary):
        raise InputError(f"there is no control point {at.point} on curve {at.curve} of loop {at.loop}")


def control_points(boundary: Boundary) -> FloatArray:
    """Of all curves (m, 2), curve after curve, as `OutlineMap` counts them."""
    return np.concatenate([curve.control_points for loop in boundary.loops for curve in loop])


def moved(boundary: Boundary, at: PointAddress, to: tuple[float, float]) -> Boundary:
    """The boundary with a control point elsewhere.

    At a joint both curves' ends move, and the legs beside it as well; a leg at a smooth joint turns the one across it,
    which keeps its length.

    Raises
    ------
    InputError
        When there is no such point.
    """
    check_address(boundary, at)
    loop = boundary.loops[at.loop]
    n = len(loop)
    points = [curve.control_points.copy() for curve in loop]
    before, here = points[at.curve - 1], points[at.curve]
    target = np.array(to, float)
    if at.point == 0:
        shift = target - here[0]
        # A straight side's leg is its other end, which stays; with one inner point it belongs to both ends.
        for curve, end, leg in ((before, -1, -2), (here, 0, 1)):
            curve[end] = target
            if len(curve) > 3:
                curve[leg] += shift
    else:
        here[at.point] = target
        if len(here) > 3:
            after = points[(at.curve + 1) % n]
            if at.point == 1 and len(before) > 3:
                _turn(loop[at.curve - 1], loop[at.curve], target, before, -2)
            if at.point == len(here) - 2 and len(after) > 3:
                _turn(loop[(at.curve + 1) % n].reversed(), loop[at.curve].reversed(), target, after, 1)
    changed = tuple(
        BSplineCurve(curve.knots, curve.degree, p, curve.weights) for curve, p in zip(loop, points, strict=True)
    )
    loops = [changed if k == at.loop else other for k, other in enumerate(boundary.loops)]
    return Boundary(loops, boundary.notes)


def pulled(boundary: Boundary, at: PointAddress, to: tuple[float, float], reach: float) -> Boundary:
    """The boundary with a control point elsewhere and its neighbourhood drawn along.

    The motion fades with the length along the loop (`motion.bumps`) and ends at `reach`, a part of the loop's length;
    corners stay corners and smooth joints smooth. With a reach of 0 it is `moved`.

    Raises
    ------
    InputError
        When there is no such point.
    """
    if not reach > 0:
        return moved(boundary, at, to)
    check_address(boundary, at)
    loop = boundary.loops[at.loop]
    bumps = LoopBumps(Outline(loop))
    held = loop[at.curve].control_points[at.point]
    centre = bumps.outline.nearest(held[None])[0]
    if at.point == 0:
        centre = bumps.outline.joints[[at.curve]]
    shares = [bumps.of_curve(k, centre, reach * bumps.outline.length) for k in range(len(loop))]
    share = float(shares[at.curve][at.point, 0])
    if share < LEAST_SHARE:
        # A leg longer than the reach: the bump beside it hardly moves it.
        return moved(boundary, at, to)
    # What is held goes where the pointer is, though its bump is highest beside it.
    shift = (np.array(to, float) - held) / share
    changed = tuple(
        BSplineCurve(curve.knots, curve.degree, curve.control_points + share * shift, curve.weights)
        for curve, share in zip(loop, shares, strict=True)
    )
    return Boundary([changed if k == at.loop else other for k, other in enumerate(boundary.loops)], boundary.notes)


def _turn(first: BSplineCurve, second: BSplineCurve, leg: FloatArray, points: FloatArray, other: int) -> None:
    """Put the leg of `first` at its end on the line through the new leg of `second`, if they were on one line."""
    joint = second.control_points[0]
    old, across = second.control_points[1] - joint, joint - first.control_points[-2]
    turn = np.arctan2(across[0] * old[1] - across[1] * old[0], (across * old).sum())
    length = float(np.hypot(*(leg - joint)))
    if abs(turn) < CORNER and length > 0:
        points[other] = joint - (leg - joint) / length * np.hypot(*across)
