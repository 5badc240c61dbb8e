"""Pieces of drawings (lines, arcs, splines in space) and the closed loops that they form in a plane.

Arcs of circles and ellipses are exact: rational quadratics, of at most a quarter turn a span. Programs for drawings
store each piece with the tool that drew it, in any order and sense; they are chained by their end points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..limits import MAX_BOUNDARY_POINTS, MAX_CURVES, MAX_DEGREE, MAX_LOOPS, TOO_LARGE, at_most, first_unusable
from ..numeric.arrays import FloatArray
from .cleaning import cleaned, mended
from .loops import TOLERANCE, chain, clamp
from .options import DEFAULT, BoundaryOptions

__all__ = ["Piece", "arc", "boundary_of", "bulge", "full_turn", "line", "spline"]

#: Largest turn of one span of an arc: the middle weight, its half angle's cosine, stays well away from 0.
QUARTER = math.pi / 2
#: Pieces shorter than this (relative to the diameter) are left-overs of rounding.
NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class Piece:
    """A curve in space: clamped knots, degree, control points (n, 3), weights (n,) or None for a polynomial."""

    knots: FloatArray
    degree: int
    points: FloatArray
    weights: FloatArray | None = None

    def placed(self, matrix: FloatArray) -> Piece:
        """The piece moved by an affine map (4, 4) of columns."""
        with np.errstate(over="ignore", invalid="ignore"):
            return replace(self, points=self.points @ matrix[:3, :3].T + matrix[:3, 3])


def line(a: ArrayLike, b: ArrayLike) -> Piece:
    """The straight piece from `a` to `b`, points of space."""
    return Piece(np.array([0.0, 0.0, 1.0, 1.0]), 1, np.array([a, b], dtype=np.float64))


def full_turn(start: float, end: float) -> bool:
    """Whether an arc over these angles in radians, counter-clockwise, is a full one: equal ends mean so."""
    return math.isclose(math.remainder(end - start, 2 * math.pi), 0.0, abs_tol=1e-9)


def arc(center: ArrayLike, x_axis: ArrayLike, y_axis: ArrayLike, start: float, turn: float) -> Piece:
    """The piece center + cos(t) x_axis + sin(t) y_axis for t from `start` to `start + turn` (radians), exact."""
    n = max(1, math.ceil(abs(turn) / QUARTER - 1e-9))
    half = turn / n / 2
    t = start + half * np.arange(2 * n + 1)
    weights = np.ones(2 * n + 1)
    weights[1::2] = math.cos(half)
    unit = np.column_stack([np.cos(t), np.sin(t)]) / weights[:, None]
    points = np.asarray(center, dtype=np.float64) + unit @ np.array([x_axis, y_axis], dtype=np.float64)
    knots = np.concatenate([[0.0], np.repeat(np.arange(n + 1.0), 2), [n]])
    return Piece(knots, 2, points, weights)


def bulge(a: FloatArray, b: FloatArray, value: float) -> Piece:
    """A side of a polyline: a line, or the arc with the tangent of a quarter of its turn, in the plane z = const."""
    if value == 0 or np.array_equal(a, b):
        return line(a, b)
    chord = b - a
    normal = np.array([-chord[1], chord[0], 0.0])
    center = (a + b) / 2 + normal * (1 - value * value) / (4 * value)
    x = a - center
    piece = arc(center, x, [-x[1], x[0], 0.0], 0.0, 4 * math.atan(value))
    # A flat arc's centre is far away, and rounding with it.
    piece.points[0], piece.points[-1] = a, b
    return piece


def spline(knots: ArrayLike, degree: int, points: ArrayLike, weights: ArrayLike | None) -> Piece:
    """A spline piece, clamped by knot insertion if it is not.

    Raises
    ------
    InputError
        When the counts do not fit or a weight is not positive.
    """
    t, c = np.asarray(knots, dtype=np.float64), np.asarray(points, dtype=np.float64)
    w = None if weights is None or not len(np.asarray(weights)) else np.asarray(weights, dtype=np.float64)
    at_most(degree, MAX_DEGREE, "is its degree", "lower it")
    if degree < 1 or len(c) < degree + 1 or len(t) != len(c) + degree + 1 or (w is not None and len(w) != len(c)):
        raise InputError(f"{len(t)} knots, {len(c)} control points and degree {degree} do not fit; draw it again")
    if not (np.isfinite(t).all() and (np.diff(t) >= 0).all() and first_unusable(c) is None):
        raise InputError(f"knots that decrease, NaN, infinity or a number {TOO_LARGE}; draw it again")
    if w is not None and not ((w > 0) & np.isfinite(w)).all():
        raise InputError("a weight is not positive; draw it again")
    if w is not None and (w == w[0]).all():
        w = None
    h = c if w is None else np.column_stack([c * w[:, None], w])
    t, h = clamp(t, degree, h)
    return Piece(t, degree, h) if w is None else Piece(t, degree, h[:, :3] / h[:, 3:], h[:, 3])


def boundary_of(
    pieces: Sequence[tuple[str, Piece]], notes: Sequence[str] = (), options: BoundaryOptions = DEFAULT
) -> Boundary:
    """The closed loops that named pieces form in a plane z = const.

    Raises
    ------
    InputError
        Naming the piece that leaves the plane or is open, or those that branch.
    """
    at_most(len(pieces), MAX_CURVES, "pieces of outline", "keep those of the domain")
    at_most(sum(len(p.points) for _, p in pieces), MAX_BOUNDARY_POINTS, "control points", "simplify the drawing")
    for name, piece in pieces:
        if first_unusable(piece.points) is not None:
            raise InputError(f"{name}: NaN, infinity or a number {TOO_LARGE}; correct it")
    everywhere = np.concatenate([piece.points for _, piece in pieces])
    size = float(np.linalg.norm(np.ptp(everywhere[:, :2], axis=0)))
    _check_plane(pieces, everywhere, size)
    told = list(notes)
    names, curves, short = [], [], 0
    for name, piece in pieces:
        if np.linalg.norm(np.ptp(piece.points[:, :2], axis=0)) <= NEGLIGIBLE * size:
            short += 1
            continue
        names.append(name)
        try:
            curves.append(BSplineCurve(piece.knots, piece.degree, piece.points[:, :2], piece.weights))
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
    if short:
        told.append(f"{short} pieces without length left out")
    if not curves:
        raise InputError("all pieces of outline are without length; draw the outline again")
    if options.clean:
        names, curves = mended(names, curves, told)
    loops = chain(names, curves, TOLERANCE * size)
    at_most(len(loops), MAX_LOOPS, "loops", "keep those of the domain")
    return Boundary(cleaned(loops, told) if options.clean else loops, told)


def _check_plane(pieces: Sequence[tuple[str, Piece]], everywhere: FloatArray, size: float) -> None:
    height = float(np.median(everywhere[:, 2]))
    for name, piece in pieces:
        away = float(np.abs(piece.points[:, 2] - height).max())
        # Far from z = 0 the last digits of the height are rounding.
        if away > TOLERANCE * size + 1e-12 * abs(height):
            raise InputError(
                f"{name} is {away:.3g} away from the plane z = {height:g} of the rest; flatten the drawing, "
                "or choose the layers of one plane"
            )
