"""Stage 2a, boundary registration: which point of the target boundary belongs to which of the source's.

Paper §3.2. Landmark pairs cut both loops into arcs, and within an arc points correspond at equal fractions of arc
length. Departures from the paper: r landmarks on a closed loop give r arcs (the paper says r - 1); a source curve
that spans a landmark is split there unless ``marked_curves=True`` asks for the paper's procedure; corners are
matched to corners; without landmarks the start comes from the best similarity alignment of the loops.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from .errors import InfeasibleTargetError, InputError
from .multipatch import Boundary
from .outline import Outline
from .splines import BSplineCurve, FloatArray, frozen_array

__all__ = ["LoopRegistration", "Registration", "register"]

#: Landmarks farther from the boundary than this fraction of the diameter are refused.
SNAP_DISTANCE = 0.01
#: A joint that turns by more is a corner.
CORNER = np.radians(15.0)
#: A source corner is moved onto a target corner within this fraction of the loop's length.
CORNER_SNAP = 2e-3
#: Without landmarks, corners correspond when their arc-length fractions differ by less than this.
CORNER_MATCH = 0.04
#: Corresponding corners turn by angles that differ by less than this.
CORNER_DIFFERENCE = np.radians(50.0)
#: Corners listed in warnings for each loop.
MAX_WARNINGS = 5
#: Samples a loop for the alignment without landmarks.
ALIGNMENT_SAMPLES = 512


@dataclass(frozen=True)
class LoopRegistration:
    """Correspondence of one source loop and one target loop.

    Attributes
    ----------
    source, target : Outline
        Both with the domain on the left.
    anchors : (m + 1, 2) array
        Arc lengths (source, target) of corresponding points, both increasing; the last row is the first one a
        full turn later. In between correspondence is linear in arc length.
    confidence : float
        1 with landmarks; otherwise how much better the chosen start fits than the best other one, in [0, 1].
    """

    source: Outline
    target: Outline
    anchors: FloatArray
    confidence: float

    def to_target(self, s: ArrayLike) -> FloatArray:
        """Target arc lengths (unwrapped, increasing) of the source arc lengths `s` in [0, length]."""
        a, b = self.anchors.T
        s = np.asarray(s, dtype=np.float64)
        turns = np.floor((s - a[0]) / self.source.length)
        return np.asarray(np.interp(s - turns * self.source.length, a, b) + turns * self.target.length)

    @property
    def joints(self) -> FloatArray:
        """Target arc lengths of the source's joints, one more than curves: the last closes the loop."""
        return self.to_target(self.source.joints)


@dataclass(frozen=True)
class Registration:
    """Correspondence of all loops, in the order of the source's loops."""

    loops: tuple[LoopRegistration, ...]
    warnings: tuple[str, ...] = ()

    @property
    def joints(self) -> list[tuple[FloatArray, FloatArray]]:
        """Corresponding points (source, target) at all joints of the source's boundary curves."""
        return [
            pair
            for loop in self.loops
            for pair in zip(
                loop.source.point(loop.source.joints[:-1]), loop.target.point(loop.joints[:-1]), strict=True
            )
        ]

    @property
    def confidence(self) -> float:
        """Lowest confidence of the loops."""
        return min(loop.confidence for loop in self.loops)


def register(
    source: Sequence[Sequence[BSplineCurve]],
    target: Boundary,
    landmarks: ArrayLike | None = None,
    *,
    marked_curves: bool = False,
) -> Registration:
    """Find the correspondence of source and target boundary.

    Parameters
    ----------
    source : loops of curves
        The source's boundary with the domain on the left, outer loop first (``multipatch.boundary().loops``).
    target : Boundary
        Loops in any order, sense, start and segmentation.
    landmarks : (r, 4) array, optional
        Rows (xs, ys, xt, yt): a point on the source boundary and its partner on the target's. Snapped to the
        curves.
    marked_curves : bool, default False
        Follow the paper for source curves that contain a landmark: a maximal run of them is placed by arc length
        between its unmarked neighbours, and the landmarks inside are not interpolated.

    Returns
    -------
    Registration

    Raises
    ------
    InfeasibleTargetError
        When the numbers of loops differ.
    InputError
        On landmarks off the curves, out of order, or on loops that do not correspond.
    """
    source_loops = [Outline(loop) for loop in source]
    target_loops = _outlines(target)
    if len(source_loops) != len(target_loops):
        raise InfeasibleTargetError(
            f"the source has {len(source_loops) - 1} holes and the target {len(target_loops) - 1}: "
            f"{len(source_loops)} boundary loops against {len(target_loops)}; the same topology is needed"
        )
    rows = _read_landmarks(landmarks)
    placed = _snap(rows, source_loops, target_loops)
    partner = _pair_loops(source_loops, target_loops, placed)
    warnings: list[str] = []
    loops: list[LoopRegistration] = []
    for k, outline in enumerate(source_loops):
        of_loop = placed[placed["source_loop"] == k] if len(placed) else placed
        other = target_loops[partner[k]]
        if len(of_loop):
            anchors, confidence = _anchors_from_landmarks(of_loop, outline, other, k), 1.0
            if not marked_curves:
                anchors = _match_corners_between(anchors, outline, other)
        else:
            anchors, confidence = _anchors_from_shape(outline, other, loops[0] if k else None)
            if confidence < 0.05:
                warnings.append(
                    f"boundary loop {k}: the correspondence found without landmarks is ambiguous (confidence "
                    f"{confidence:.2f}); give landmarks"
                )
        anchors = _snap_corners(anchors, outline, other)
        if marked_curves and len(of_loop):
            anchors = _place_marked(LoopRegistration(outline, other, anchors, confidence))
        loops.append(LoopRegistration(outline, other, anchors, confidence))
        warnings += _missed_corners(loops[-1], k)
    return Registration(tuple(loops), tuple(warnings))


def _outlines(target: Boundary) -> list[Outline]:
    """Outlines of the target, largest area first, turned so that the domain is on the left."""
    outlines = sorted((Outline(loop) for loop in target.loops), key=lambda outline: -abs(outline.area))
    return [
        outline if (outline.area > 0) == (k == 0) else Outline([c.reversed() for c in reversed(outline.curves)])
        for k, outline in enumerate(outlines)
    ]


def _read_landmarks(landmarks: ArrayLike | None) -> FloatArray:
    if landmarks is None:
        return np.empty((0, 4))
    rows = frozen_array(landmarks, "landmarks")
    if rows.size == 0:
        return np.empty((0, 4))
    if rows.ndim != 2 or rows.shape[1] != 4:
        raise InputError(f"landmarks must have shape (r, 4) = xs, ys, xt, yt, got {rows.shape}")
    return rows


def _snap(rows: FloatArray, source: list[Outline], target: list[Outline]) -> NDArray[np.void]:
    """Loop and arc length of every landmark on both boundaries; `row` keeps the number for messages."""
    kind = np.dtype([("row", int), ("source_loop", int), ("s", float), ("target_loop", int), ("t", float)])
    placed = np.zeros(len(rows), kind)
    placed["row"] = np.arange(len(rows))
    for name, outlines, loop, at, columns in (
        ("source", source, "source_loop", "s", slice(0, 2)),
        ("target", target, "target_loop", "t", slice(2, 4)),
    ):
        if len(rows) == 0:
            break
        diameter = np.linalg.norm(np.ptp(outlines[0].polygon(256), axis=0))
        found = [outline.nearest(rows[:, columns]) for outline in outlines]
        distance = np.array([d for _, d in found])
        best = distance.argmin(axis=0)
        worst = int(distance.min(axis=0).argmax())
        if distance[best[worst], worst] > SNAP_DISTANCE * diameter:
            raise InputError(
                f"landmark row {worst + 1}: ({rows[worst, columns][0]:g}, {rows[worst, columns][1]:g}) is "
                f"{distance[best[worst], worst]:.3g} off the {name} boundary (allowed: {SNAP_DISTANCE:.0%} of the "
                f"diameter, {SNAP_DISTANCE * diameter:.3g}); check the coordinates and the columns xs,ys,xt,yt"
            )
        placed[loop] = best
        placed[at] = np.array([s for s, _ in found])[best, np.arange(len(rows))]
    return placed


def _pair_loops(source: list[Outline], target: list[Outline], placed: NDArray[np.void]) -> list[int]:
    """Index of the target loop of every source loop: outer to outer, holes by landmarks, then by position."""
    partner = {0: 0}
    for row in placed:
        k, t = int(row["source_loop"]), int(row["target_loop"])
        if partner.setdefault(k, t) != t or any(other != k and partner[other] == t for other in partner):
            raise InputError(
                f"landmark row {int(row['row']) + 1} pairs source loop {k} with target loop {t}, other rows (or the "
                "outer loops) pair them differently; a loop has one partner"
            )
    free_source = [k for k in range(len(source)) if k not in partner]
    free_target = [t for t in range(len(target)) if t not in partner.values()]
    if free_source:
        # Holes keep their place relative to the outer loop: compare after a similarity from the outer loops.
        anchors = (
            _anchors_from_landmarks(placed[placed["source_loop"] == 0], source[0], target[0], 0)
            if (len(placed) and (placed["source_loop"] == 0).any())
            else _anchors_from_shape(source[0], target[0], None)[0]
        )
        predict = _predictor(LoopRegistration(source[0], target[0], anchors, 1.0))
        a = np.array([predict(source[k].polygon(64)).mean(axis=0) for k in free_source])
        b = np.array([target[t].polygon(64).mean(axis=0) for t in free_target])
        rows, columns = linear_sum_assignment(np.linalg.norm(a[:, None] - b[None], axis=2))
        partner |= {free_source[i]: free_target[j] for i, j in zip(rows, columns, strict=True)}
    return [partner[k] for k in range(len(source))]


def _anchors_from_landmarks(placed: NDArray[np.void], source: Outline, target: Outline, loop: int) -> FloatArray:
    """Sorted landmark positions on a loop, a full turn; `InputError` when their order is reversed or crossing."""
    placed = placed[np.argsort(placed["s"], kind="stable")]
    s, t, row = placed["s"], placed["t"], placed["row"] + 1
    t = t[0] + np.mod(t - t[0], target.length)
    for where, position, length in (("source", s, source.length), ("target", t, target.length)):
        around = np.mod(position, length)
        order = np.argsort(around, kind="stable")
        # The gap from the last to the first counts too: rounding puts a loop's start at either end.
        gaps = np.diff(around[order], append=around[order[0]] + length)
        if len(gaps) > 1 and gaps.min() <= 1e-9 * length:
            i = int(gaps.argmin())
            first, second = sorted((int(row[order[i]]), int(row[order[(i + 1) % len(order)]])))
            raise InputError(
                f"landmark rows {first} and {second} are the same point of the {where} boundary (loop {loop}); "
                "remove one"
            )
    if len(s) > 2 and (np.diff(np.roll(t, -1)[:-1]) < 0).all():
        raise InputError(
            f"landmark rows {', '.join(map(str, row))} run backwards along target loop {loop}: the target is a mirror "
            "image of the source; mirror it first"
        )
    for i in range(1, len(s)):
        if t[i] < t[i - 1]:
            raise InputError(
                f"landmark rows {row[i - 1]} and {row[i]} cross: along loop {loop} they come in one order on the "
                "source and in the other on the target"
            )
    return np.column_stack([np.append(s, s[0] + source.length), np.append(t, t[0] + target.length)])


def _anchors_from_shape(source: Outline, target: Outline, outer: LoopRegistration | None) -> tuple[FloatArray, float]:
    """Start by alignment of the loops, then corners to corners; confidence in the start.

    The outer loop is compared up to a similarity; a hole with where the outer loop's correspondence (by mean value
    coordinates) would put it, because a round hole has no start of its own.
    """
    n = ALIGNMENT_SAMPLES
    a, b = source.polygon(n), target.polygon(n)
    if outer is not None:
        a = _predictor(outer)(a)
    za, zb = (x[:, 0] + 1j * x[:, 1] for x in (a - a.mean(axis=0), b - b.mean(axis=0)))
    # <a, b shifted by k> for all k at once; its modulus is the best fit over all rotations and scales.
    correlation = np.fft.ifft(np.conj(np.fft.fft(za)) * np.fft.fft(zb))
    size = np.sqrt((abs(za) ** 2).sum() * (abs(zb) ** 2).sum())
    fit = (abs(correlation) if outer is None else correlation.real) * n / size / n
    peaks = np.flatnonzero((fit >= np.roll(fit, 1)) & (fit > np.roll(fit, -1)))
    best = peaks[np.argmax(fit[peaks])]
    if outer is None:
        # A symmetric outline fits equally well several times: take the smallest rotation.
        equal = peaks[fit[peaks] > fit[best] - 1e-3]
        best = equal[np.argmin(abs(np.angle(correlation[equal])))]
    others = fit[peaks[np.minimum((peaks - best) % n, (best - peaks) % n) > n // 32]]
    runner_up = others.max(initial=0.0)
    confidence = float(np.clip((fit[best] - runner_up) / max(1 - runner_up, 1e-12), 0, 1))
    start = best / n * target.length
    anchors = np.array([[0.0, start], [source.length, start + target.length]])
    matched = _match_all_corners(source, target) if outer is None else np.empty((0, 2))
    if len(matched) == 0:
        matched = _match_corners(source, target, start)
    if len(matched):
        s, t = matched.T
        anchors = np.column_stack([np.append(s, s[0] + source.length), np.append(t, t[0] + target.length)])
    return anchors, confidence


def _corners(outline: Outline) -> tuple[FloatArray, FloatArray]:
    """Arc lengths and turning angles of the corners."""
    breaks = outline.piece_breaks
    turn = outline.turn(breaks)
    sharp = abs(turn) > CORNER
    return breaks[sharp], turn[sharp]


def _match_all_corners(source: Outline, target: Outline) -> FloatArray:
    """All corners in order, if both loops have equally many that turn alike; (m, 2) or empty.

    Of the cyclic shifts that fit about equally well (turning angles and lengths of the arcs between), the one with
    the smallest rotation about the centroid.
    """
    (s, turn_s), (t, turn_t) = _corners(source), _corners(target)
    n = len(s)
    if n < 2 or len(t) != n:
        return np.empty((0, 2))
    gaps_s, gaps_t = (np.diff(x, append=x[0] + o.length) / o.length for x, o in ((s, source), (t, target)))
    z = source.point(s) @ [1, 1j] - source.polygon(256).mean(axis=0) @ [1, 1j]
    w = target.point(t) @ [1, 1j] - target.polygon(256).mean(axis=0) @ [1, 1j]
    shifts = np.arange(n)
    turned = [abs(turn_s - np.roll(turn_t, -k)) for k in shifts]
    cost = np.array([turned[k].mean() / np.pi + abs(gaps_s - np.roll(gaps_t, -k)).sum() for k in shifts])
    cost[[turned[k].max() > CORNER_DIFFERENCE for k in shifts]] = np.inf
    if not np.isfinite(cost).any():
        return np.empty((0, 2))
    equal = shifts[cost < cost.min() + 0.02]
    k = min(equal, key=lambda k: abs(np.angle(np.vdot(z, np.roll(w, -k)))))
    t = np.roll(t, -k)
    return np.column_stack([s, t[0] + np.mod(t - t[0], target.length)])


def _match_corners_between(anchors: FloatArray, source: Outline, target: Outline) -> FloatArray:
    """Add the corners between landmarks where both arcs have equally many, turning alike, in order."""
    (s, turn_s), (t, turn_t) = _corners(source), _corners(target)
    rows = [anchors[:1]]
    for (s0, t0), (s1, t1) in itertools.pairwise(anchors):
        at_s, at_t = s0 + np.mod(s - s0, source.length), t0 + np.mod(t - t0, target.length)
        near_s, near_t = CORNER_SNAP * source.length, CORNER_SNAP * target.length
        inside_s = np.flatnonzero((at_s > s0 + near_s) & (at_s < s1 - near_s))
        inside_t = np.flatnonzero((at_t > t0 + near_t) & (at_t < t1 - near_t))
        i, j = inside_s[np.argsort(at_s[inside_s])], inside_t[np.argsort(at_t[inside_t])]
        if len(i) == len(j) and (abs(turn_s[i] - turn_t[j]) < CORNER_DIFFERENCE).all():
            rows.append(np.column_stack([at_s[i], at_t[j]]))
        rows.append(np.array([[s1, t1]]))
    return _close(np.concatenate(rows)[:-1], source, target, anchors)


def _missed_corners(loop: LoopRegistration, k: int) -> list[str]:
    """Warnings on target corners that fall inside a side of the source, which cannot follow them."""
    at, _ = _corners(loop.target)
    joints = np.mod(loop.joints[:-1], loop.target.length)
    gap = abs(at[:, None] - joints)
    gap = np.minimum(gap, loop.target.length - gap).min(axis=1, initial=np.inf)
    missed = loop.target.point(at[gap > CORNER_SNAP * loop.target.length])
    return [
        f"boundary loop {k}: the target has a corner at ({x:.6g}, {y:.6g}) that no joint of the source is matched "
        "to; it will be rounded off (a landmark there helps if the source has such a corner)"
        for x, y in missed[:MAX_WARNINGS]
    ]


def _match_corners(source: Outline, target: Outline, start: float) -> FloatArray:
    """Mutually nearest corners (in arc-length fraction) that turn the same way; (m, 2), increasing."""
    s, turn_s = _corners(source)
    t, turn_t = _corners(target)
    if len(s) == 0 or len(t) == 0:
        return np.empty((0, 2))
    t = np.mod(t - start, target.length)
    difference = s[:, None] / source.length - t[None] / target.length
    difference -= np.round(difference)
    distance = abs(difference) + 0.02 * abs(turn_s[:, None] - turn_t[None]) / np.pi
    distance[turn_s[:, None] * turn_t[None] < 0] = np.inf
    nearest = distance.argmin(axis=1)
    mutual = distance.argmin(axis=0)[nearest] == np.arange(len(s))
    keep = mutual & (distance[np.arange(len(s)), nearest] < CORNER_MATCH)
    pairs = np.column_stack(
        [s[keep], (s / source.length - difference[np.arange(len(s)), nearest])[keep] * target.length]
    )
    if len(pairs) == 0 or (np.diff(np.append(pairs[:, 1], pairs[0, 1] + target.length)) <= 0).any():
        return np.empty((0, 2))
    pairs[:, 1] += start
    return pairs


def _snap_corners(anchors: FloatArray, source: Outline, target: Outline) -> FloatArray:
    """Add anchors where a source corner lands next to a target corner that turns the same way.

    An anchor at the corner itself gives way to it: landmarks are known to that accuracy only.
    """
    s, turn_s = _corners(source)
    t, turn_t = _corners(target)
    if len(s) == 0 or len(t) == 0:
        return anchors
    image = LoopRegistration(source, target, anchors, 1.0).to_target(s)
    offset = t[None] - image[:, None]
    offset -= np.round(offset / target.length) * target.length
    offset[turn_s[:, None] * turn_t[None] < 0] = np.inf
    nearest = abs(offset).argmin(axis=1)
    shift = offset[np.arange(len(s)), nearest]
    close = abs(shift) < CORNER_SNAP * target.length
    rows = anchors[:-1]
    new = np.column_stack([s[close], (image + shift)[close]])
    # The anchor at the corner itself gives way to the corner.
    gap = abs(rows[:, None, 0] - new[None, :, 0]) if len(new) else np.full((len(rows), 1), np.inf)
    gap = np.minimum(gap, source.length - gap)
    merged = np.concatenate([rows[(gap > CORNER_SNAP * source.length).all(axis=1)], new])
    if len(merged) == 0:
        return anchors
    return _close(merged, source, target, anchors)


def _close(rows: FloatArray, source: Outline, target: Outline, fallback: FloatArray) -> FloatArray:
    """Sort anchors by source arc length and close the turn; `fallback` if the targets do not increase."""
    turns = np.floor(rows[:, 0] / source.length)
    rows = rows - np.outer(turns, [source.length, target.length])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    closed = np.concatenate([rows, rows[:1] + np.array([source.length, target.length])])
    if (np.diff(closed[:, 0]) <= 0).any() or (np.diff(closed[:, 1]) <= 0).any():
        return fallback
    return closed


def _place_marked(loop: LoopRegistration) -> FloatArray:
    """Anchors with every maximal run of marked curves placed by arc length between its end points (paper §3.2)."""
    joints, source = loop.source.joints, loop.source
    tolerance = 1e-6 * source.length
    landmarks = np.mod(loop.anchors[:-1, 0], source.length)
    inside = (landmarks[:, None] > joints[:-1] + tolerance) & (landmarks[:, None] < joints[1:] - tolerance)
    marked = inside.any(axis=0)
    if marked.all():
        return loop.anchors
    keep = ~inside.any(axis=1)
    # Every unmarked curve keeps the images of its ends; landmarks inside marked curves are dropped.
    ends = np.unique(np.concatenate([joints[:-1][~marked], np.mod(joints[1:][~marked], source.length)]))
    rows = np.concatenate([loop.anchors[:-1][keep], np.column_stack([ends, loop.to_target(ends)])])
    rows[:, 1] -= np.floor(rows[:, 0] / source.length) * loop.target.length
    rows[:, 0] = np.mod(rows[:, 0], source.length)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    distinct = np.append(np.diff(rows[:, 0]) > tolerance, True)
    return _close(rows[distinct], loop.source, loop.target, loop.anchors)


def _predictor(outer: LoopRegistration) -> Callable[[FloatArray], FloatArray]:
    """Map points of the source's inside to the target's by mean value coordinates of the outer loop.

    Floater: *Mean value coordinates*, CAGD 20(1), 2003 (doi:10.1016/S0167-8396(03)00002-5).
    """
    s = np.arange(256, dtype=np.float64) * (outer.source.length / 256)
    polygon, image = outer.source.point(s), outer.target.point(outer.to_target(s))

    def predict(points: FloatArray) -> FloatArray:
        d = polygon[None] - points[:, None]
        r = np.linalg.norm(d, axis=2)
        following = np.roll(d, -1, axis=1)
        cross = d[..., 0] * following[..., 1] - d[..., 1] * following[..., 0]
        half = np.tan(np.arctan2(cross, (d * following).sum(axis=2)) / 2)
        w = (half + np.roll(half, 1, axis=1)) / np.maximum(r, 1e-12)
        return np.asarray((w / w.sum(axis=1, keepdims=True)) @ image)

    return predict
