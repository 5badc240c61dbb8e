"""Stage 3, feasibility: whether boundary curves admit an injective parameterization with a given topology.

Two necessary conditions that depend on the boundary alone. The loops must be simple, disjoint and nested as
the boundary of one connected domain. And where a single patch fills a corner, its tangents there are those of
the boundary, so that its scaled Jacobian is sin(interior angle) whatever happens inside: negative above 180°,
zero at 180°, and an upper bound of the result's minimum below.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import DATA_ULPS
from ..errors import InfeasibleTargetError
from ..geometry.curve import BSplineCurve
from ..numeric.arrays import FloatArray, IntArray
from .certificate import BoundaryReport, Meeting, check_boundary

__all__ = ["Corner", "check_corners", "check_loops", "check_target_corners", "corner_report"]

#: What coordinates are known to, relative to the largest one at a joint: as in the certificate.
ROUNDING = DATA_ULPS * float(np.finfo(float).eps) / 2


class Corner(NamedTuple):
    """A joint of two consecutive boundary curves.

    Attributes
    ----------
    loop, joint : int
        Joint i is the start of curve i of the loop.
    point : tuple of float
    angle : float
        Interior angle in degrees, 0 to 360; 180 where the boundary is smooth.
    single_patch : bool
        Whether only one patch meets the boundary here.
    kind : str
        "free": several patches share the corner. For one patch: "regular", "degenerate" (det J = 0 within
        rounding: an angle of 180° or 0°, or a tangent of length zero) or "infeasible" (above 180°).
    bound : float
        For one patch sin(angle), an upper bound of the minimum scaled Jacobian; 1 for a free corner.
    """

    loop: int
    joint: int
    point: tuple[float, float]
    angle: float
    single_patch: bool
    kind: str
    bound: float


def check_loops(boundary_loops: Sequence[Sequence[BSplineCurve]], what: str) -> list[str]:
    """Check that closed loops bound one connected domain: simple, disjoint, one outer loop around all others.

    Parameters
    ----------
    boundary_loops : sequence of sequences of BSplineCurve
        Closed chains of curves, in any order and of any sense.
    what : str
        What the loops are, as the message's first words ("target boundary").

    Returns
    -------
    list of str
        Warnings on places that touch, or nearly, where neither crossing nor separation could be proved.

    Raises
    ------
    InfeasibleTargetError
        When loops are proved to cross themselves or each other, or are nested wrongly; the message names
        loops, curves and point.
    """
    return check_report(check_boundary(boundary_loops), what)


def check_report(report: BoundaryReport, what: str) -> list[str]:
    """As `check_loops`, of loops that `check_boundary` has looked at."""
    for meeting in report.crossings:
        if meeting.kind == "crossing":
            raise InfeasibleTargetError(f"{what}: {meeting}; separate the curves there")
    warnings = [f"{what}: {text}" for text in _by_curves(report.crossings)]
    known = [around for around in report.around if around is not None]
    if len(known) < len(report.around):
        return [*warnings, f"{what}: which loops lie inside which could not be decided"]
    outer = [k for k, around in enumerate(known) if not around]
    for k in outer[1:]:
        raise InfeasibleTargetError(
            f"{what}: loop {k} lies outside the outer loop {outer[0]}; one connected domain has one outer "
            "loop and its holes inside it"
        )
    for k, around in enumerate(known):
        if len(around) > 1:
            hole = next(m for m in around if m not in outer)
            raise InfeasibleTargetError(f"{what}: loop {k} lies inside the hole that loop {hole} bounds; remove one")
    return warnings


def _by_curves(meetings: Sequence[Meeting]) -> list[str]:
    """Meetings in words, of two curves the first: where they run along each other there are very many."""
    found: dict[tuple[object, ...], list[Meeting]] = {}
    for meeting in meetings:
        found.setdefault((meeting.kind, meeting.a[:2], meeting.b[:2]), []).append(meeting)
    return [str(first) + (f", and {len(more)} places more" if more else "") for first, *more in found.values()]


def corner_report(loops: Sequence[Sequence[BSplineCurve]], single_patch: Sequence[Sequence[bool]]) -> list[Corner]:
    """Interior angles at all joints of boundary curves, and what they mean for the patches there.

    Parameters
    ----------
    loops : sequence of sequences of BSplineCurve
        Closed chains, the domain on their left.
    single_patch : sequence of sequences of bool
        For each loop and joint i (the start of curve i), whether a single patch fills the corner.

    Returns
    -------
    list of Corner
        Loop by loop, joint by joint.
    """
    curves = [curve for loop in loops for curve in loop]
    points = np.concatenate([curve.control_points for curve in curves])
    sizes = np.array([len(curve.control_points) for curve in curves])
    first = np.cumsum(sizes) - sizes
    legs, skipped = _legs(curves, points, first, first + sizes - 1)
    loop = np.repeat(np.arange(len(loops)), [len(curves) for curves in loops])
    starts = np.searchsorted(loop, np.arange(len(loops)))
    before = np.arange(len(curves)) - 1
    before[starts] = np.append(starts[1:], len(curves)) - 1
    # A curve's last leg points back along it.
    arriving, leaving = -legs[1, before], legs[0]
    lengths = np.column_stack([np.hypot(*arriving.T), np.hypot(*leaving.T)])
    shapeless = (lengths == 0.0).any(axis=1)
    lengths[shapeless] = 1.0
    (a, b), (c, d) = (arriving / lengths[:, :1]).T, (leaving / lengths[:, 1:]).T
    sine = a * d - b * c
    # The boundary turns left by the exterior angle; what is left of 180° lies inside.
    angle = 180.0 - np.degrees(np.arctan2(sine, a * c + b * d))
    angle[shapeless] = np.nan
    largest = np.maximum.reduceat(np.abs(points).max(axis=1), first)
    rounding = ROUNDING * (1.0 + np.maximum(largest[before], largest) * (1.0 / lengths).sum(axis=1))
    single = np.concatenate([np.asarray(flags, bool) for flags in single_patch])
    kind = np.full(len(curves), "regular", dtype=object)
    kind[(sine <= rounding) | skipped[1, before] | skipped[0] | shapeless] = "degenerate"
    kind[(sine < -rounding) & ~shapeless] = "infeasible"
    kind[~single] = "free"
    bound = np.where(single, np.where(kind == "degenerate", 0.0, sine), 1.0)
    columns = [loop, np.arange(len(curves)) - starts[loop], points[first], angle, single, kind, bound]
    return [Corner(k, i, (x, y), *rest) for k, i, (x, y), *rest in zip(*(c.tolist() for c in columns), strict=True)]


def _legs(
    curves: Sequence[BSplineCurve], points: FloatArray, first: IntArray, last: IntArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """First control differences (2, n, 2) that do not vanish, at the starts and from the ends inwards.

    And whether any was skipped, (2, n). `first` and `last` are the curves' ends among all control points.
    """
    legs = np.stack([points[first + 1] - points[first], points[last - 1] - points[last]])
    skipped = np.logical_not(legs.any(axis=2))
    for end, k in np.argwhere(skipped):
        inwards = curves[k].control_points[:: 1 - 2 * end]
        differences = inwards - inwards[0]
        legs[end, k] = differences[differences.any(axis=1).argmax()]
    return legs, skipped


def check_corners(
    loops: Sequence[Sequence[BSplineCurve]], single_patch: Sequence[Sequence[bool]], what: str
) -> list[Corner]:
    """Return `corner_report`, or raise if a corner that one patch fills is above 180°.

    Parameters
    ----------
    loops, single_patch
        See `corner_report`.
    what : str
        What the loops are, as the message's first words ("target boundary").

    Raises
    ------
    InfeasibleTargetError
        Naming loop, joint, point and angle of the worst such corner, and the remedy.
    """
    corners = corner_report(loops, single_patch)
    infeasible = [corner for corner in corners if corner.kind == "infeasible"]
    if infeasible:
        worst = max(infeasible, key=lambda corner: corner.angle)
        more = f" (and {len(infeasible) - 1} more)" if len(infeasible) > 1 else ""
        x, y = worst.point
        raise InfeasibleTargetError(
            f"{what}: loop {worst.loop}, joint {worst.joint} at ({x:.6g}, {y:.6g}): one patch would have to "
            f"fill an interior angle of {worst.angle:.4g}°{more}; a patch corner needs an interior angle "
            "below 180 degrees; use a source with two patches here, or move the landmark"
        )
    return corners


def check_target_corners(
    points: Sequence[FloatArray],
    turns: Sequence[FloatArray],
    single_patch: Sequence[Sequence[bool]],
    tolerance: float,
) -> None:
    """Raise if the target itself turns the wrong way where a single patch fills the corner.

    Parameters
    ----------
    points : sequence of (n, 2) arrays
        For each loop, where the joints lie on the target.
    turns : sequence of (n,) arrays
        Signed turning angles of the target there in radians, the domain on the left; positive at convex corners.
    single_patch : sequence of sequences of bool
        As in `corner_report`.
    tolerance : float
        Turns to the right up to this angle (radians) count as smooth: the fit makes them exactly straight.

    Raises
    ------
    InfeasibleTargetError
        Naming loop, joint, point and angle, and the remedy.
    """
    for k, (at, turn, flags) in enumerate(zip(points, turns, single_patch, strict=True)):
        for i in np.flatnonzero(np.asarray(flags) & (turn < -tolerance)):
            raise InfeasibleTargetError(
                f"target boundary: at ({at[i, 0]:.6g}, {at[i, 1]:.6g}), the image of joint {i} of source loop {k}, one "
                f"patch would have to fill an interior angle of {180 - np.degrees(turn[i]):.4g}°; a patch corner needs "
                "less than 180 degrees: use a source with two patches there, or move the landmark"
            )
