"""The driver: source multi-patch + target boundary -> the same patches on the target, with a proof.

Reads like the pipeline: register, fit, refine, pose, slide, solve, measure. Each stage is a module of its own that
takes and returns plain values.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple, Unpack

from numpy.typing import ArrayLike

from ..errors import InfeasibleTargetError, InputError, TransferError
from ..fitting.refinement import Knot, lone_spans, span_middles
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..gradients.frozen import Frozen
from ..interior.solver import InteriorSolver
from ..measure.quality import quality
from ..progress import FIRST, Progress
from ..registration.lacking_joints import LackingJoint, lacking_joints
from ..registration.register import Registration
from .accepted import accepted, check_polynomial
from .divisions import Division, SourceSplit, cut, divided_again, with_corners_opened
from .inside import attempt
from .kept_curves import kept_or_loose
from .mirrored import MIRROR_IMAGE, POOR, Reflection, mirrored_rows, of_own_sides, reflected, told
from .opening import smooth_corners
from .options import Run, TransferOptions
from .posed import Registered
from .refilled import Refilled, filled, frozen
from .refined import Finer, finer, to_tolerance
from .result import TransferResult, failure_of, split_advice
from .sliding import movable_joints
from .smoother import smoothed
from .source_boundary import SourceBoundary
from .split_or_whole import split_or_whole
from .splitting import onto_split, with_near_joints_moved
from .tasks import TransferTask, in_order

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["Refilled", "TransferPlan"]

#: Part of the work for a source as it is, and for the refined one, where both may be tried.
HALF = 0.5
#: What a step on a source with all spans halved costs, in steps on the source itself.
HALVED = 4


class TransferPlan:
    """All source-only work of a transfer, done once for many targets.

    Parameters
    ----------
    source : MultiPatch
    continuity : {"c0", "c1", "g1"}, default "c1"
    reference : sequence of Patch, optional
        Maps that distortion is measured against, one a patch on the same knots; default the source's own patches.
    ratios : {"target", "source"}, default "target"
        Speeds and frames that continuity rows follow, as in `patchtransfer.transfer`.

    Attributes
    ----------
    source : MultiPatch
    split : SourceSplit or None
        How the source was split, if this plan comes from `split_for`.

    Raises
    ------
    InputError
        On a source that is folded (naming the patch), disconnected, or for "g1" rational or without enough freedom.

    Examples
    --------
    >>> from patchtransfer.examples import load
    >>> [result.certificate.status for result in TransferPlan(load("star")[0]).map([load("star")[1]])]
    ['certified']
    """

    def __init__(
        self,
        source: MultiPatch,
        continuity: str = "c1",
        *,
        reference: Sequence[Patch] | None = None,
        ratios: str = "target",
    ) -> None:
        self._welded, self._notes = accepted(source, continuity, ratios)
        # Put straight where rounding had bent it, which a note says; else as given.
        self.source = source = self._welded if self._notes else source
        self.continuity, self.ratios, self.reference = continuity, ratios, reference
        topology = source.topology
        self._boundary = SourceBoundary(self._welded.boundary().loops, topology, partial(quality, source))
        self._interior = InteriorSolver(source, continuity, reference, ratios)
        self.split: SourceSplit | None = None
        self._unsplit: Unsplit | None = None

    def __repr__(self) -> str:
        return f"<TransferPlan: {len(self.source.patches)} patches, continuity {self.continuity}>"

    def transfer(
        self,
        target: Boundary,
        landmarks: ArrayLike | None = None,
        *,
        progress: Progress | None = None,
        **options: Unpack[TransferOptions],
    ) -> TransferResult:
        """Transfer to one target; parameters as in `patchtransfer.transfer`."""
        run = Run.of(options, self._interior.step_cost, progress, self.continuity)
        begun = self._begun(target, landmarks, run)
        return begun.owner._ended(begun, run)

    def register(
        self, target: Boundary, landmarks: ArrayLike | None = None, **options: Unpack[TransferOptions]
    ) -> Registration:
        """Look before the work: which boundary points correspond, how sure that is, and what to expect of a map.

        Parameters are those of `transfer`; nothing is transferred. See `Registration` for what it has: ``confidence``,
        ``expected``, ``mismatch``, ``warnings``, ``landmarks`` to correct and hand back.
        """
        return self._begun(target, landmarks, Run.of(options, self._interior.step_cost)).registered.registration

    def _begun(self, target: Boundary, landmarks: ArrayLike | None, run: Run) -> Begun:
        """A transfer as far as its correspondence, for `_ended` of its owner: many are looked at before one goes on."""
        if run.options.method == "paper":
            check_polynomial(self.source, 'method="paper"')
        if run.options.ratios not in (None, self.ratios):
            return self._of_other_ratios._begun(target, landmarks, run)
        try:
            plan, registered = self._faced(target, landmarks, run)
        except InfeasibleTargetError as error:
            # What fails before there is a correspondence, as a target that crosses itself, fails in the mirror as well.
            if "registration" in run.clock.seconds and self._looks_mirrored(target, landmarks, None, run):
                error.args = (f"{error}; {MIRROR_IMAGE}", *error.args[1:])
            raise
        return Begun(self, plan, registered, target, landmarks)

    def _ended(self, begun: Begun, run: Run) -> TransferResult:
        """The result of a transfer with its correspondence."""
        _, plan, registered, target, landmarks = begun
        given = landmarks if plan is self else mirrored_rows(landmarks)
        search = partial(split_or_whole, plan) if run.options.split == "auto" else plan._searched
        result = kept_or_loose(search, registered, given, run)
        if plan is not self:
            result = told(result, self.source)
        elif not result.succeeded or registered.registration.loops[0].score > POOR:
            mirrored = self._looks_mirrored(target, landmarks, registered.registration, run)
            result = replace(result, looks_mirrored=mirrored)
        notes = [MIRROR_IMAGE] if result.looks_mirrored else []
        advice = split_advice(result) if result.succeeded else None
        result = result.with_warnings(notes if advice is None else [*notes, advice])
        run.record(result.log, result.warnings)
        failure = failure_of(result) if run.options.on_failure == "raise" else None
        if failure is not None:
            raise failure
        return result

    def _alike(self, source: MultiPatch, reference: Sequence[Patch] | None) -> TransferPlan:
        """A plan for another source that is made as this one is."""
        return TransferPlan(source, self.continuity, reference=reference, ratios=self.ratios)

    @cached_property
    def _of_other_ratios(self) -> TransferPlan:
        plan = copy(self)
        plan.__dict__.pop("_mirrored", None)
        plan._unsplit = self._unsplit and self._unsplit._replace(plan=self._unsplit.plan._of_other_ratios)
        plan.ratios = "target" if self.ratios == "source" else "source"
        plan._interior = InteriorSolver(self.source, self.continuity, self.reference, plan.ratios)
        return plan

    def _faced(self, target: Boundary, landmarks: ArrayLike | None, run: Run) -> tuple[TransferPlan, Registered]:
        """The correspondence, and the plan that it is of: this one's or, if asked for, its mirror image's."""
        failed, registered = None, None
        try:
            registered = self._registered(target, landmarks, run)
        except TransferError as error:
            if run.options.mirror == "never":
                raise
            failed = error
        if run.options.mirror == "auto" and isinstance(target, Boundary):
            # Which of the correspondences to take is another question.
            best = run.options.correspondence == "best"
            plain = registered.registration if registered is not None and best else None
            with run.clock("registration"):
                mirrored = self._reflection.fits(target, landmarks, plain)
            if mirrored:
                return self._mirrored, self._mirrored._registered(target, mirrored_rows(landmarks), run)
        if registered is None:
            assert failed is not None
            raise failed
        return self, registered

    def _looks_mirrored(
        self, target: Boundary, landmarks: ArrayLike | None, plain: Registration | None, run: Run
    ) -> bool:
        """Whether to say that the option `mirror` would help."""
        if run.options.mirror == "auto" or landmarks is not None:
            return False
        with run.clock("registration"):
            return self._reflection.fits(target, None, plain)

    @cached_property
    def _reflection(self) -> Reflection:
        return Reflection(self._boundary.outlines)

    @cached_property
    def _mirrored(self) -> TransferPlan:
        """The plan of the source's mirror image."""
        reference = None if self.reference is None else reflected(self.reference)
        if self._unsplit is None:
            source = self.source
            turned = MultiPatch(reflected(source), source.interfaces, source.ids, source.sides, source.blocks)
            plan = self._alike(turned, reference)
        else:
            older = self._unsplit
            image = older.plan._mirrored
            plan = image._divided(divided_again(image._welded, image.reference, older.division))
        plan._notes = self._notes
        return plan

    def _registered(self, target: Boundary, landmarks: ArrayLike | None, run: Run) -> Registered:
        """The correspondence; of a split source what it was before, with the new joints at corners that lacked one."""
        if not isinstance(target, Boundary):
            raise InputError(f"target must be a Boundary (see read_boundary), got {type(target).__name__}")
        if self._unsplit is None:
            return self._boundary.register(target, landmarks, run)
        registered = self._unsplit.plan._with_near_joints_moved(self._unsplit.plan._registered(target, landmarks, run))
        return self._onto_split(registered, run)

    def _searched(self, registered: Registered, landmarks: ArrayLike | None, run: Run) -> TransferResult:
        """The result with the plan's own patches, the source refined where that is asked for and helps."""
        chosen = run.options
        movable = [] if chosen.fixed_correspondence else movable_joints(registered.registration, landmarks)
        now, notes = Finer(self._boundary, self._interior, registered, self._with_knots), list(self._notes)
        fitted = now.fit(run)
        if chosen.refines:
            run = run.part(HALF)
        if fitted.error > chosen.refined_beyond:
            now, fitted, refined = to_tolerance(now, fitted, run)
            notes += refined
        result = attempt(now.registered, fitted, movable, now.boundary, now.interior, run)
        enough = run.budget.steps(HALVED * now.interior.step_cost, FIRST) == FIRST
        if chosen.refines and not result.certificate.injective and enough:
            with run.clock("refinement") as stage:
                now = now.refine(span_middles(now.source.patches), now.registered)
                stage.found = f"all spans halved, {now.source.topology.n_points} control points"
            finer = attempt(now.registered, now.fit(run), movable, now.boundary, now.interior, run)
            if finer.certificate.injective:
                result, note = finer, "the source was refined uniformly: one knot in every span of every patch"
            else:
                result = replace(result, refined_in_vain=True)
                note = "a uniform refinement of the source was tried: no certified map was found"
            notes.append(note)
        if self.continuity == "c1" and chosen.method == "certified" and result.certificate.injective:
            result = smoothed(result, now, run)
        return replace(
            result.with_warnings(notes),
            refined=result.multipatch.topology.n_points != self.source.topology.n_points,
            split=None if self.split is None else replace(self.split, corners=registered.handed),
        )

    def _with_near_joints_moved(self, registered: Registered) -> Registered:
        """The same with free joints at corners near by; itself if there are none."""
        before = registered.registration
        moved = with_near_joints_moved(before, self._boundary.single)
        return registered if moved is before else registered._replace(registration=moved)

    def _onto_split(self, registered: Registered, run: Run) -> Registered:
        """A correspondence with the source as it was, with this plan's: its joints at corners that lacked one."""
        assert self._unsplit is not None
        tolerance = run.options.fit_tolerance
        with run.clock("registration"):
            before = registered.registration
            registration = onto_split(before, tolerance, self._unsplit.division, self._boundary.outlines)
        left = {corner.point for corner in lacking_joints(registration, tolerance)}
        corners = [corner.point for corner in lacking_joints(before, tolerance)]
        handed = tuple(point for point in corners if point not in left)
        return registered._replace(registration=registration, handed=(*registered.handed, *handed))

    def _split(self, lacking: Sequence[Sequence[LackingJoint]]) -> TransferPlan:
        """A plan for the source split so that corners of targets that lack joints, target by target, get them."""
        return self._divided(cut(self._welded, self.reference, lacking))

    def _opened(self, corners: Sequence[tuple[int, int]]) -> TransferPlan:
        """A plan for the source with these of its corners opened for a second patch; itself if they cannot be."""
        return self._divided(with_corners_opened(self._welded, self.reference, corners))

    def _divided(self, division: Division | None) -> TransferPlan:
        """A plan for what the source was divided into; itself if it was not."""
        if division is None:
            return self
        source, reference = division.model.multipatch, division.reference
        if self.continuity == "g1":
            # Pieces may have a single span, which locks exact G1.
            source, reference = finer(source, reference, lone_spans(source.patches), 2)
        plan = self._alike(source, reference)
        plan._unsplit = Unsplit(self, division)
        plan.split = division.report(self.split)
        plan._notes += division.model.lost
        return plan

    def split_for(
        self,
        targets: Iterable[Boundary],
        landmarks: Iterable[ArrayLike | None] | None = None,
        *,
        skip_failures: bool = False,
        **options: Unpack[TransferOptions],
    ) -> TransferPlan:
        """A plan for the source split wherever one of the targets needs it: all results have the same patches.

        Parameters
        ----------
        targets : iterable of Boundary
        landmarks : iterable of (r, 4) arrays or None, optional
            One a target, as for `transfer`.
        skip_failures : bool, default False
            Leave out targets that cannot be registered; to transfer to them says why.
        **options
            As for `transfer`; those on the correspondence, and `fit_tolerance`, matter.

        Returns
        -------
        TransferPlan
            Its ``split`` tells how, and from which patch of the source each of its own comes; this plan itself, if
            its patches suffice. `transfer` with the default ``split="never"`` matches corners to its new joints.

        Raises
        ------
        TransferError
            As `transfer` does, for a target that cannot be registered; the message begins with "targets[3]: ".

        Examples
        --------
        >>> from patchtransfer import Boundary, MultiPatch, Patch
        >>> knots = ([0, 0, 1, 1], [0, 0, 1, 1])
        >>> plan = TransferPlan(MultiPatch([Patch(knots, (1, 1), [[[0, 0], [0, 1]], [[3, 0], [3, 1]]])]), "c0")
        >>> roof = Boundary.from_points([(0, 0), (3, 0), (3, 1), (1.5, 1.6), (0, 1)])
        >>> plan.split_for([roof])
        <TransferPlan: 2 patches, continuity c0>
        """
        run = Run.of(options, self._interior.step_cost)
        targets = list(targets)
        given = [None] * len(targets) if landmarks is None else list(landmarks)
        if len(given) != len(targets):
            raise InputError(f"split_for: landmarks are one set a target or none, got {len(given)} for {len(targets)}")
        lacking, smooth = [], dict[tuple[int, int], None]()
        for number, pair in enumerate(zip(targets, given, strict=True)):
            try:
                plan, registered = self._faced(*pair, run)
                near = plan._with_near_joints_moved(registered)
            except Exception as error:
                if skip_failures:
                    continue
                if isinstance(error, TransferError):
                    error.args = (f"targets[{number}]: {error}", *error.args[1:])
                raise
            corners = lacking_joints(near.registration, run.options.fit_tolerance)
            lacking.append(
                corners if plan is self else of_own_sides(corners, plan._welded.topology, self._welded.topology)
            )
            # Patches of the mirror image keep their numbers and corners.
            smooth |= dict.fromkeys(smooth_corners(near.registration, plan._welded.topology, plan._boundary.single))
        plan = self._split(lacking)
        before = None if plan is self else plan._unsplit
        pieces = [corner if before is None else before.division.model.piece_at(*corner) for corner in smooth]
        return plan._opened(pieces) if pieces else plan

    def map(
        self,
        targets: Iterable[Boundary | tuple[Boundary, ArrayLike]],
        executor: Executor | None = None,
        **options: object,
    ) -> Iterator[TransferResult]:
        """Transfer to many targets, lazily and in order.

        Parameters
        ----------
        targets : iterable of Boundary, or of pairs (Boundary, landmarks)
        executor : concurrent.futures.Executor, optional
            Runs the targets in parallel; None (the default) one after the other, with threads inside the core. A
            process pool works on every target with one thread; small models gain from processes, for much of their
            time is Python's. Of a small source several targets go to a worker at once.
        **options
            As in `transfer`; a ``time_limit`` is for every target by itself. ``split="auto"`` splits for each target by
            itself, so that results differ in their patches: ``plan.split_for(targets).map(targets)`` has one set.

        Raises
        ------
        TransferError
            As `transfer` does, when the target's turn comes; the message begins with its place, as in "targets[3]: ".
        """
        task, numbered = TransferTask(self.transfer, options), enumerate(targets)
        if executor is None:
            return map(task, numbered)
        return in_order(task, list(numbered), executor, self.source.topology.n_points)

    def refill(self, points: ArrayLike, progress: Progress | None = None) -> Refilled:
        """Parameterize a boundary that is given on the source's own sides: no registration, no fit.

        Parameters
        ----------
        points : (n_points, 2) array
            Shared control points with the new boundary; interior points do not matter.
        progress : callable, optional
            As in `transfer`.

        Returns
        -------
        Refilled
            Its certificate says whether a map was found.

        Raises
        ------
        InputError
            On another shape or NaN.
        InfeasibleTargetError
            When the boundary crosses itself, or a single patch would have to fill more than 180 degrees.
        """
        found, _ = filled(points, self._boundary, self._interior, progress, "refill")
        return Refilled(self.source.with_shared_points(found.points), found.certificate, tuple(found.log))

    def freeze(self, points: ArrayLike | None = None, progress: Progress | None = None) -> Frozen:
        """The map on a boundary as a smooth function of that boundary, with derivatives.

        Continuity rows, released ends, excluded corners and the energy's nodes are those of `refill`'s map. See
        ``docs/gradients.md``.

        Parameters
        ----------
        points : (n_points, 2) array, optional
            As in `refill`; default the source's own.
        progress : callable, optional
            As in `transfer`.

        Returns
        -------
        Frozen

        Raises
        ------
        InputError, InfeasibleTargetError
            As `refill`.
        NotCertifiedError
            When no certified map is found.

        Examples
        --------
        >>> import numpy as np
        >>> from patchtransfer import TransferPlan, examples
        >>> source, _, _ = examples.load("star")
        >>> frozen = TransferPlan(source).freeze()
        >>> filled = frozen.fill(1.01 * frozen.boundary)
        >>> filled.certificate.status
        'certified'
        >>> filled.jvp(frozen.boundary).shape == filled.points.shape
        True
        """
        given = self.source.topology.coordinates if points is None else points
        return frozen(given, self._boundary, self._interior, progress)

    def _with_knots(self, knots: Sequence[Knot], registered: Registered) -> Finer:
        plan, registered = self._refined(knots, registered)
        return Finer(plan._boundary, plan._interior, registered, plan._with_knots)

    def _refined(self, knots: Sequence[Knot], registered: Registered) -> tuple[TransferPlan, Registered]:
        """A plan for the source with more knots, and the same correspondence with its boundary curves."""
        # Exact G1 needs inner knots of C^(p - 2): simple ones would lock its rows.
        multiplicity = 2 if self.continuity == "g1" else 1
        source, reference = finer(self._welded, self.reference, knots, multiplicity)
        plan = self._alike(source, reference)
        return plan, registered._replace(registration=plan._boundary.registered(registered.registration))


class Unsplit(NamedTuple):
    """The plan of a source before it was divided, and how it was."""

    plan: TransferPlan
    division: Division


class Begun(NamedTuple):
    """A transfer with its correspondence: the plan that it was asked of, and that which it is of.

    The latter is another one for a source's mirror image.
    """

    owner: TransferPlan
    plan: TransferPlan
    registered: Registered
    target: Boundary
    landmarks: ArrayLike | None
