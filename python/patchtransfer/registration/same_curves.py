"""Target curves that a source's sides can be exactly: rational ones with the sides' degree, knots and weights.

Weights are exact for the arcs that they were made for. Where a whole loop, or all curves between two corners of the
target, have them one by one, the sides become these curves: joints go to their ends and stay there, and there is
nothing to fit. Degrees and knots may be fewer, weights have any common factor, and on a single span any speed.
A loop of sides on one ellipse becomes any other ellipse, however that is cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.basis import knot_spans
from ..geometry.curve import BSplineCurve
from ..geometry.ellipse import Ellipse, turned
from ..geometry.outline import Outline
from ..numeric.arrays import FloatArray
from .landmarks import read_landmark_rows
from .register import LoopRegistration, Registration
from .with_loops import with_loops

__all__ = ["as_side", "kept_note", "own_points", "with_same_curves"]

#: Weights, up to a common factor, and knots, in parts of the domain, that differ by less are the same.
SAME = 1e-9
#: A joint where the target turns by more is a corner: runs of curves end there (radians).
CORNER = np.radians(2.0)
#: A corner belongs to the joint whose image is nearer than this part of the loop.
REACH = 0.02
#: A round hole cut elsewhere by more than this part of a side is cut anew; eccentric annuli cut alike are a tenth off.
TWIST = 0.2
#: Landmarks keep their images to this part of the loop.
OF_LANDMARKS = 1e-3
#: Points of a side, beside its ends, whose images are kept.
INSIDE = 7
#: A curve whose control points are nearer to a line than this part of their extent is straight.
STRAIGHT = 1e-12


class _Piece(NamedTuple):
    """A part of the target, and the arc length where it starts."""

    curve: BSplineCurve
    start: float


def with_same_curves(registration: Registration, landmarks: ArrayLike | None = None) -> Registration:
    """The correspondence with sides that become the target's own curves, and the joints at their ends.

    Parameters
    ----------
    registration : Registration
    landmarks : (r, 4) array, optional
        The user's, which have the last word.

    Returns
    -------
    Registration
        ``loops[k].own`` has the curves, side by side; the same object if there are none.
    """
    if all(side.weights is None for loop in registration.loops for side in loop.source.curves):
        return registration
    rows = read_landmark_rows(landmarks)
    found: dict[int, LoopRegistration] = {}
    turned: float | None = None
    # Ellipses can start anywhere: where the loops before them do.
    for by_curve in (True, False):
        for k, loop in enumerate(registration.loops):
            if k in found:
                continue
            # What a round outline turns by, in parts of itself, holes turn by as well, which run the other way.
            sense = -1.0 if k else 1.0
            matching = _Matching(loop, _given(registration, loop, rows), sense * (turned or 0))
            made = matching.curve_by_curve(k > 0) if by_curve else matching.on_ellipse()
            if made is not None:
                found[k] = made
                if turned is None:
                    part = float(np.mean(made.joints[:-1] - loop.joints[:-1])) / loop.target.length
                    turned = sense * (part - np.round(part))
    if not found:
        return registration
    return with_loops(registration, [found.get(k, loop) for k, loop in enumerate(registration.loops)])


def _given(registration: Registration, loop: LoopRegistration, rows: FloatArray) -> FloatArray:
    """Arc lengths (source, target) of the landmarks that are on a loop."""
    if not len(rows):
        return np.empty((0, 2))
    away = np.array([other.source.nearest(rows[:, :2])[1] for other in registration.loops])
    own = rows[away.argmin(axis=0) == [other is loop for other in registration.loops].index(True)]
    return np.column_stack([loop.source.nearest(own[:, :2])[0], loop.target.nearest(own[:, 2:])[0]])


class _Matching:
    """The sides of one source loop against the curves of its target.

    Parameters
    ----------
    loop : LoopRegistration
    given : (r, 2) array
        Arc lengths (source, target) of landmarks.
    ahead : float
        By what part of it joints of the loop should be farther along the target than they are registered.
    """

    def __init__(self, loop: LoopRegistration, given: FloatArray, ahead: float) -> None:
        self.loop, self.given = loop, given
        self.sides, self.length = loop.source.curves, loop.target.length
        self.images = loop.joints[:-1] + ahead * self.length
        self.rational = [side.weights is not None for side in self.sides]
        self._known: dict[tuple[int, int], BSplineCurve | None] = {}
        self.pieces: list[_Piece] = []
        if any(self.rational) and any(curve.weights is not None for curve in loop.target.curves):
            whole = any(len(_full_knots(side)) for side in self.sides)
            self.pieces = _pieces(loop.target, whole)

    def curve_by_curve(self, hole: bool) -> LoopRegistration | None:
        """The loop with curves of the target for sides; None if there are none, or landmarks want something else.

        Nor if it is a hole that would be twisted far, and an ellipse, which can be met exactly without.
        """
        found = (self._whole() or self._runs()) if self.pieces else {}
        made = self._at(found) if found else None
        if made is not None and hole and self._twist(made) > TWIST and self.on_ellipse() is not None:
            return None
        return made

    def _twist(self, made: LoopRegistration) -> float:
        """By what part of a side joints are ahead of or behind the correspondence of shapes, in the mean."""
        part = np.mod((made.joints[:-1] - self.images) / self.length + 0.5, 1.0) - 0.5
        return abs(float(part.mean())) * len(self.sides)

    def _own(self, side: int, piece: int) -> BSplineCurve | None:
        if (side, piece) not in self._known:
            self._known[side, piece] = as_side(self.pieces[piece].curve, self.sides[side])
        return self._known[side, piece]

    def _whole(self) -> dict[int, int]:
        """From all sides to pieces, where they are the same: those nearest to the correspondence of shapes."""
        n = len(self.sides)
        if len(self.pieces) != n:
            return {}
        starts = np.array([piece.start for piece in self.pieces])
        corner = (abs(self.loop.target.turn(starts)) > CORNER, abs(self.loop.source.turn(self.loop.source.joints[:-1])))
        best: tuple[float, dict[int, int]] = np.inf, {}
        for shift in range(n):
            pairs = {i: (i + shift) % n for i in range(n)}
            to = np.roll(starts, -shift)
            away = _gap(self.images, to, self.length)
            held = np.roll(corner[0], -shift) | (corner[1] > CORNER)
            if (away[held] > REACH * self.length).any() or any(self._own(i, k) is None for i, k in pairs.items()):
                continue
            if self._at(pairs) is not None and away.mean() < best[0]:
                best = float(away.mean()), pairs
        return best[1]

    def _runs(self) -> dict[int, int]:
        """From sides to pieces between corners of the target where joints are already."""
        n, m = len(self.sides), len(self.pieces)
        starts = np.array([piece.start for piece in self.pieces])
        corners = np.flatnonzero(abs(self.loop.target.turn(starts)) > CORNER)
        found: dict[int, int] = {}
        for first, last in zip(corners, np.roll(corners, -1), strict=True):
            count = int((last - first - 1) % m + 1)
            away = _gap(self.images, starts[first], self.length)
            i = int(away.argmin())
            end = _gap(self.images, starts[last], self.length)[(i + count) % n]
            near = max(away[i], end) <= REACH * self.length
            pairs = {(i + k) % n: int((first + k) % m) for k in range(count)}
            alike = count <= n and any(self.rational[side] for side in pairs)
            if near and alike and all(self._own(side, piece) is not None for side, piece in pairs.items()):
                found |= pairs if self._at({**found, **pairs}) is not None else {}
        return found

    def on_ellipse(self) -> LoopRegistration | None:
        """The loop with all sides on the ellipse that the target is, wherever it is cut; None where it is none."""
        if not self.pieces:
            return None
        here, there = Ellipse.through(self.sides), Ellipse.through(self.loop.target.curves)
        if here is None or there is None:
            return None
        starts = np.array([side.start for side in self.sides])
        shifts = there.angles(self.loop.target.point(self.images)) - here.angles(starts)
        angle = float(np.angle(np.exp(1j * shifts).mean()))
        own = [
            side.with_control_points(there.from_circle(turned(here.to_circle(side.control_points), angle)))
            for side in self.sides
        ]
        at = self.loop.target.nearest(np.array([curve.start for curve in own]))[0]
        return self._pinned(dict(enumerate(zip(own, at, np.roll(at, -1), strict=True))))

    def _at(self, pairs: dict[int, int]) -> LoopRegistration | None:
        """The loop with these sides on these pieces; None where points would not stay in order, or at landmarks."""
        starts = [piece.start for piece in self.pieces]
        own = {i: (self._own(i, k), k) for i, k in pairs.items()}
        ends = {k: (start, starts[(k + 1) % len(starts)]) for k, start in enumerate(starts)}
        return self._pinned({i: (curve, *ends[k]) for i, (curve, k) in own.items() if curve is not None})

    def _pinned(self, sides: dict[int, tuple[BSplineCurve, float, float]]) -> LoopRegistration | None:
        """The loop with curves that sides become, and the arc lengths of the target where they start and end."""
        loop, n = self.loop, len(self.sides)
        s_joints, rows = loop.source.joints, []
        inside = np.arange(1, INSIDE + 1) / (INSIDE + 1)
        gone = np.zeros(len(loop.anchors) - 1, bool)
        for i, (curve, start, end) in sides.items():
            a, b = curve.domain
            feet = loop.target.nearest(curve((1 - inside) * a + inside * b))[0]
            rows.append((s_joints[i], start))
            rows += zip(loop.source.arc_length(i, (1 - inside) * a + inside * b), feet, strict=True)
            if (i + 1) % n not in sides:
                rows.append((s_joints[i + 1] % loop.source.length, end))
            gone |= (loop.anchors[:-1, 0] % loop.source.length >= s_joints[i] - SAME * loop.source.length) & (
                loop.anchors[:-1, 0] % loop.source.length <= s_joints[i + 1] + SAME * loop.source.length
            )
        anchors = _in_order(np.concatenate([loop.anchors[:-1][~gone], np.array(rows)]), loop)
        if anchors is None:
            return None
        own = tuple(sides[i][0] if i in sides else None for i in range(n))
        made = replace(loop, anchors=anchors, own=own)
        off = _gap(made.to_target(self.given[:, 0]), self.given[:, 1], self.length)
        return None if (off > OF_LANDMARKS * self.length).any() else made


def _gap(a: FloatArray, b: FloatArray, length: float) -> FloatArray:
    """Distances of places on a loop, pair by pair."""
    gap = np.mod(a - b, length)
    return np.asarray(np.minimum(gap, length - gap))


def _in_order(rows: FloatArray, loop: LoopRegistration) -> FloatArray | None:
    """Anchors of a full turn, None where they do not run in one order along both loops."""
    period = np.array([loop.source.length, loop.target.length])
    rows = np.mod(rows, period)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    rows[:, 1] = rows[0, 1] + np.mod(rows[:, 1] - rows[0, 1], period[1])
    closed = np.concatenate([rows, rows[:1] + period])
    return closed if (np.diff(closed, axis=0) > 0).all() else None


def _full_knots(curve: BSplineCurve) -> list[float]:
    """Inner knots where Bézier pieces of a curve are only chained."""
    breaks = knot_spans(curve.knots)[1:-1]
    return [float(x) for x in breaks if np.count_nonzero(curve.knots == x) >= curve.degree]


def _pieces(outline: Outline, whole: bool) -> list[_Piece]:
    """The curves of a loop, cut where their pieces are only chained if sides are not so made themselves."""
    pieces = []
    for j, curve in enumerate(outline.curves):
        cuts = [] if whole else _full_knots(curve)
        starts = [float(outline.joints[j]), *outline.arc_length(j, np.array(cuts)).tolist()]
        parts = (
            [curve.restrict(a, b) for a, b in pairwise([curve.domain[0], *cuts, curve.domain[1]])] if cuts else [curve]
        )
        pieces += [_Piece(part, start) for part, start in zip(parts, starts, strict=True)]
    return pieces


def as_side(curve: BSplineCurve, side: BSplineCurve) -> BSplineCurve | None:
    """A curve by the degree, knots and weights of a side, exactly; None where it has others.

    Of a straight side a straight curve is an affine image, at the side's speed.
    """
    if _straight(curve) and _straight(side):
        return _along(curve, side)
    if curve.degree > side.degree:
        return None
    (a, b), (c, d) = side.domain, curve.domain
    knots = a + (curve.knots - c) * ((b - a) / (d - c))
    nearest = side.knots[abs(side.knots[None] - knots[:, None]).argmin(axis=1)]
    if (abs(nearest - knots) > SAME * (b - a)).any():
        return None
    made = BSplineCurve(nearest, curve.degree, curve.control_points, _at_speed(curve, side))
    if side.degree > curve.degree:
        made = made.elevate(side.degree - curve.degree)
    full = _with_knots(made, side.knots)
    if full is None:
        return None
    own, weights = (np.ones(len(side.control_points)) if w is None else w for w in (full.weights, side.weights))
    ratio = own / weights
    return side.with_control_points(full.control_points) if np.ptp(ratio) <= SAME * ratio.max() else None


def own_points(own: BSplineCurve, side: BSplineCurve) -> FloatArray:
    """Control points of a side's own curve, where the side may have got more knots since."""
    made = _with_knots(own, side.knots)
    assert made is not None
    return made.control_points


def _at_speed(curve: BSplineCurve, side: BSplineCurve) -> FloatArray | None:
    """Weights of a single span that runs along the same curve at the speeds of a side at its ends."""
    w = curve.weights
    if w is None or len(w) != curve.degree + 1 or side.weights is None:
        return w
    ratio = (side.weights[-1] / side.weights[0]) / (w[-1] / w[0])
    return np.asarray(w * ratio ** (np.arange(len(w)) / curve.degree))


def _with_knots(curve: BSplineCurve, knots: FloatArray) -> BSplineCurve | None:
    """The curve with the knots that it lacks; None if it has others."""
    values = knot_spans(knots)
    lacking = [np.count_nonzero(knots == x) - np.count_nonzero(curve.knots == x) for x in values]
    if min(lacking) < 0 or sum(lacking) + len(curve.knots) != len(knots):
        return None
    return curve.insert_knots(np.repeat(values, lacking)) if any(lacking) else curve


def _straight(curve: BSplineCurve) -> bool:
    x = curve.control_points
    chord = x[-1] - x[0]
    length = float(np.hypot(*chord))
    off = (x[:, 0] - x[0, 0]) * chord[1] - (x[:, 1] - x[0, 1]) * chord[0]
    return length > 0 and bool((abs(off) <= STRAIGHT * length**2).all())


def _along(curve: BSplineCurve, side: BSplineCurve) -> BSplineCurve:
    x, chord = side.control_points, side.end - side.start
    part = ((x - x[0]) * chord).sum(axis=1) / float((chord**2).sum())
    part[[0, -1]] = 0.0, 1.0
    return side.with_control_points((1 - part)[:, None] * curve.start + part[:, None] * curve.end)


def kept_note(loops: Sequence[LoopRegistration]) -> list[str]:
    """What is said where sides are the target's own curves."""
    count = sum(curve is not None for loop in loops for curve in loop.own)
    if not count:
        return []
    total = sum(len(loop.source.curves) for loop in loops)
    return [
        f"{count} of {total} boundary sides are the target's own curves, or parts of its ellipses, by their weights: "
        "they are exact, and their joints do not slide"
    ]
