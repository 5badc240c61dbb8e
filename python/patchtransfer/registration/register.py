"""Stage 2a, boundary registration: which point of the target boundary belongs to which of the source's.

Paper §3.2. Landmark pairs cut both loops into arcs. The paper lets points correspond at equal fractions of arc length
within an arc (``marked_curves=True``). Here shape decides between landmarks, and everywhere without them
(`correspondence`); loops whose joints are all landmarks or matched corners keep to arc length. Further departures: r
landmarks on a closed loop give r arcs (the paper says r - 1); a source curve that spans a landmark is split there
unless ``marked_curves=True`` asks for the paper's procedure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InfeasibleTargetError, InputError
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.outline import Outline
from ..limits import MAX_CORNERS, at_most
from ..numeric.arrays import FloatArray, distinct
from ..numeric.dense import svd
from .confidence import DOUBTFUL, confidence, doubt
from .corners import close_turn, corners_between, snap_corners
from .expected import Expected, expected
from .free_joints import joints_to_corners
from .landmarks import landmark_anchors, pair_by_landmarks, place_landmarks, read_landmark_rows
from .matches import HOPE, HOPELESS, Match, WholeMatch, match_outer, rank_with_holes, smooth
from .mismatch import Matched, Mismatch, mismatch
from .missed_corners import MissedCorner, missed_corners, missed_warnings
from .missed_tabs import MissedTab, missed_tabs, tab_text
from .sampled_boundary import BoundaryShape, cyclic_gap, image_of

__all__ = ["LoopRegistration", "Registration", "RunnerUp", "register", "target_outlines"]

#: Curves shorter than this part of the diameter have no length.
SHORTEST = 1e-9
#: Below this margin a warning says that another correspondence fits nearly as well.
AMBIGUOUS = 0.05
#: Places, or lengths, that differ by less than this part of a loop are one.
SAME_PLACE = 1e-6
#: A joint nearer to a matched corner than this part of the loop tells nothing that the corner does not.
NEAR_CORNER = 0.01
#: A score that is as good as none: of two matches better than this none is preferred with any confidence.
NO_SCORE = 1e-6
#: A loop with fewer matched corners has some of its joints among its landmarks.
FEW_LANDMARKS, JOINT_LANDMARKS = 4, 8


@dataclass(frozen=True)
class RunnerUp:
    """The second best correspondence of a loop.

    Attributes
    ----------
    score : float
        Cost of the matching, to compare with that of the best; 0 for similar shapes.
    landmarks : (r, 4) array
        Rows (xs, ys, xt, yt) that ask for this correspondence when given to `register`.
    """

    score: float
    landmarks: FloatArray

    def to_dict(self) -> dict[str, object]:
        """Both, ready for JSON."""
        return {"score": self.score, "landmarks": self.landmarks.tolist()}


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
    margin : float
        1 with landmarks; otherwise how much better the shapes fit than in the runner-up, from 0 (as well) to 1.
    features : (r, 2) array
        Arc lengths of landmarks given and corners matched.
    score : float
        Cost of the matching by shape; 0 for similar shapes and when only arc length decides.
    runner_up : RunnerUp or None
    own : tuple of (BSplineCurve or None)
        Side by side, the target's curve that it becomes exactly (`same_curves`); empty if none does.
    """

    source: Outline
    target: Outline
    anchors: FloatArray
    margin: float
    features: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    score: float = 0.0
    runner_up: RunnerUp | None = None
    own: tuple[BSplineCurve | None, ...] = ()

    def to_target(self, s: ArrayLike) -> FloatArray:
        """Target arc lengths (unwrapped, increasing) of the source arc lengths `s` in [0, length]."""
        return image_of(self.anchors, np.asarray(s, dtype=np.float64))

    @property
    def joints(self) -> FloatArray:
        """Target arc lengths of the source's joints, one more than curves: the last closes the loop."""
        return self.to_target(self.source.joints)

    @property
    def landmarks(self) -> FloatArray:
        """Rows (xs, ys, xt, yt) of given landmarks and matched corners; on loops with few of them, of joints too."""
        return _landmark_rows(self.source, self.target, self.anchors, self.features)


@dataclass(frozen=True)
class Registration:
    """Correspondence of all loops.

    Attributes
    ----------
    loops : tuple of LoopRegistration
        In the order of the source's loops.
    warnings : tuple of str
    missed_corners : tuple of MissedCorner
        Corners of the target inside sides of the source, which the fit rounds off, loop after loop along the source.
    mirrored : bool
        Whether the loops are those of the source's mirror image (x -> -x). Points of the source that `joints`,
        `landmarks`, `pairs` and `runner_up` give are the source's own.
    missed_tabs : tuple of MissedTab
        Tabs and notches of the target, without corners, where the source's boundary is straight.
    confidence : float
        The probability that the correspondence is right, up to symmetries of the source; 1 with landmarks on all loops.
        Calibrated, see ``docs/stages/registration.md``.
    """

    loops: tuple[LoopRegistration, ...]
    warnings: tuple[str, ...] = ()
    missed_corners: tuple[MissedCorner, ...] = ()
    mirrored: bool = False
    missed_tabs: tuple[MissedTab, ...] = ()
    confidence: float = 1.0
    # As they were found to correspond: joints may slide later, and what is expected is expected before.
    _found: tuple[Matched, ...] = field(default=(), repr=False)
    #: Of correspondences found by shape; of others it is worked out when somebody asks.
    _mismatch: Mismatch | None = field(default=None, repr=False)
    #: Mean and least scaled Jacobian of the source, from the plan that knows it.
    _source_quality: tuple[float, float] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        return f"<Registration: {len(self.loops)} loops, confidence {self.confidence:.2f}>"

    @property
    def joints(self) -> list[tuple[FloatArray, FloatArray]]:
        """Corresponding points (source, target) at all joints of the source's boundary curves."""
        return [
            pair
            for loop in self.loops
            for pair in zip(
                self._own(loop.source.point(loop.source.joints[:-1])), loop.target.point(loop.joints[:-1]), strict=True
            )
        ]

    def _own(self, rows: FloatArray) -> FloatArray:
        """Rows that begin with a point of the loops' source, with that point of the user's source."""
        return np.concatenate([0.0 - rows[:, :1], rows[:, 1:]], axis=1) if self.mirrored else rows

    @property
    def mismatch(self) -> Mismatch:
        """How far from similar the boundaries are, as they were found to correspond."""
        return self._mismatch or mismatch(self._found)

    @property
    def expected(self) -> Expected | None:
        """What scaled Jacobian to expect of a map with this correspondence; None without a plan's source."""
        return self._source_quality and expected(self.mismatch, *self._source_quality)

    @property
    def doubts(self) -> list[str]:
        """What speaks against the work that begins; what landmarks say is not doubted."""
        if not self.by_shape:
            return []
        unsure = doubt(self.confidence) if self.confidence < DOUBTFUL else None
        poor = self.expected and self.expected.doubt
        return [text for text in (unsure, poor) if text]

    @property
    def by_shape(self) -> bool:
        """Whether some loop has no landmarks."""
        return self._mismatch is not None

    @property
    def margin(self) -> float:
        """How much better the shapes fit than in the runner-up: that of the loop where it is least."""
        return min(loop.margin for loop in self.loops)

    @property
    def landmarks(self) -> FloatArray:
        """Rows (xs, ys, xt, yt) of all loops: given back to `register`, corrected or not, they fix what they pair."""
        return self._own(np.concatenate([loop.landmarks for loop in self.loops]))

    def pairs(self, n: int) -> FloatArray:
        """Rows (xs, ys, xt, yt) of corresponding points, `n` on every loop at equal distances on the source."""
        rows = []
        for loop in self.loops:
            s = np.arange(n, dtype=np.float64) / n * loop.source.length
            rows.append(np.concatenate([loop.source.point(s), loop.target.point(loop.to_target(s))], axis=1))
        return self._own(np.concatenate(rows))

    @property
    def runner_up(self) -> RunnerUp | None:
        """Second best correspondence of the loop that is least sure, if there is one."""
        found = [loop for loop in self.loops if loop.runner_up is not None]
        second = min(found, key=lambda loop: loop.margin).runner_up if found else None
        return second and replace(second, landmarks=self._own(second.landmarks))


def register(
    source: Sequence[Outline | Sequence[BSplineCurve]],
    target: Boundary,
    landmarks: ArrayLike | None = None,
    *,
    marked_curves: bool = False,
    single_patch: Sequence[Sequence[bool]] | None = None,
    sampled: Callable[[], BoundaryShape] | None = None,
    snap: bool = True,
) -> Registration:
    """Find the correspondence of source and target boundary.

    Parameters
    ----------
    source : loops of curves, or their outlines
        The source's boundary with the domain on the left, outer loop first (``multipatch.boundary().loops``).
    target : Boundary
        Loops in any order, sense, start and segmentation.
    landmarks : (r, 4) array, optional
        Rows (xs, ys, xt, yt): a point on the source boundary and its partner on the target's. Snapped to the
        curves.
    marked_curves : bool, default False
        Follow the paper for source curves that contain a landmark: a maximal run of them is placed by arc length
        between its unmarked neighbours, and the landmarks inside are not interpolated.
    single_patch : sequences of bool, optional
        Loop by loop, whether a single patch meets the source's joint: such joints do not go to reentrant corners.
    sampled : callable, optional
        Returns the source sampled without landmarks, for a source with many targets; asked for only where it is needed.
    snap : bool, default True
        Move source corners that land next to a corner of the target, turning alike, onto it.

    Returns
    -------
    Registration

    Raises
    ------
    InfeasibleTargetError
        When the numbers of loops differ.
    InputError
        On landmarks off the curves, out of order, or on loops that do not correspond; on target curves without
        length, loops without area and loops given twice; on source loops with the domain on their right.
    """
    source_loops = [loop if isinstance(loop, Outline) else Outline(loop) for loop in source]
    _check_sense(source_loops)
    target_loops = target_outlines(target)
    if len(source_loops) != len(target_loops):
        raise InfeasibleTargetError(
            f"the source has {len(source_loops) - 1} holes and the target {len(target_loops) - 1}: "
            f"{len(source_loops)} boundary loops against {len(target_loops)}; the same topology is needed"
        )
    placed = place_landmarks(read_landmark_rows(landmarks), source_loops, target_loops)
    partner = pair_by_landmarks(placed)
    given: dict[int, FloatArray] = {}
    for k in {int(row["source_loop"]) for row in placed}:
        outline, other = source_loops[k], target_loops[partner[k]]
        anchors = landmark_anchors(placed[placed["source_loop"] == k], outline, other, k)
        given[k] = anchors if marked_curves else corners_between(anchors, outline, other)
    single = single_patch or [[False] * len(outline.curves) for outline in source_loops]
    loops, warnings = _correspondences(source_loops, target_loops, partner, given, marked_curves, single, sampled, snap)
    missed: list[MissedCorner] = []
    tabs: list[MissedTab] = []
    for k, loop in enumerate(loops):
        if loop.margin < AMBIGUOUS:
            warnings.append(
                f"boundary loop {k}: the correspondence found without landmarks is ambiguous, another one fits nearly "
                "as well; if it matters which, give landmarks, or take the other one: --correspondence runner-up "
                "(correspondence='runner-up')"
            )
        of_loop = missed_corners(loop.source, loop.target, loop.anchors, k, target_loops[0].diameter)
        warnings += missed_warnings(of_loop)
        missed += of_loop
        tabs += missed_tabs(loop.source, loop.target, loop.anchors, k, {corner.side for corner in of_loop})
    if tabs:
        warnings.append(tab_text(tabs))
    found = tuple((loop.source, loop.target, loop.anchors) for loop in loops)
    measured, sure = None, 1.0
    if len(given) < len(loops):
        measured = mismatch(found)
        sure = confidence(measured, min(loop.margin for loop in loops), len(loops[0].features))
    return Registration(
        tuple(loops),
        tuple(warnings),
        tuple(missed),
        missed_tabs=tuple(tabs),
        confidence=sure,
        _found=found,
        _mismatch=measured,
    )


def _correspondences(
    source: Sequence[Outline],
    target: Sequence[Outline],
    partner: dict[int, int],
    given: dict[int, FloatArray],
    by_arc_length: bool,
    single: Sequence[Sequence[bool]],
    sampled: Callable[[], BoundaryShape] | None,
    snap: bool,
) -> tuple[list[LoopRegistration], list[str]]:
    """All loops, and warnings; `given` are the anchors of loops with landmarks, `partner` the loops they pair."""
    settled = {k for k, anchors in given.items() if by_arc_length or _covers_joints(source[k], anchors)}
    matches: dict[int, list[Match]] = {k: [Match(given[k], given[k][:-1], 0.0)] for k in settled}
    warnings: list[str] = []
    if len(settled) < len(source):
        partner, matches, warnings = _match_shapes(source, target, partner, given, matches, sampled)
    loops = []
    for k, outline in enumerate(source):
        best, other = matches[k][0], target[partner[k]]
        anchors = snap_corners(best.anchors, outline, other) if snap else best.anchors
        if by_arc_length and k in given:
            anchors = _place_marked(LoopRegistration(outline, other, anchors, 1.0))
        if not by_arc_length:
            anchors = joints_to_corners(anchors, outline, other, best.corners[:, 0], np.asarray(single[k], bool))
        second = matches[k][1] if len(matches[k]) > 1 else None
        runner_up = (
            None
            if second is None
            else RunnerUp(second.score, _landmark_rows(outline, other, second.anchors, second.corners))
        )
        margin = 1.0 if k in given else _margin(best, second)
        loops.append(LoopRegistration(outline, other, anchors, margin, best.corners, best.score, runner_up))
    return loops, warnings


def _covers_joints(outline: Outline, anchors: FloatArray) -> bool:
    """Whether every joint of a loop is an anchor."""
    gap = cyclic_gap(outline.joints[:-1], anchors[:-1, 0], outline.length)
    return bool((gap < SAME_PLACE * outline.length).all())


def _match_shapes(
    source: Sequence[Outline],
    target: Sequence[Outline],
    partner: dict[int, int],
    given: dict[int, FloatArray],
    settled: dict[int, list[Match]],
    sampled: Callable[[], BoundaryShape] | None,
) -> tuple[dict[int, int], dict[int, list[Match]], list[str]]:
    """Pair the loops that landmarks leave unpaired and match by shape those that are not `settled`."""
    none = np.empty((0, 2))
    fixed = {k: given[k][:-1] if k in given else none for k in range(len(source))}
    of_target = {partner[k]: rows for k, rows in fixed.items() if k in partner}
    if sampled is None or given:
        shape = BoundaryShape.sample(source, [fixed[k][:, 0] for k in range(len(source))])
    else:
        shape = sampled()
    other = BoundaryShape.sample(target, [of_target.get(t, none)[:, 1] for t in range(len(target))])
    otherwise = {k: Match(given[k], fixed[k], 0.0, by_arc_length=True) for k in given}
    outer = settled.get(0) or match_outer(shape, other, fixed[0]) or [otherwise[0]]
    best = WholeMatch((0,), (outer,))
    matches = {0: outer}
    if len(source) > 1:
        ranked = rank_with_holes(shape, other, outer, partner, fixed, settled, otherwise)
        best = ranked[0]
        matches = dict(enumerate(best.loops)) | {0: [whole.loops[0][0] for whole in ranked]}
    anchors = smooth(shape, other, best.partners, [matches[k][0] for k in range(len(source))], settled)
    for k in set(matches) - set(settled):
        matches[k][0] = replace(matches[k][0], anchors=anchors[k])
    warnings = [
        f"boundary loop {k}: no matching by shape keeps the landmarks (arcs differ too much in length); between them "
        "the correspondence starts from equal fractions of arc length"
        for k, found in matches.items()
        if k in otherwise and k not in settled and found[0].by_arc_length
    ]
    return dict(enumerate(best.partners)), matches, warnings


def _margin(best: Match, second: Match | None) -> float:
    """How much better the best matching is than the second, from 0 to 1."""
    # Candidates that are not worked out are at least this bad.
    other = HOPELESS * best.score + HOPE if second is None else second.score
    return float(np.clip((other - best.score) / (other + NO_SCORE), 0, 1))


def _landmark_rows(source: Outline, target: Outline, anchors: FloatArray, features: FloatArray) -> FloatArray:
    """Points (r, 4) at the `features`; with few of them, at evenly chosen joints as well."""
    pairs = features
    if len(pairs) < FEW_LANDMARKS:
        joints = source.joints[:-1]
        joints = joints[distinct(np.linspace(0, len(joints), JOINT_LANDMARKS, endpoint=False).astype(int))]
        joints = joints[cyclic_gap(joints, pairs[:, 0], source.length) > NEAR_CORNER * source.length]
        pairs = np.concatenate([pairs, np.column_stack([joints, image_of(anchors, joints)])])
    return np.concatenate([source.point(pairs[:, 0]), target.point(pairs[:, 1])], axis=1)


def target_outlines(target: Boundary) -> list[Outline]:
    """Outlines of the target, largest area first, turned so that the domain is on the left."""
    outlines = [Outline(loop) for loop in target.loops]
    _check_curves(target, outlines)
    _check_loops(outlines)
    outlines.sort(key=lambda outline: -abs(outline.area))
    return [
        outline if (outline.area > 0) == (k == 0) else Outline([c.reversed() for c in reversed(outline.curves)])
        for k, outline in enumerate(outlines)
    ]


def _check_sense(source: Sequence[Outline]) -> None:
    """Raise `InputError` on source loops that run with the domain on their right."""
    for k, outline in enumerate(source):
        if (outline.area > 0) != (k == 0):
            raise InputError(
                f"source boundary: loop {k} has the domain on its right; the outer loop comes first and runs "
                "counter-clockwise, holes run clockwise, as in multipatch.boundary(); reverse it"
            )


def _check_curves(target: Boundary, outlines: Sequence[Outline]) -> None:
    """Raise `InputError` on curves without length."""
    for k, outline in enumerate(outlines):
        at_most(
            len(outline.corners[0]),
            MAX_CORNERS,
            f"corners of loop {k} of the target boundary",
            "smooth it, or draw it with fewer points",
        )
        for i in np.flatnonzero(np.diff(outline.joints) <= SHORTEST * target.diameter):
            x, y = outline.curves[i].start
            raise InputError(
                f"target boundary: loop {k}, curve {i} at ({x:.6g}, {y:.6g}) has no length (a point given twice?); "
                "delete it"
            )


def _check_loops(outlines: Sequence[Outline]) -> None:
    """Raise `InputError` on loops that lie on a line and on loops that are there twice."""
    boxes = [_box(outline) for outline in outlines]
    for k, outline in enumerate(outlines):
        # A loop on a line has no area; one that crosses itself may have none either.
        if abs(outline.area) <= SHORTEST * outline.length**2 and _on_a_line(outline):
            raise InputError(f"target boundary: loop {k} encloses no area: it lies on one line; correct it")
        for j, other in enumerate(outlines[:k]):
            # Most pairs differ in length or place: measuring distances is for the few that do not.
            if abs(outline.length - other.length) <= SAME_PLACE * outline.length and _overlap(boxes[j], boxes[k]):
                distance = other.nearest(outline.polygon(64))[1].max()
                if distance <= SAME_PLACE * outline.length:
                    raise InputError(f"target boundary: loops {j} and {k} lie on each other; delete one of them")


def _box(outline: Outline) -> FloatArray:
    """Lower left and upper right corner of all control points."""
    points = np.concatenate([curve.control_points for curve in outline.curves])
    return np.array([points.min(axis=0), points.max(axis=0)])


def _overlap(a: FloatArray, b: FloatArray) -> bool:
    return bool((a[0] <= b[1]).all() and (b[0] <= a[1]).all())


def _on_a_line(outline: Outline) -> bool:
    points = outline.polygon(64)
    return bool(svd(points - points.mean(axis=0))[1][1] <= SHORTEST * outline.length)


def _place_marked(loop: LoopRegistration) -> FloatArray:
    """Anchors with every maximal run of marked curves placed by arc length between its end points (paper §3.2)."""
    joints, source = loop.source.joints, loop.source
    tolerance = SAME_PLACE * source.length
    landmarks = np.mod(loop.anchors[:-1, 0], source.length)
    inside = (landmarks[:, None] > joints[:-1] + tolerance) & (landmarks[:, None] < joints[1:] - tolerance)
    marked = inside.any(axis=0)
    if marked.all():
        return loop.anchors
    keep = ~inside.any(axis=1)
    # Every unmarked curve keeps the images of its ends; landmarks inside marked curves are dropped.
    ends = distinct(np.concatenate([joints[:-1][~marked], np.mod(joints[1:][~marked], source.length)]))
    rows = np.concatenate([loop.anchors[:-1][keep], np.column_stack([ends, loop.to_target(ends)])])
    rows[:, 1] -= np.floor(rows[:, 0] / source.length) * loop.target.length
    rows[:, 0] = np.mod(rows[:, 0], source.length)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    apart = np.append(np.diff(rows[:, 0]) > tolerance, True)
    return close_turn(rows[apart], loop.source, loop.target, loop.anchors)
