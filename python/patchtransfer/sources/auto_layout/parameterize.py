"""A parameterization from nothing but an outline: layouts proposed, filled, slid and judged, the best one kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import InfeasibleTargetError, InputError
from ...geometry.boundary import Boundary
from ...geometry.multipatch import MultiPatch
from ...geometry.outline import Outline, hausdorff
from ...geometry.rectangles import rectangles
from ...interior.interior_map import InteriorMap
from ...interior.polish import scaled_jacobian_goal
from ...interior.polish_report import GOALS
from ...interior.solver import CONTINUITY, InteriorSolver
from ...limits import MAX_LAYOUT_DEGREE, MAX_LAYOUT_POINTS, at_most
from ...measure.bounds import can_be_proved
from ...measure.quality import quality
from ...numeric.arrays import FloatArray, IntArray
from ...pipeline.options import Options
from ...pipeline.plan import TransferPlan
from ...pipeline.result import NotCertifiedError, TransferResult, failure_of
from ...progress import Budget, Clock
from ...proof.certificate import certify
from ...proof.feasibility import check_loops
from ...records import DEBUG, WARNING, record
from ..quad_layout import QuadLayout
from .assembly import AbstractLayout
from .convex import convex_layout
from .geometry import coarse, filled, misses, sliding
from .judging import Candidate, score, unmet
from .portfolio import Portfolio, Proposal
from .reasons import NoLayoutError
from .result import Parameterization
from .symmetry import Isometry, layout_symmetry, outline_symmetries, symmetrised

__all__ = ["parameterize"]

#: Layouts that are filled at most, and patches of all of them together: few outlines have more of the first, and what
#: has more of the second is large, with little to choose. Numbers, not seconds: the result is the same everywhere.
MOST_FILLED, MOST_PATCHES = 16, 800
#: Layouts whose joints slide at most, and patches of all of them: sliding takes ten times as long as filling, and
#: seldom turns the order.
MOST_SLID, MOST_SLID_PATCHES = 3, 150
#: Times that a layout gets edges where its sides miss the outline.
REPAIRS = 3
#: Mean scaled Jacobian that a polish may cost: what is no loss where the mean is .99.
LOST = 0.002
#: Told (stage, number of what is done there).
Tell = Callable[[str, int], None]


@dataclass(frozen=True)
class _Wishes:
    """What the user asked for."""

    degree: int
    spans: int
    max_patches: int | None
    prefer: str
    symmetric: str
    corner_patches: Mapping[tuple[int, int], int] | None
    continuity: str
    fit_tolerance: float
    polish: str | None
    deadline: float

    def late(self) -> bool:
        return time.monotonic() >= self.deadline


@dataclass(frozen=True)
class _Task:
    """An outline, loop by loop, its symmetries, and what is wanted of it."""

    boundary: Boundary
    outlines: Sequence[Outline]
    isometries: Sequence[Isometry]
    wishes: _Wishes


def parameterize(
    boundary: Boundary,
    *,
    degree: int = 3,
    spans: int = 3,
    max_patches: int | None = None,
    prefer: str = "few",
    symmetric: str = "auto",
    corner_patches: Mapping[tuple[int, int], int] | None = None,
    continuity: str = "c0",
    fit_tolerance: float = 1e-3,
    polish: str | None = "scaled_jacobian",
    time_limit: float | None = None,
    on_failure: str = "raise",
    progress: Tell | None = None,
) -> Parameterization:
    """Parameterize the inside of an outline: layout, patches and certificate.

    A cross field that follows the outline is integrated to a seamless map; the rectangles between its lines are merged
    to as few quads as pay (an integer program); every layout found is filled with patches, certified and judged.

    Parameters
    ----------
    boundary : Boundary
        One outer loop and any holes, in any order, sense and segmentation.
    degree : int, default 3
    spans : int, default 3
        Knot spans of every patch and direction.
    max_patches : int, optional
        Most patches.
    prefer : {"few", "quality"}, default "few"
        What counts more where one costs the other.
    symmetric : {"auto", "never"}, default "auto"
        "auto" gives outlines that are their own mirror or turned images patches that are, exactly, where the layout is.
    corner_patches : mapping of (loop, corner) to int, optional
        How many patches meet at a corner; corners of a loop are counted in its own order.
    continuity : {"c0", "c1", "g1"}, default "c0"
        Across patches, as of `transfer`.
    fit_tolerance : float, default 1e-3
        Boundary error, relative to the diameter.
    polish : {"scaled_jacobian", None}, default "scaled_jacobian"
        Whether the smallest scaled Jacobian of the patches of the best layout is made better, as by `transfer`.
    time_limit : float, optional
        Seconds after which no further layout is tried.
    on_failure : {"raise", "return"}, default "raise"
        Without a certified map: raise `NotCertifiedError`, or return the best one.
    progress : callable, optional
        Called as ``progress(stage, number)``; where it has a method ``ended(stage, seconds, found)``, that is called
        when a stage ends, with the figures that matter.

    Returns
    -------
    Parameterization
        A `TransferResult` with ``.layout`` and ``.candidates``.

    Raises
    ------
    InputError
        On options that cannot be.
    InfeasibleTargetError
        On an outline that crosses or touches itself, with the place.
    NotCertifiedError
        See `on_failure`; the message has the reasons of all candidates.

    Examples
    --------
    >>> from patchtransfer import Boundary, BSplineCurve
    >>> corners = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    >>> sides = [BSplineCurve([0, 0, 1, 1], 1, [a, b]) for a, b in zip(corners, corners[1:] + corners[:1])]
    >>> result = parameterize(Boundary([sides]))
    >>> len(result.multipatch.patches), result.certificate.status, round(result.quality.scaled_jacobian.min, 3)
    (3, 'certified', 1.0)
    """
    wishes = _Wishes(
        degree,
        spans,
        max_patches,
        prefer,
        symmetric,
        corner_patches,
        continuity,
        fit_tolerance,
        polish,
        np.inf if time_limit is None else time.monotonic() + time_limit,
    )
    _check(boundary, wishes, time_limit, on_failure)
    log: list[str] = []
    tell = progress or (lambda stage, number: None)
    clock = Clock(ended=getattr(progress, "ended", None))
    with clock("symmetries") as stage:
        outlines = [Outline(loop) for loop in boundary.loops]
        task = _Task(boundary, outlines, outline_symmetries(outlines) if symmetric == "auto" else [], wishes)
        stage.found = f"{len(task.isometries)} symmetries"
    with clock("layouts") as stage:
        candidates = _filled(task, log, tell)
        stage.found = _figures(candidates)
    with clock("sliding layouts") as stage:
        candidates = _slid(candidates, task, tell)
        stage.found = _figures(candidates)
    if not any(_certified(candidate) for candidate in candidates):
        tell("convex pieces", 0)
        with clock("convex pieces") as stage:
            convex = _slid(_last_resort(task, log), task, tell)
            stage.found = _figures(convex)
        candidates = _sorted([*candidates, *convex])
    if not candidates or candidates[0].result is None:
        reasons = [candidate.reason or "" for candidate in candidates[:3]] or log[-3:]
        raise NotCertifiedError(f"no parameterization was found: {'; '.join(reasons)}")
    best = candidates[0]
    tell("finish", 0)
    with clock("symmetry and continuity") as stage:
        result = _finished(best, task, log)
        stage.found = f"{result.certificate.status}, boundary error {result.boundary_error:.1e}"
    vertices = _vertices(best.layout, result.multipatch)
    places = {int(v): tuple(vertices[v].tolist()) for v in best.layout.boundary_vertices}
    layout = QuadLayout.abstract(best.layout.quads, vertices, places)
    found = Parameterization.of(replace(result, timings=clock.seconds), layout, candidates, log)
    for text in log:
        record(DEBUG, "%s", text)
    for text in found.warnings:
        record(DEBUG if clock.nested else WARNING, "%s", text)
    error = failure_of(found) if on_failure == "raise" else None
    if error is not None:
        raise error
    return found


def _check(boundary: Boundary, wishes: _Wishes, time_limit: float | None, on_failure: str) -> None:
    if not isinstance(boundary, Boundary):
        raise InputError(f"boundary must be a Boundary (see read_boundary), got {type(boundary).__name__}")
    choices = {
        "prefer": (wishes.prefer, ("few", "quality")),
        "symmetric": (wishes.symmetric, ("auto", "never")),
        "continuity": (wishes.continuity, CONTINUITY),
        # There is no source that a dilatation could be of.
        "polish": (wishes.polish, (GOALS[0], None)),
    }
    for name, (value, allowed) in choices.items():
        if value not in allowed:
            raise InputError(f"{name} must be one of {', '.join(map(str, allowed))}, got {value!r}")
    # What a transfer has as well is checked as there.
    Options(fit_tolerance=wishes.fit_tolerance, on_failure=on_failure, time_limit=time_limit)
    numbers = {"degree": wishes.degree, "spans": wishes.spans, "max_patches": wishes.max_patches}
    for name, number in numbers.items():
        if number is None and name == "max_patches":
            continue
        if not isinstance(number, int | np.integer) or number < 1:
            raise InputError(f"{name} must be an integer of at least 1, got {number!r}")
    at_most(wishes.degree, MAX_LAYOUT_DEGREE, "as degree", "take a lower one (2 or 3 are usual)")
    at_most((wishes.degree + wishes.spans) ** 2, MAX_LAYOUT_POINTS, "control points of a patch", "take fewer spans")
    for corner in wishes.corner_patches or {}:
        if not (isinstance(corner, tuple) and len(corner) == 2):
            raise InputError(f"corner_patches: keys are pairs (loop, corner), got {corner!r}")
    if wishes.continuity == "g1" and (wishes.degree < 3 or wishes.spans < 2):
        raise InputError('continuity="g1" needs degree 3 or more and two spans')
    notes = check_loops(boundary.loops, "outline")
    if notes:
        raise InfeasibleTargetError(f"{notes[0]}; separate the curves there")


def _filled(task: _Task, log: list[str], tell: Tell) -> list[Candidate]:
    """All layouts of the portfolio with their patches, the best first."""
    candidates: list[Candidate] = []
    tell("cross field", 0)
    try:
        portfolio = Portfolio(
            task.boundary,
            task.isometries,
            task.wishes.prefer,
            task.wishes.max_patches,
            task.wishes.corner_patches,
            log.append,
        )
        for proposal in portfolio:
            candidates += _tried(proposal, portfolio, task)
            tell("layouts", len(candidates))
            work = sum(len(candidate.layout.quads) for candidate in candidates)
            if len(candidates) >= MOST_FILLED or work >= MOST_PATCHES or task.wishes.late():
                break
    except NoLayoutError as error:
        log.append(str(error))
    return _sorted(candidates)


def _tried(proposal: Proposal, portfolio: Portfolio, task: _Task) -> list[Candidate]:
    """A proposal filled, and again with more edges where its sides miss the outline or its angles are bad."""
    found = []
    current: Proposal | None = proposal
    for _ in range(REPAIRS + 1):
        assert current is not None
        candidate = _candidate(current.layout, current.origin, task)
        found.append(candidate)
        missed = [] if candidate.result is None else misses(candidate.result, task.outlines, task.wishes.fit_tolerance)
        if not missed and candidate.reason is None and candidate.result is not None:
            missed = coarse(candidate.result, current.layout, task.outlines)
        if not missed or task.wishes.late():
            break
        current = portfolio.with_more_edges(current, missed)
        if current is None:
            break
    return found


def _candidate(layout: AbstractLayout, origin: str, task: _Task) -> Candidate:
    reason = unmet(layout, task.outlines, task.wishes.max_patches, task.wishes.corner_patches)
    if reason is not None:
        return Candidate(layout, origin, None, -np.inf, reason)
    try:
        result = filled(
            layout, task.boundary, task.outlines, task.wishes.degree, task.wishes.spans, task.wishes.fit_tolerance
        )
    except NoLayoutError as error:
        return Candidate(layout, origin, None, -np.inf, str(error))
    return _judged(Candidate(layout, origin, result, 0.0), result, task)


def _judged(candidate: Candidate, result: TransferResult, task: _Task) -> Candidate:
    if not result.certificate.injective:
        reason = str(result.certificate) if result.failure is None else result.failure.reason
        return replace(candidate, result=result, score=-np.inf, reason=reason)
    return replace(
        candidate,
        result=result,
        score=score(result, task.wishes.prefer, task.outlines, task.wishes.fit_tolerance),
        reason=None,
    )


def _slid(candidates: Sequence[Candidate], task: _Task, tell: Tell) -> list[Candidate]:
    """The best candidates with their joints slid, where that is better."""
    out: list[Candidate] = []
    work = 0
    for k, candidate in enumerate(candidates):
        work += len(candidate.layout.quads)
        few = k < MOST_SLID and work <= MOST_SLID_PATCHES
        if few and candidate.result is not None and candidate.reason is None and not task.wishes.late():
            tell("sliding", k)
            for moved in sliding(
                candidate.result, candidate.layout, task.boundary, task.outlines, task.wishes.fit_tolerance
            ):
                judged = _judged(candidate, moved, task)
                if judged.score <= candidate.score:
                    break
                candidate = judged
        out.append(candidate)
    return _sorted(out)


def _sorted(candidates: Sequence[Candidate]) -> list[Candidate]:
    return sorted(candidates, key=lambda candidate: -candidate.score)


def _figures(candidates: Sequence[Candidate]) -> str:
    """What the layouts found so far are worth, for those who watch."""
    certified = [candidate for candidate in candidates if _certified(candidate)]
    best = f", the best of {len(certified[0].layout.quads)} patches" if certified else ""
    return f"{len(candidates)} layouts, {len(certified)} certified{best}"


def _certified(candidate: Candidate) -> bool:
    return candidate.result is not None and candidate.result.certificate.status == "certified"


def _last_resort(task: _Task, log: list[str]) -> list[Candidate]:
    log.append("no layout of the cross field was certified: convex pieces, quads round their middles")
    try:
        layout = convex_layout(task.outlines)
    except NoLayoutError as error:
        log.append(str(error))
        return []
    return [_candidate(layout, "convex pieces", task)]


def _vertices(layout: AbstractLayout, multipatch: MultiPatch) -> FloatArray:
    """Where the vertices of a layout have come to lie (n, 2)."""
    places = np.empty((len(layout.valence), 2))
    for quad, patch in zip(layout.quads, multipatch.patches, strict=True):
        net = patch.control_points
        places[quad] = net[0, 0], net[-1, 0], net[-1, -1], net[0, -1]
    return places


def _finished(best: Candidate, task: _Task, log: list[str]) -> TransferResult:
    """The best candidate, symmetric where the outline is, and joined as asked for."""
    assert best.result is not None
    result = best.result
    if best.reason is None and result.boundary_error > task.wishes.fit_tolerance:
        log.append(f"boundary error {result.boundary_error:.1e}: knots are inserted where sides miss the outline")
        result = _joined(result.multipatch, task, "c0", refine="tolerance")
    elif best.reason is None:
        wanted = task.wishes.polish is not None and task.wishes.continuity == "c0"
        if wanted and result.certificate.status == "certified":
            result = _polished(result, log)
        result = _symmetric(best, result, task, log)
    if task.wishes.continuity != "c0" and result.certificate.injective:
        source = result.multipatch
        if task.wishes.continuity == "g1":
            source = source.reduce_continuity(task.wishes.degree - 2)
        result = _joined(source, task, task.wishes.continuity)
    return result


def _polished(result: TransferResult, log: list[str]) -> TransferResult:
    """The same boundary with a better worst place inside."""
    start, clock = result.multipatch, Clock()
    solver = InteriorSolver(start, "c0")
    found = solver.polished(
        InteriorMap(start.topology.coordinates, result.certificate, [], []),
        scaled_jacobian_goal(start, least_mean=result.quality.scaled_jacobian.mean - LOST),
        (),
        clock,
        Budget.of_source(solver.step_cost),
        result.certificate.boundary,
    )
    log += [*found.log, *found.notes]
    if found.polish is None or found.polish.power == 1:
        return result
    model = solver.model(found.points)
    metrics = quality(model, proved=True)
    return replace(result, multipatch=model, certificate=found.certificate, quality=metrics, polish=found.polish)


def _joined(source: MultiPatch, task: _Task, continuity: str, refine: str = "never") -> TransferResult:
    """The same layout with its boundary vertices where they are, once more: smoother, or with more knots."""
    joints = np.array([curve.start for loop in source.boundary().loops for curve in loop])
    plan = TransferPlan(source, continuity, reference=rectangles(source))
    return plan.transfer(
        task.boundary,
        np.column_stack([joints, joints]),
        fit_tolerance=task.wishes.fit_tolerance,
        refine=refine,
        on_failure="return",
        polish=task.wishes.polish,
    )


def _symmetric(
    best: Candidate,
    result: TransferResult,
    task: _Task,
    log: list[str],
) -> TransferResult:
    """The result with control points that are the mean of their images, where that meets the outline."""
    layout, diameter = best.layout, task.boundary.diameter
    places = _vertices(layout, result.multipatch)[layout.boundary_vertices]
    group: list[tuple[Isometry, IntArray]] = []
    found = task.isometries
    for isometry in found:
        image = layout_symmetry(layout.quads, layout.boundary_vertices, places, isometry, diameter)
        if image is not None:
            group.append((isometry, image))
    if not group:
        if found:
            log.append(f"the outline has {len(found)} symmetries; the layout has none of them")
        return result
    source = symmetrised(result.multipatch, layout.quads, group)
    certificate = certify(source)
    # Loops are ordered by their sizes, which equal holes exchange.
    targets = [loop.target for loop in result.registration.loops]
    loops = [Outline(loop) for loop in source.boundary().loops]
    error = max(min(hausdorff(loop, target) for target in targets) for loop in loops) / diameter
    if certificate.status != result.certificate.status or error > max(task.wishes.fit_tolerance, result.boundary_error):
        log.append(f"symmetric patches would miss the outline by {error:.1e}; left as they are")
        return result
    log.append(f"symmetric under {len(group)} of {len(found)} symmetries of the outline")
    return replace(
        result,
        multipatch=source,
        certificate=certificate,
        quality=quality(source, proved=can_be_proved(source)),
        boundary_error=error,
    )
