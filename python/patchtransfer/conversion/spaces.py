"""Which degree and knots a strip of patches needs for polynomial sides as near to its rational ones as asked for.

A side belongs to one strip, which can be looked at by itself: whatever the others get, its sides stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..geometry.basis import elevate, insert_knots, knot_spans, weights_agree
from ..geometry.curve import BSplineCurve
from ..numeric.arrays import FloatArray
from .arcs import ArcFit, distances, fit_arc, projected, sampled

__all__ = ["Edge", "Fitted", "Space", "contains", "edge_of", "from_space", "least_space", "refined", "space_of"]

#: Degrees to choose from: with less an arc has no freedom once its ends' tangents are kept; degree 4 is worth two
#: digits over 3 at the same number of points, and more has little to add at tolerances that sides are drawn to.
DEGREES = (3, 4)
#: Spans are halved so often at most: degree 4 then misses an arc of 90 degrees by rounding alone.
FINEST = 7
#: A side is straight if its control points are nearer to its chord than this part of its length: rounding.
STRAIGHT = 1e-14
#: Samples of a span that a side's own speed is projected from.
SAMPLES = 16


@dataclass(frozen=True)
class Space:
    """A spline space along a strip, told by what is done to the strip's own: for patches on any domain.

    Attributes
    ----------
    degree : int
    multiplicities : tuple of int
        Of the inner knots that the strip has.
    cuts : tuple of tuple of float
        For every span, where it is cut: parts of it, dyadic, so that they are the same from either end.
    """

    degree: int
    multiplicities: tuple[int, ...]
    cuts: tuple[tuple[float, ...], ...]

    @property
    def count(self) -> int:
        """Number of functions."""
        return self.degree + 1 + sum(self.multiplicities) + sum(map(len, self.cuts))

    def turned(self) -> Space:
        """Seen from the other end."""
        cuts = tuple(tuple(1 - x for x in reversed(cut)) for cut in reversed(self.cuts))
        return Space(self.degree, self.multiplicities[::-1], cuts)

    def new_knots(self, breaks: FloatArray) -> list[FloatArray]:
        """The knots inside every span."""
        return [a + (b - a) * np.array(cut, float) for (a, b), cut in zip(pairwise(breaks), self.cuts, strict=True)]

    def knots(self, breaks: FloatArray) -> FloatArray:
        """The knot vector on these breaks."""
        repeated = [np.repeat(t, m) for t, m in zip(breaks[1:-1], self.multiplicities, strict=True)]
        inside = self.new_knots(breaks)
        parts = [x for pair in zip(inside, [*repeated, breaks[:0]], strict=True) for x in pair]
        ends = (np.full(self.degree + 1, t) for t in breaks[[0, -1]])
        return np.concatenate([next(ends), *parts, next(ends)])

    def halved(self, spans: Sequence[int]) -> Space:
        """With its spans of these numbers cut in half, numbered as they are now."""
        chosen, cuts, at = set(spans), [], 0
        for cut in self.cuts:
            ends = [0.0, *cut, 1.0]
            new = [(a + b) / 2 for k, (a, b) in enumerate(pairwise(ends), at) if k in chosen]
            cuts.append(tuple(sorted([*cut, *new])))
            at += len(ends) - 1
        return replace(self, cuts=tuple(cuts))

    @property
    def spans(self) -> int:
        """Number of spans."""
        return sum(len(cut) + 1 for cut in self.cuts)

    @property
    def shortest(self) -> float:
        """The shortest part of one of the strip's own spans."""
        return min(b - a for cut in self.cuts for a, b in pairwise([0.0, *cut, 1.0]))


def space_of(knots: FloatArray, degree: int) -> Space:
    """The space of a knot vector."""
    breaks, multiplicities = np.unique(knots, return_counts=True)
    return Space(degree, tuple(multiplicities[1:-1].tolist()), ((),) * (len(breaks) - 1))


@dataclass(frozen=True, eq=False)
class Edge:
    """A side to be made polynomial.

    Attributes
    ----------
    curve : BSplineCurve
        In the sense of the patch.
    against : bool
        Whether that is against the strip's.
    kind : str
        "exact" (polynomial already), "straight" or "curved".
    """

    curve: BSplineCurve
    against: bool
    kind: str


def edge_of(curve: BSplineCurve, against: bool) -> Edge:
    """A side and its kind."""
    if curve.weights is None or weights_agree(curve.weights):
        return Edge(BSplineCurve(curve.knots, curve.degree, curve.control_points), against, "exact")
    return Edge(curve, against, "straight" if _is_straight(curve) else "curved")


def _is_straight(curve: BSplineCurve) -> bool:
    way = curve.end - curve.start
    off = curve.control_points - curve.start
    size = float(np.abs(off).max())
    return bool((np.abs(off @ np.array([-way[1], way[0]])) <= STRAIGHT * size * np.hypot(*way)).all() and size > 0)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A strip's space and the sides on it, in its order.

    Attributes
    ----------
    space : Space
    points : list of (n, 2) arrays
        Control points of every side, in the sense of its patch.
    distances : list of (spans,) arrays
        How far every side is from what it was, in the sense of the strip.
    """

    space: Space
    points: list[FloatArray]
    distances: list[FloatArray]

    @property
    def worst(self) -> float:
        """The largest distance."""
        return max((float(d.max()) for d in self.distances), default=0.0)


def least_space(own: Space, edges: Sequence[Edge], polynomial: bool, limit: float) -> Fitted:
    """The space of the fewest functions that brings every side within a distance; the best one if none does.

    Parameters
    ----------
    own : Space
        What the strip has, which it keeps if no side is both rational and curved.
    edges : sequence of Edge
    polynomial : bool
        Whether the strip has polynomial patches: what it gets must contain their maps.
    limit : float
    """
    if all(edge.kind != "curved" for edge in edges):
        return fitted(own, own, edges, limit)
    found: list[Fitted] = []
    for start in _starts(own, edges, polynomial):
        fewest = min((f.space.count for f in found if f.worst <= limit), default=None)
        if fewest is None or start.count < fewest:
            found.append(from_space(own, start, edges, limit, fewest))
    return min(found, key=lambda f: (f.worst > limit, f.space.count if f.worst <= limit else f.worst))


def from_space(own: Space, start: Space, edges: Sequence[Edge], limit: float, fewest: int | None = None) -> Fitted:
    """The sides on a space, or on one with knots where they are farther from what they were than the limit.

    Ends where spans are too short, or where another space with the `fewest` functions is as good.
    """
    now = start
    while True:
        found = fitted(own, now, edges, limit)
        missed = np.max(found.distances, axis=0) > limit
        finer = now.halved(np.flatnonzero(missed).tolist())
        ended = now.shortest <= 0.5**FINEST or (fewest is not None and finer.count >= fewest)
        if not missed.any() or ended:
            return found
        now = finer


def _starts(own: Space, edges: Sequence[Edge], polynomial: bool) -> Iterator[Space]:
    """Spaces to begin with, before knots are inserted."""
    contain = polynomial or any(edge.kind == "exact" and not _is_straight(edge.curve) for edge in edges)
    for degree in sorted({max(own.degree, d) for d in DEGREES}):
        gained = degree - own.degree
        # As smooth as the strip's own splines are, which contains these; and smoother, which a refined arc is.
        contained = tuple(m + gained for m in own.multiplicities)
        smoother = tuple(m + (gained if m >= own.degree else 0) for m in own.multiplicities)
        for multiplicities in dict.fromkeys([contained] if contain else [smoother, contained]):
            yield replace(own, degree=degree, multiplicities=multiplicities)


def fitted(own: Space, space: Space, edges: Sequence[Edge], limit: float) -> Fitted:
    """The sides on a space; fits end where they are within the limit."""
    here, turned = (own, space), (own.turned(), space.turned())
    fits = [_side(edge, *(turned if edge.against else here), limit) for edge in edges]
    of_strip = [fit.distances[::-1] if e.against else fit.distances for e, fit in zip(edges, fits, strict=True)]
    return Fitted(space, [fit.points for fit in fits], of_strip)


def _side(edge: Edge, own: Space, space: Space, limit: float) -> ArcFit:
    """A side on a space, both in its own sense."""
    curve = edge.curve
    breaks = knot_spans(curve.knots)
    knots = space.knots(breaks)
    if edge.kind == "exact" and contains(space, own):
        return ArcFit(refined(curve.knots, curve.control_points, own, space), np.zeros(space.spans))
    if edge.kind != "curved":
        # In place on the chord, which keeps it straight.
        t, way = sampled(knots, SAMPLES), curve.end - curve.start
        part = (curve(t) - curve.start) @ way / float(way @ way)
        points = curve.start + projected(part, t, knots, space.degree)[:, None] * way
        points[-1] = curve.end
        line = BSplineCurve(knots, space.degree, points)
        return ArcFit(points, distances(curve, line, knots))
    corners = [0, *(i + 1 for i, m in enumerate(own.multiplicities) if m >= own.degree), len(breaks) - 1]
    parts = [_arc(curve, space, breaks, i, j, limit) for i, j in pairwise(corners)]
    points = np.concatenate([parts[0].points, *(part.points[1:] for part in parts[1:])])
    points[[0, -1]] = curve.control_points[[0, -1]]
    return ArcFit(points, np.concatenate([part.distances for part in parts]))


def _arc(curve: BSplineCurve, space: Space, breaks: FloatArray, i: int, j: int, limit: float) -> ArcFit:
    """A side between two breaks where it may have corners: they are kept."""
    own = curve if j - i == len(breaks) - 1 else curve.restrict(float(breaks[i]), float(breaks[j]))
    part = Space(space.degree, space.multiplicities[i : j - 1], space.cuts[i:j])
    return fit_arc(own, part.knots(breaks[i : j + 1]), space.degree, limit)


def contains(space: Space, own: Space) -> bool:
    """Whether all splines of a strip's own space are in another one."""
    gained = space.degree - own.degree
    pairs = zip(space.multiplicities, own.multiplicities, strict=True)
    return all(m >= n + gained for m, n in pairs)


def refined(knots: FloatArray, coefficients: FloatArray, own: Space, space: Space) -> FloatArray:
    """Coefficients (n, ...) of a spline on a space that contains its own."""
    fine, _, raised = elevate(knots, own.degree, coefficients, space.degree - own.degree)
    new = np.concatenate([knots[:0], *space.new_knots(knot_spans(knots))])
    return insert_knots(fine, space.degree, raised, new)[1]
