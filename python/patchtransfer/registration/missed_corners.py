"""Corners of the target that lie inside a side of the source, named before the fit with what they cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from ..geometry.basis import collocation_matrix, knot_spans
from ..geometry.curve import BSplineCurve
from ..geometry.outline import Outline
from ..geometry.slivers import drawn_corners
from ..numeric.arrays import FloatArray
from ..numeric.dense import least_squares
from .corners import CORNER_SNAP
from .sampled_boundary import cyclic_gap, image_of

__all__ = ["MissedCorner", "missed_corners", "missed_warnings", "rounding_error"]

#: Corners named in warnings for each loop, those that cost most.
MAX_WARNINGS = 5
#: Samples of a span.
SAMPLES = 14
#: Knot spans on each side of the corner's own that take part: beyond, a spline does not feel it.
SPANS_BESIDE = 3
#: A spline that is elsewhere along the wedge than the source's speed asks pays this part of what it pays for being off:
#: so the errors are those of the boundary fit, whose samples slide within a damping (0.3 to 3 times them).
SLIDE = 0.03
#: Corners that cost less (relative to the diameter) are at a knot where the side may turn.
NO_COST = 1e-9
#: Values of the arc length in a span, to find a parameter by it.
TABLE = 32


@dataclass(frozen=True)
class MissedCorner:
    """A corner of the target that no joint of the source is matched to, inside one of its sides.

    Attributes
    ----------
    x, y : float
        The corner, in the target's unit.
    loop : int
        Boundary loop of the source, the outer one first.
    turn : float
        Angle (degrees) by which the target turns there, positive where its domain is convex.
    side : int
        Number of the source's boundary side in its loop.
    parameter : float
        Of the side's curve, in the sense of the loop: what is matched to the corner.
    cost : float
        About the distance, relative to the target's diameter, by which a fit with the side's knots misses the target
        there; see `rounding_error`. Those it has before any refinement.
    """

    x: float
    y: float
    loop: int
    turn: float
    side: int
    parameter: float
    cost: float

    def to_dict(self) -> dict[str, float]:
        """All of it, ready for JSON."""
        return asdict(self)


def missed_corners(source: Outline, target: Outline, anchors: FloatArray, k: int, unit: float) -> list[MissedCorner]:
    """Corners of a target loop off the images of the source's joints and of knots where its sides may turn.

    Parameters
    ----------
    source, target : Outline
    anchors : (m + 1, 2) array
        Of their registration.
    k : int
        Number of the loop.
    unit : float
        Diameter of the target.

    Returns
    -------
    list of MissedCorner
        In the order of the source's sides.
    """
    at, turn = drawn_corners(target)
    images = image_of(anchors, source.joints)
    gap = cyclic_gap(at, np.mod(images[:-1], target.length), target.length)
    missed = gap > CORNER_SNAP * target.length
    found = []
    for t, angle in zip(at[missed], turn[missed], strict=True):
        s = float(np.mod(image_of(anchors[:, ::-1], np.array([t]))[0], source.length))
        i = int(np.clip(np.searchsorted(source.joints, s, side="right") - 1, 0, len(source.curves) - 1))
        curve, length = source.curves[i], source.joints[i + 1] - source.joints[i]
        breaks = knot_spans(curve.knots)
        # Knots themselves are in the table: a corner at one of full multiplicity costs nothing.
        table = np.sort(np.concatenate([breaks, _inside_spans(breaks, TABLE)]))
        parameter = float(np.interp(s, source.arc_length(i, table), table))
        stretch = (images[i + 1] - images[i]) / length
        error = rounding_error(curve, parameter, partial(_length_from, source, i, s))
        cost = float(np.sin(abs(angle) / 2) * stretch * error / unit)
        if cost > NO_COST:
            x, y = target.point(t).tolist()
            found.append(MissedCorner(x, y, k, float(np.degrees(angle)), i, parameter, cost))
    return sorted(found, key=lambda corner: (corner.side, corner.parameter))


def _length_from(source: Outline, i: int, s: float, t: FloatArray) -> FloatArray:
    """Signed length along the source from arc length `s` to parameters of curve `i`."""
    return np.asarray(source.arc_length(i, t) - s)


def rounding_error(curve: BSplineCurve, parameter: float, along: Callable[[FloatArray], FloatArray]) -> float:
    """Distance of a curve's splines from a wedge with the corner at a parameter, over the sine of half its turn.

    In the frame of the bisector the wedge is (x, |x|) but for constants, and the fitted curve a pair of splines (X, Y)
    with the curve's degree and knots. Its distance from the legs is that of Y from |X|, with the sign of X that of the
    parameter: least squares in both, with X kept to the source's speed as weakly as the boundary fit keeps its samples.
    With equal spans h it is 0.01 to 0.03 h (a single quadratic: 0.13 h) and less where degree-many control points come
    to meet in the corner; at a knot of full multiplicity 0.

    Parameters
    ----------
    curve : BSplineCurve
    parameter : float
    along : callable
        Signed length along the curve from the corner to parameters (n,), 0 at `parameter`.

    Returns
    -------
    float
        In the unit of `along`.
    """
    breaks, p = knot_spans(curve.knots), curve.degree
    j = int(np.clip(np.searchsorted(breaks, parameter, side="right") - 1, 0, len(breaks) - 2))
    near = breaks[max(j - SPANS_BESIDE, 0) : j + SPANS_BESIDE + 2]
    inner = curve.knots[(curve.knots > near[0]) & (curve.knots < near[-1])]
    t = _inside_spans(near, SAMPLES)
    basis = collocation_matrix(np.concatenate([[near[0]] * (p + 1), inner, [near[-1]] * (p + 1)]), p, t)
    x, ends, side = along(t), along(near[[0, -1]]), np.where(t < parameter, -1.0, 1.0)
    # Both splines meet the wedge at the ends.
    x0, y0 = basis[:, [0, -1]] @ ends, basis[:, [0, -1]] @ abs(ends)
    free = basis[:, 1:-1]
    off = np.hstack([free, -side[:, None] * free])
    slid = SLIDE * np.hstack([np.zeros_like(free), free])
    wanted = np.concatenate([side * x0 - y0, SLIDE * (x - x0)])
    found = least_squares(np.vstack([off, slid]), wanted, 1e-12) if free.shape[1] else np.zeros(0)
    return float(abs(off @ found - wanted[: len(t)]).max())


def missed_warnings(corners: Sequence[MissedCorner]) -> list[str]:
    """What to tell the user about the missed corners of a loop: those that cost most one by one."""
    worst = sorted(corners, key=lambda corner: -corner.cost)
    told = [
        f"boundary loop {c.loop}: the target has a corner at ({c.x:.6g}, {c.y:.6g}) that no joint of the source is "
        f"matched to; it turns by {abs(c.turn):.3g} degrees inside side {c.side}, whose knots will round it off by "
        f"about {c.cost:.1e} of the diameter (a landmark that pairs it with a joint of the source avoids that; more "
        "knots, refine, lessen it)"
        for c in worst[:MAX_WARNINGS]
    ]
    if len(worst) > MAX_WARNINGS:
        rest = worst[MAX_WARNINGS:]
        told.append(
            f"boundary loop {rest[0].loop}: {len(rest)} more such corners will be rounded off, by {rest[0].cost:.1e} "
            "of the diameter or less"
        )
    return told


def _inside_spans(breaks: FloatArray, n: int) -> FloatArray:
    """Parameters inside every span, `n` each, at equal distances."""
    inside = (np.arange(n) + 0.5) / n
    return np.asarray((breaks[:-1, None] + np.diff(breaks)[:, None] * inside).ravel())
