"""Exact opinions on boundary loops, in integers. Nothing here is shared with the certificate's code.

Polygons are decided by exact segment intersection. Curved arcs are cut until hulls separate them or a crossing shows;
the answer is None where they touch, or nearly so for the limits below.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np

from exact.jacobian import binomials, derivative, over_common, product, spans_of
from patchtransfer import BSplineCurve

Point = tuple[int, int]

#: Cuts spent on one pair of arcs; rounds of cutting a loop into monotone arcs, and arcs of a loop, at most.
PAIR_CUTS, ROUNDS, MAX_ARCS = 1500, 60, 400
#: Arcs are cut at 3/8: cuts at 1/2 would meet the crossings of symmetric models at the arcs' ends for ever.
CUT = (5, 3)


def cross(a: Point, b: Point) -> int:
    return a[0] * b[1] - a[1] * b[0]


def dot(a: Point, b: Point) -> int:
    return a[0] * b[0] + a[1] * b[1]


def minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1]


def sign(x: int) -> int:
    return (x > 0) - (x < 0)


@dataclass(frozen=True)
class Arc:
    """A Bézier arc in homogeneous integer coordinates with positive weights."""

    points: tuple[tuple[int, int, int], ...]
    straight: bool

    @cached_property
    def hull(self) -> tuple[list[Point], int]:
        """Control points over a common denominator."""
        weights = [w for _, _, w in self.points]
        common = math.lcm(*weights)
        return [(x * (common // w), y * (common // w)) for x, y, w in self.points], common

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Floats that bracket the hull: quotients of integers are correctly rounded."""
        points, common = self.hull
        x, y = zip(*points, strict=True)
        low, high = (lambda n: math.nextafter(n / common, -math.inf)), (lambda n: math.nextafter(n / common, math.inf))
        return low(min(x)), high(max(x)), low(min(y)), high(max(y))

    @cached_property
    def directions(self) -> list[Point]:
        """Bernstein coefficients of the tangent, up to a positive factor."""
        if len({w for _, _, w in self.points}) == 1:
            return [minus(b[:2], a[:2]) for a, b in pairwise(self.points)]
        x, y, w = (np.array([[p[d]] for p in self.points], dtype=object) for d in range(3))
        n = len(x) - 1

        def carrying(c: np.ndarray) -> np.ndarray:
            return c * binomials((len(c) - 1, 0))

        common = math.lcm(*binomials((2 * n - 1, 0)).ravel())
        tangent = [
            (product(carrying(derivative(c, 0)), carrying(w)) - product(carrying(c), carrying(derivative(w, 0))))
            * (common // binomials((2 * n - 1, 0)))
            for c in (x, y)
        ]
        return list(zip(*(c[:, 0] for c in tangent), strict=True))

    def cut(self) -> tuple[Arc, Arc]:
        n = len(self.points) - 1
        whole = sum(CUT)
        levels = [list(self.points)]
        for _ in range(n):
            last = levels[-1]
            levels.append(
                [tuple(CUT[0] * p + CUT[1] * q for p, q in zip(a, b, strict=True)) for a, b in pairwise(last)]
            )
        low = [tuple(c * whole ** (n - k) for c in levels[k][0]) for k in range(n + 1)]
        high = [tuple(c * whole ** (n - k) for c in levels[k][-1]) for k in range(n, -1, -1)]
        return Arc(reduced(low), self.straight), Arc(reduced(high), self.straight)


def reduced(points: list[tuple[int, int, int]]) -> tuple[tuple[int, int, int], ...]:
    common = math.gcd(*(c for p in points for c in p))
    return tuple((x // common, y // common, w // common) for x, y, w in points)


def arcs_of(curves: Sequence[BSplineCurve], origin: Sequence[float]) -> list[Arc]:
    """The arcs of a closed chain; those without extent are left out."""
    arcs = []
    for curve in curves:
        axes = [
            over_common(Fraction(p) - Fraction(origin[d]) for p in curve.control_points[:, d].tolist()) for d in (0, 1)
        ]
        common = math.lcm(*(c for _, c in axes))
        x, y = (np.array(numbers, dtype=object) * (common // c) for numbers, c in axes)
        weights = [1] * len(x) if curve.weights is None else over_common(curve.weights.tolist())[0]
        w = np.array(weights, dtype=object)
        for span in spans_of(tuple(curve.knots.tolist()), curve.degree):
            part = np.s_[span.first : span.first + curve.degree + 1]
            local = [span.matrix @ c[part] for c in (x * w, y * w, w * common)]
            points = reduced(list(zip(*local, strict=True)))
            arc = Arc(points, curve.degree == 1)
            if len(set(arc.hull[0])) > 1:
                arcs.append(arc)
    return arcs


def apart(a: Arc, b: Arc) -> bool:
    """Whether a line separates the hulls strictly; for two segments, whether they are disjoint."""
    p, q = a.box, b.box
    if p[1] < q[0] or q[1] < p[0] or p[3] < q[2] or q[3] < p[2]:
        return True
    (ours, common), (theirs, other) = a.hull, b.hull
    axes = [(1, 0), (0, 1)]
    for points in (ours, theirs):
        axes += [(-e[1], e[0]) for s, t in combinations(points, 2) if (e := minus(t, s)) != (0, 0)]
    for axis in axes:
        s, t = [dot(axis, x) for x in ours], [dot(axis, x) for x in theirs]
        if max(s) * other < min(t) * common or max(t) * common < min(s) * other:
            return True
    return False


def crosses(a: Arc, b: Arc) -> bool:
    """Whether each arc runs from one side of the other's strip to the other: then they meet."""
    (ours, common), (theirs, other) = a.hull, b.hull
    along, across = minus(ours[-1], ours[0]), minus(theirs[-1], theirs[0])

    def runs_through(axis: Point, runner: list[Point], unit: int, strip: list[Point], strip_unit: int) -> bool:
        ends = sorted((dot(axis, runner[0]) * strip_unit, dot(axis, runner[-1]) * strip_unit))
        inside = [dot(axis, p) * unit for p in strip]
        return ends[0] < min(inside) and max(inside) < ends[1]

    normal_a, normal_b = (-along[1], along[0]), (-across[1], across[0])
    return runs_through(normal_b, ours, common, theirs, other) and runs_through(normal_a, theirs, other, ours, common)


def meet(a: Arc, b: Arc) -> bool | None:
    """Whether two arcs have a common point."""
    stack, cuts = [(a, b)], 0
    while stack:
        a, b = stack.pop()
        if apart(a, b):
            continue
        if (a.straight and b.straight) or crosses(a, b):
            return True
        if ends_meet(a, b):
            return True
        cuts += 1
        if cuts > PAIR_CUTS:
            return None
        first = extent(a) >= extent(b)
        stack += [(part, b) for part in a.cut()] if first else [(a, part) for part in b.cut()]
    return False


def ends_meet(a: Arc, b: Arc) -> bool:
    (ours, common), (theirs, other) = a.hull, b.hull
    return any(
        p[0] * other == q[0] * common and p[1] * other == q[1] * common
        for p in (ours[0], ours[-1])
        for q in (theirs[0], theirs[-1])
    )


def extent(arc: Arc) -> float:
    x0, x1, y0, y1 = arc.box
    return max(x1 - x0, y1 - y0)


def monotone(*arcs: Arc) -> bool:
    """Whether some direction is ascended throughout."""
    vectors = [v for arc in arcs for v in arc.directions if v != (0, 0)]
    if not all(any(v != (0, 0) for v in arc.directions) for arc in arcs):
        return False
    units = [unit(v) for v in vectors]
    mean = tuple(sum(u[d] for u in units) for d in (0, 1))
    angles = [math.atan2(mean[0] * u[1] - mean[1] * u[0], mean[0] * u[0] + mean[1] * u[1]) for u in units]
    middle = math.atan2(mean[1], mean[0]) + (min(angles) + max(angles)) / 2
    for axis in (mean, (math.cos(middle), math.sin(middle))):
        whole = tuple(int(c * 2**40) for c in axis)
        if all(dot(v, whole) > 0 for v in vectors):
            return True
    return False


def unit(v: Point) -> tuple[float, float]:
    """A unit vector of integers that may exceed a float's range."""
    excess = max(max(abs(c) for c in v).bit_length() - 900, 0)
    x, y = (float(c >> excess) for c in v)
    length = math.hypot(x, y)
    return x / length, y / length


def turns_back(a: Arc, b: Arc) -> bool:
    """Whether two consecutive segments overlap."""
    if not (a.straight and b.straight):
        return False
    d, e = (minus(arc.hull[0][-1], arc.hull[0][0]) for arc in (a, b))
    return cross(d, e) == 0 and dot(d, e) < 0


def cut_monotone(arcs: list[Arc]) -> list[Arc] | bool | None:
    """Arcs cut until there are four or more, and every two consecutive ones ascend a common direction.

    False if two consecutive segments overlap, None if that does not end.
    """
    for _ in range(ROUNDS):
        n = len(arcs)
        split = [n < 4] * n
        for i in range(n):
            a, b = arcs[i], arcs[(i + 1) % n]
            if n > 1 and turns_back(a, b):
                return False
            # Two segments that do not turn back ascend their bisector, however small their angle.
            if not (a.straight and b.straight) and not monotone(a, b):
                alone = [monotone(a), monotone(b)]
                split[i] |= all(alone) or not alone[0]
                split[(i + 1) % n] |= all(alone) or not alone[1]
        if not any(split):
            return arcs
        arcs = [part for arc, needed in zip(arcs, split, strict=True) for part in (arc.cut() if needed else (arc,))]
        if len(arcs) > MAX_ARCS:
            return None
    return None


def sense(arcs: list[Arc]) -> int:
    """+1 for a simple counter-clockwise loop of monotone arcs, -1 for a clockwise one, 0 if unknown.

    An arc and its chord enclose at most the hull, which the triangles of the control points cover.
    """
    for _ in range(12):
        area, doubt = Fraction(0), Fraction(0)
        for arc in arcs:
            points, common = arc.hull
            area += Fraction(cross(points[0], points[-1]), common**2)
            triangles = sum(abs(cross(minus(q, p), minus(r, p))) for p, q, r in combinations(points, 3))
            doubt += Fraction(triangles, common**2)
        if abs(area) > doubt:
            return sign(area)
        arcs = [part for arc in arcs for part in arc.cut()]
        if len(arcs) > MAX_ARCS:
            return 0
    return 0


def winding(arcs: list[Arc], y: Arc) -> int | None:
    """How often a loop runs around a point off it: arcs whose hull the point is off count like their chords."""
    (px, py), unit_y = y.hull[0][0], y.hull[1]
    total, stack, cuts = 0, list(arcs), 0
    while stack:
        arc = stack.pop()
        if not apart(arc, y):
            cuts += 1
            if cuts > PAIR_CUTS or arc.straight:
                return None
            stack += arc.cut()
            continue
        points, common = arc.hull
        a, b = ((p[0] * unit_y - px * common, p[1] * unit_y - py * common) for p in (points[0], points[-1]))
        if a[1] <= 0 < b[1]:
            total += cross(a, b) > 0
        elif b[1] <= 0 < a[1]:
            total -= cross(a, b) < 0
    return total


@dataclass(frozen=True)
class LoopsVerdict:
    """`simple`: loops simple, disjoint and nested such that they bound a domain on their left; None if unknown."""

    simple: bool | None
    reason: str = ""


def examine_loops(loops: Sequence[Sequence[BSplineCurve]]) -> LoopsVerdict:
    """Decide whether loops whose curves meet to the bit are simple, disjoint and rightly nested."""
    origin = loops[0][0].control_points[0].tolist()
    chains, unknown = [], ""
    for k, curves in enumerate(loops):
        raw = arcs_of(curves, origin)
        if not raw:
            return LoopsVerdict(False, f"loop {k} is a point")
        arcs = cut_monotone(raw)
        if arcs is False:
            return LoopsVerdict(False, f"loop {k} turns back on itself")
        unknown = unknown or ("" if arcs else f"loop {k} is not cut into monotone arcs")
        chains.append(arcs or raw)
    verdict = first_meeting(chains)
    if verdict is not None and verdict.simple is False:
        return verdict
    if unknown or verdict is not None:
        return LoopsVerdict(None, unknown or verdict.reason)
    for k, arcs in enumerate(chains):
        start = Arc(arcs[0].points[:1], True)
        around = [winding(other, start) for m, other in enumerate(chains) if m != k]
        way = sense(arcs)
        if None in around or way == 0:
            return LoopsVerdict(None, f"sense or nesting of loop {k}")
        if way != (-1) ** sum(w != 0 for w in around):
            return LoopsVerdict(False, f"loop {k} runs the wrong way for its nesting")
    return LoopsVerdict(True)


def first_meeting(chains: list[list[Arc]]) -> LoopsVerdict | None:
    """A proved meeting of arcs that are not neighbours, or else an unknown one, or None."""
    unknown = None
    index = [(k, i) for k, arcs in enumerate(chains) for i in range(len(arcs))]
    for (k, i), (m, j) in combinations(index, 2):
        n = len(chains[k])
        if k == m and (j - i) % n in (1, n - 1):
            continue
        found = meet(chains[k][i], chains[m][j])
        if found:
            return LoopsVerdict(False, f"arc {i} of loop {k} meets arc {j} of loop {m}")
        if found is None:
            unknown = LoopsVerdict(None, f"arc {i} of loop {k} and arc {j} of loop {m} are close")
    return unknown
