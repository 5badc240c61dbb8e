"""Stage 3, feasibility: whether boundary curves admit an injective parameterization with a given topology.

Two necessary conditions that depend on the boundary alone. The loops must be simple, disjoint and nested as
the boundary of one connected domain. And where a single patch fills a corner, its tangents there are those of
the boundary, so that its scaled Jacobian is sin(interior angle) whatever happens inside: negative above 180°,
zero at 180°, and an upper bound of the result's minimum below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .certificate import check_boundary
from .errors import InfeasibleTargetError
from .splines import BSplineCurve, FloatArray

__all__ = ["Corner", "check_corners", "check_loops", "check_target_corners", "corner_report"]

#: Coordinates are taken to be known within this many units of roundoff of the largest one at a joint.
DATA_ULPS = 16.0


@dataclass(frozen=True)
class Corner:
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
    report = check_boundary(boundary_loops)
    for meeting in report.crossings:
        if meeting.kind == "crossing":
            raise InfeasibleTargetError(f"{what}: {meeting}; separate the curves there")
    warnings = [f"{what}: {meeting}" for meeting in report.crossings]
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
    corners = []
    for k, (curves, flags) in enumerate(zip(loops, single_patch, strict=True)):
        for i, (curve, single) in enumerate(zip(curves, flags, strict=True)):
            corners.append(_corner(k, i, curves[i - 1], curve, bool(single)))
    return corners


def _corner(k: int, i: int, before: BSplineCurve, after: BSplineCurve, single: bool) -> Corner:
    arriving, slow_a = _tangent(before.control_points[::-1])
    leaving, slow_b = _tangent(after.control_points)
    arriving = -arriving
    lengths = np.array([np.hypot(*arriving), np.hypot(*leaving)])
    point = (float(after.start[0]), float(after.start[1]))
    if not lengths.all():
        return Corner(k, i, point, float("nan"), single, "degenerate" if single else "free", 0.0 if single else 1.0)
    (a, b), (c, d) = arriving / lengths[0], leaving / lengths[1]
    sine, cosine = float(a * d - b * c), float(a * c + b * d)
    # The boundary turns left by the exterior angle; what is left of 180° lies inside.
    angle = 180.0 - np.degrees(np.arctan2(sine, cosine))
    largest = max(np.abs(before.control_points).max(), np.abs(after.control_points).max())
    unit = DATA_ULPS * np.finfo(float).eps / 2
    rounding = unit * (1.0 + float(largest * (1.0 / lengths).sum()))
    kind, bound = "regular", sine
    if not single:
        kind, bound = "free", 1.0
    elif sine < -rounding:
        kind = "infeasible"
    elif sine <= rounding or slow_a or slow_b:
        kind, bound = "degenerate", 0.0
    return Corner(k, i, point, float(angle), single, kind, bound)


def _tangent(points: FloatArray) -> tuple[FloatArray, bool]:
    """First control difference that does not vanish, and whether any was skipped."""
    differences = points[1:] - points[0]
    nonzero = np.flatnonzero(differences.any(axis=1))
    if not len(nonzero):
        return np.zeros(2), True
    return differences[nonzero[0]], bool(nonzero[0] > 0)


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
