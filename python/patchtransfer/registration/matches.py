"""Boundary correspondence by shape: which point of one boundary belongs to which of another.

A matching is a monotone path round two sampled loops, found by dynamic programming; corners may be passed over at a
cost. What makes two points alike is first their surroundings at several scales, then, with a first matching at hand,
their inner distances to all other matched points: lengths of shortest paths inside the domain, which bends and turned
limbs change little (Ling, Jacobs: *Shape classification using the inner-distance*, IEEE TPAMI 29(2), 2007). Both stay
the same under rotation, scaling and translation. Corners found and landmarks given, all other points slide at last,
until distances are kept best and the map between the boundaries is smooth (`inner_distances`, `thin_plate`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._core import Matching
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.dense import product
from .inner_distances import energy_of, slide
from .sampled_boundary import BoundaryShape, image_of

__all__ = ["Match", "WholeMatch", "match_hole", "match_outer", "pair_holes", "rank_with_holes", "smooth"]


#: Weights: turning and distance descriptors, distances to matched points, corner angles, stretch.
TURNING, SURROUNDINGS, DISTANCES, CORNER_WEIGHT, STRETCH = 1.0, 4.0, 4.0, 0.03, 0.05
#: Weight that descriptors keep once there is a matching.
REMEMBERED = 0.3
#: Part of the loop by which a matching may stray from equal fractions of arc length.
BAND = 0.25
#: Candidates that are worked out, and by how many nodes their starts may move in each round.
CANDIDATES, START_MOVES = 6, (2, 1, 1)
#: Candidates worse than the best by this factor, and this much, are not worked out to the end.
HOPELESS, HOPE = 3.0, 0.003
#: Matchings whose images differ by less than this part of the loop on average are the same.
SAME = 0.01
#: Matchings this close in score, relatively and absolutely, are equally good.
TIE, TIE_SCORE = 0.1, 1e-6
#: A score below this is rounding.
NO_SCORE = 1e-9
#: Weight of the bending energy in the last slide.
BENDING = 0.01
#: Rounds of turning a matching back until it means no rotation: what is left falls by far in each.
PLACING_ROUNDS = 4
#: Starts nearer to each other than one part in so many of the loop end alike.
STARTS_AROUND = 48
#: Starts of a hole that are worked out; its place among the inner distances leaves few.
HOLE_STARTS = 2
#: Outlines are nearly round when 4 pi area / length² is at least this; how much worse the score may be without any
#: rotation then.
ROUND, ROUND_SCORE = 0.95, 1.5


@dataclass(frozen=True)
class Match:
    """Matching of a source loop with a target loop.

    Attributes
    ----------
    anchors : (m + 1, 2) array
        Arc lengths of corresponding points, both increasing; the last row is the first a full turn later.
    corners : (r, 2) array
        Those that pair corners, and the pairs that were given.
    score : float
        Cost of the matching; 0 for similar shapes.
    corner_cost : float
        What corners contribute to it.
    by_arc_length : bool
        Whether it started from landmarks and arc length alone, because no path by shape keeps the landmarks.
    """

    anchors: FloatArray
    corners: FloatArray
    score: float
    corner_cost: float = 0.0
    by_arc_length: bool = False


@dataclass(frozen=True)
class WholeMatch:
    """Matching of all loops.

    Attributes
    ----------
    partners : tuple of int
        Target loop of every source loop.
    loops : tuple of lists of Match
        Of every loop, best first; empty where no matching keeps the landmarks. The outer loop's has the score of the
        whole.
    """

    partners: tuple[int, ...]
    loops: tuple[list[Match], ...]


def match_outer(source: BoundaryShape, target: BoundaryShape, fixed: FloatArray) -> list[Match]:
    """Match the outer loops.

    Parameters
    ----------
    source, target : BoundaryShape
        Sampled with the arc lengths of `fixed` as extra nodes.
    fixed : (r, 2) array
        Arc lengths of pairs that must correspond, in order.

    Returns
    -------
    list of Match
        Distinct ones, best first. Of equally good ones, as symmetric shapes have them, the one with the smallest
        rotation about the centroid comes first.
    """
    pair = _Pair(source, target, 0, 0, fixed)
    cost = _descriptors(source, target, 0, 0)
    paths: list[tuple[float, IntArray]] = []
    for start in pair.starts(cost, () if len(fixed) else _aligned_starts(source, target)):
        if (path := _work_out(pair, cost, start)) is not None:
            paths.append(path)
    best = min((score for score, _ in paths), default=0.0)
    found = [pair.slid(path) for score, path in paths if score <= HOPELESS * best + HOPE]
    found.sort(key=lambda match: match.score)
    distinct: list[Match] = []
    for match in found:
        if all(_difference(match, other) > SAME for other in distinct):
            distinct.append(match)
    if not distinct:
        return []
    ranked = _by_rotation(source, target, distinct, TIE)
    if not _turns_freely(source, ranked[0], fixed):
        return ranked
    placed = _as_placed(source, target, ranked[0])
    return [placed, *ranked] if placed.score <= ROUND_SCORE * ranked[0].score + NO_SCORE else ranked


def rank_with_holes(
    source: BoundaryShape,
    target: BoundaryShape,
    outer: Sequence[Match],
    partners: Mapping[int, int],
    fixed: Mapping[int, FloatArray],
    settled: Mapping[int, list[Match]],
    otherwise: Mapping[int, Match],
) -> list[WholeMatch]:
    """Match the holes with every matching of the outer loop, and rank these by how well all loops fit together.

    An outline that is nearly symmetric is told by its holes only.

    Parameters
    ----------
    source, target : BoundaryShape
    outer : list of Match
        See `match_outer`.
    partners : dict
        Target loops of the source loops that are paired already, of the outer one at least.
    fixed : dict of (r, 2) arrays
        Arc lengths of pairs that must correspond, of every source loop.
    settled : dict of lists of Match
        Loops whose matching is known.
    otherwise : dict of Match
        What holes take that no matching by shape fits, of every source loop with landmarks.

    Returns
    -------
    list of WholeMatch
        One for every outer matching after a common slide of all loops, best first, those that slid into each other
        once; of equally good ones the one with the smallest rotation.
    """
    n = len(source.outlines)
    free = [k for k in range(n) if k not in partners]
    unpaired = [t for t in range(n) if t not in partners.values()]
    wholes = []
    for match in outer:
        pairs = dict(partners) | (pair_holes(source, target, match.anchors, free, unpaired) if free else {})
        to = tuple(pairs[k] for k in range(n))
        loops = [[match]]
        for k in range(1, n):
            by_shape = settled.get(k) or match_hole(source, target, k, to[k], match.anchors, fixed[k])
            loops.append(list(by_shape) or [otherwise[k]])
        wholes.append(WholeMatch(to, tuple(loops)))
    wholes = _slid_together(source, target, wholes, settled)
    wholes.sort(key=lambda whole: whole.loops[0][0].score)
    distinct: dict[int, WholeMatch] = {}
    for whole in wholes:
        best = whole.loops[0][0]
        if all(
            whole.partners != other.partners or _difference(best, other.loops[0][0]) > SAME
            for other in distinct.values()
        ):
            distinct[id(best)] = whole
    ranked = [whole.loops[0][0] for whole in distinct.values()]
    close = ROUND_SCORE - 1 if _turns_freely(source, ranked[0], fixed[0]) else TIE
    return [distinct[id(match)] for match in _by_rotation(source, target, ranked, close)]


def _slid_together(
    source: BoundaryShape, target: BoundaryShape, wholes: Sequence[WholeMatch], settled: Collection[int]
) -> list[WholeMatch]:
    """Matchings after a common slide of all loops each, with its energy as their score; without the hopeless ones."""
    corner_cost = [sum(found[0].corner_cost for found in whole.loops) for whole in wholes]
    before = [
        energy_of(source, target, whole.partners, [found[0].anchors for found in whole.loops]) + cost
        for whole, cost in zip(wholes, corner_cost, strict=True)
    ]
    slid: list[WholeMatch] = []
    for i in np.argsort(before, kind="stable").tolist():
        if slid and before[i] > HOPELESS * min(before) + HOPE:
            continue
        loops = [list(found) for found in wholes[i].loops]
        anchors, energy = slide_all(source, target, wholes[i].partners, [found[0] for found in loops], settled)
        for k, found in enumerate(loops):
            if k not in settled:
                score = found[0].score if k else energy + corner_cost[i]
                found[0] = replace(found[0], anchors=anchors[k], score=score)
        slid.append(WholeMatch(wholes[i].partners, tuple(loops)))
    return slid


def _by_rotation(source: BoundaryShape, target: BoundaryShape, matches: list[Match], close: float) -> list[Match]:
    """Those as good as the first, up to the part `close` of its score, by rotation; then the others as they are."""
    limit = (1 + close) * matches[0].score + TIE_SCORE
    tied = [match for match in matches if match.score <= limit]
    tied.sort(key=lambda match: abs(_rotation(source, target, match)))
    return tied + matches[len(tied) :]


def _turns_freely(source: BoundaryShape, match: Match, fixed: FloatArray) -> bool:
    """Whether the outer loop is nearly round, with no corner or landmark to hold it."""
    outline = source.outlines[0]
    return not len(fixed) and not len(match.corners) and 4 * np.pi * outline.area >= ROUND * outline.length**2


def _as_placed(source: BoundaryShape, target: BoundaryShape, match: Match) -> Match:
    """The matching turned along the target until it means no rotation, one point held.

    On a nearly round outline shape hardly tells the start.
    """
    anchors, length = match.anchors, target.outlines[0].length
    for _ in range(PLACING_ROUNDS):
        turned = _rotation(source, target, Match(anchors, match.corners, 0.0))
        anchors = anchors - [0.0, turned / (2 * np.pi) * length]
    anchors = np.column_stack([anchors[:, 0], anchors[:, 1] - np.floor(anchors[0, 1] / length) * length])
    slid, score = slide(source, target, [0], [anchors], [source.s[0][:1]])
    return Match(slid[0], match.corners, score + match.corner_cost, match.corner_cost)


def match_hole(
    source: BoundaryShape, target: BoundaryShape, k: int, partner: int, outer: FloatArray, fixed: FloatArray
) -> list[Match]:
    """Match a hole by its inner distances to the matched outer loop (anchors `outer`) and its own shape, best first."""
    pair = _Pair(source, target, k, partner, fixed)
    matched = image_of(outer, source.s[0])
    cost = DISTANCES * _profiles(source, target, k, partner, matched)
    cost += REMEMBERED * _descriptors(source, target, k, partner)
    found = [
        pair.match(*solved) for start in pair.starts(cost, ())[:HOLE_STARTS] if (solved := pair.solve(cost, [start]))
    ]
    return sorted(found, key=lambda match: match.score)


def pair_holes(
    source: BoundaryShape, target: BoundaryShape, outer: FloatArray, holes: Sequence[int], partners: Sequence[int]
) -> dict[int, int]:
    """Target hole of every source hole, by the inner distances between hole and matched outer loop."""
    index, fraction = target.locate(0, image_of(outer, source.s[0]))
    a = np.array([source.distances[source.rows(k), source.rows(0)].mean(axis=0) for k in holes])
    b = np.array([target.distances[target.rows(t), target.rows(0)].mean(axis=0) for t in partners])
    b = b[:, index] * (1 - fraction) + b[:, (index + 1) % b.shape[1]] * fraction
    # Takes a while to load, and most shapes have a hole at most.
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(_squared_differences(a, b))
    return {holes[i]: partners[j] for i, j in zip(rows, columns, strict=True)}


def slide_all(
    source: BoundaryShape,
    target: BoundaryShape,
    partners: Sequence[int],
    matches: Sequence[Match],
    settled: Collection[int],
    bending: float = 0.0,
) -> tuple[list[FloatArray], float]:
    """Anchors of all loops after a common slide, and its energy; corners, given pairs and settled loops stay."""
    keep = [source.s[k] if k in settled else match.corners[:, 0] for k, match in enumerate(matches)]
    return slide(source, target, partners, [match.anchors for match in matches], keep, bending)


def smooth(
    source: BoundaryShape,
    target: BoundaryShape,
    partners: Sequence[int],
    matches: Sequence[Match],
    settled: Collection[int],
) -> list[FloatArray]:
    """Anchors of all loops after the last slide, which also makes the map between the boundaries smooth.

    It comes last because a matching is judged by distances alone: a limb that turns bends the plane sharply.
    """
    return slide_all(source, target, partners, matches, settled, BENDING)[0]


@dataclass(frozen=True)
class _Pair:
    """A source loop, a target loop, and arc lengths (r, 2) that must correspond."""

    source: BoundaryShape
    target: BoundaryShape
    k: int
    partner: int
    fixed: FloatArray

    @cached_property
    def problem(self) -> Matching:
        """Everything but how unlike nodes are."""
        a, b = self.source.turn[self.k], self.target.turn[self.partner]
        either = (a != 0)[:, None] | (b != 0)
        point = np.where(either, CORNER_WEIGHT * (a[:, None] - b) ** 2, 0.0)
        skip_a, skip_b = CORNER_WEIGHT * a**2, CORNER_WEIGHT * b**2
        if len(self.fixed):
            i = self.source.nearest_node(self.k, self.fixed[:, 0])
            j = self.target.nearest_node(self.partner, self.fixed[:, 1])
            point[i], point[:, j] = np.inf, np.inf
            point[i, j] = 0.0
            skip_a[i], skip_b[j] = np.inf, np.inf
        source, target = self.source.positions(self.k), self.target.positions(self.partner)
        # Landmarks may lie anywhere on the target; without them shape stretches only so much.
        band = 1.0 if len(self.fixed) else BAND
        return Matching(source, target, point, skip_a, skip_b, STRETCH, band)

    def starts(self, cost: FloatArray, aligned: Sequence[int]) -> list[int]:
        """Target nodes for source node 0 that are worth working out: local minima, and the aligned ones first."""
        if len(self.fixed):
            return [int(self.target.nearest_node(self.partner, self.fixed[:1, 1])[0])]
        n = cost.shape[1]
        # Starts next to each other end alike: every other one and the corners do.
        corner = self.target.turn[self.partner] != 0
        tried = np.flatnonzero(corner | (np.arange(n) % 2 == 0))
        scan = self.problem.scan(cost, tried.tolist())
        low = np.flatnonzero((scan <= np.roll(scan, 1)) & (scan <= np.roll(scan, -1)) & np.isfinite(scan))
        found: list[int] = []
        for j in tried[low[np.argsort(scan[low], kind="stable")]]:
            if all(min((j - i) % n, (i - j) % n) > n // STARTS_AROUND for i in found):
                found.append(int(j))
        return list(dict.fromkeys([*aligned, *found[:CANDIDATES]]))

    def solve(self, cost: FloatArray, starts: list[int]) -> tuple[float, IntArray] | None:
        """Score and path of node pairs, from the best of the starts."""
        return self.problem.solve(cost, starts)

    def match(self, score: float, path: IntArray) -> Match:
        anchors = np.column_stack(
            [self.source.arc_length(self.k, path[:, 0]), self.target.arc_length(self.partner, path[:, 1])]
        )
        rows = path[:-1] % [len(self.source.s[self.k]), len(self.target.s[self.partner])]
        paired = (self.source.turn[self.k][rows[:, 0]] != 0) & (self.target.turn[self.partner][rows[:, 1]] != 0)
        if len(self.fixed):
            paired |= np.isin(rows[:, 0], self.source.nearest_node(self.k, self.fixed[:, 0]))
        return Match(anchors, anchors[:-1][paired], score, self.corner_cost(path))

    def corner_cost(self, path: IntArray) -> float:
        """What corners cost on a path: those passed over, and differences of those matched."""
        a, b = self.source.turn[self.k], self.target.turn[self.partner]
        i, j = path[:-1, 0] % len(a), path[:-1, 1] % len(b)
        passed = (a**2).sum() - (a[i] ** 2).sum() + (b**2).sum() - (b[j] ** 2).sum()
        return float(CORNER_WEIGHT * (passed + ((a[i] - b[j]) ** 2).sum()))

    def slid(self, path: IntArray) -> Match:
        """The matching after all points but corners slid."""
        match = self.match(0.0, path)
        anchors, energy = slide(self.source, self.target, [self.partner], [match.anchors], [match.corners[:, 0]])
        return replace(match, anchors=anchors[0], score=energy + match.corner_cost)


def _work_out(pair: _Pair, cost: FloatArray, start: int) -> tuple[float, IntArray] | None:
    """Score and path after rounds of matching by inner distances to what is matched."""
    solved = pair.solve(cost, [start])
    n = cost.shape[1]
    for moves in START_MOVES:
        if solved is None:
            return None
        match = pair.match(*solved)
        matched = image_of(match.anchors, pair.source.s[0])
        profile = _profiles(pair.source, pair.target, 0, 0, matched)
        first = int(solved[1][0, 1])
        near = [first] if len(pair.fixed) else [(first + d) % n for d in range(-moves, moves + 1)]
        again = pair.solve(DISTANCES * profile + REMEMBERED * cost, near)
        if again is None or np.array_equal(again[1], solved[1]):
            return again
        solved = again
    return solved


def _squared_differences(a: FloatArray, b: FloatArray) -> FloatArray:
    """Mean squared difference of every row of `a` with every row of `b`."""
    return np.asarray(((a[:, None] - b[None]) ** 2).mean(axis=2))


def _descriptors(source: BoundaryShape, target: BoundaryShape, k: int, partner: int) -> FloatArray:
    """Cost of every node pair: turning at several scales; on outer loops also the spread of inner distances."""
    cost = TURNING * _squared_differences(source.turning[k], target.turning[partner])
    if k == 0:
        cost += SURROUNDINGS * _squared_differences(source.quantiles, target.quantiles)
    return cost


def _profiles(source: BoundaryShape, target: BoundaryShape, k: int, partner: int, matched: FloatArray) -> FloatArray:
    """Cost of every pair of nodes of loops `k` and `partner`, by inner distances.

    Mean squared difference of the distances to the nodes of the outer loop and to their images on the target's (arc
    lengths `matched`); near ones count more.
    """
    rows, near = source.rows(k), source.near
    index, fraction = target.locate(0, matched)
    # Distances are symmetric, and rows are quicker to take than columns.
    block = target.distances[target.rows(0), target.rows(partner)]
    y = block[index] * (1 - fraction)[:, None] + block[(index + 1) % len(block)] * fraction[:, None]
    squared = product(near.weighted[rows], y)
    squared *= -2
    squared += near.square[rows, None]
    squared += product(near.weight[rows], y * y)
    # Rounding leaves tiny negative numbers on similar shapes.
    return np.asarray(np.maximum(squared, 0.0))


def _aligned_starts(source: BoundaryShape, target: BoundaryShape) -> list[int]:
    """Target nodes for source node 0 with the loops on top of each other: as they are, and in the best rotation."""
    n = 256
    a, b = source.outlines[0], target.outlines[0]
    steps = np.arange(n) / n
    za, zb = (p[:, 0] + 1j * p[:, 1] for p in (a.point(source.s[0][0] + steps * a.length), b.point(steps * b.length)))
    # <a, b shifted by k> for all k at once; its modulus is the best fit over all rotations.
    correlation = np.fft.ifft(np.conj(np.fft.fft(za - za.mean())) * np.fft.fft(zb - zb.mean()))
    shifts = np.array([np.argmax(correlation.real), np.argmax(abs(correlation))])
    return [int(j) for j in target.nearest_node(0, shifts / n * b.length)]


def _rotation(source: BoundaryShape, target: BoundaryShape, match: Match) -> float:
    """Angle (radians) of the best similarity between the matched outer loops."""
    s = np.arange(128) / 128 * source.outlines[0].length
    places = source.outlines[0].point(s), target.outlines[0].point(image_of(match.anchors, s))
    a, b = (p[:, 0] + 1j * p[:, 1] for p in places)
    return float(np.angle(((a - a.mean()).conj() * (b - b.mean())).sum()))


def _difference(a: Match, b: Match) -> float:
    """Mean difference of two matchings of the same loops, in parts of the target loop."""
    length = a.anchors[-1, 1] - a.anchors[0, 1]
    s = np.linspace(a.anchors[0, 0], a.anchors[-1, 0], 64)
    offset = (image_of(a.anchors, s) - image_of(b.anchors, s)) / length
    return float(abs(offset - np.round(offset)).mean())
