"""One target's way through the models of a library: cheap looks at all, dear ones at few."""

from __future__ import annotations

import collections
from dataclasses import replace

from ..errors import InputError, TransferError
from ..geometry.boundary import Boundary
from ..pipeline.options import Run, TransferOptions, options_of
from ..pipeline.plan import Begun
from ..pipeline.result import TransferResult, failure_of
from ..progress import Clock, Progress
from ..proof.feasibility import check_loops
from ..registration.register import target_outlines
from ..registration.signature import Signature, signature
from .choice import PARAMETERIZE, LibraryResult
from .models import Models, StaleError
from .ranked import STAGES, Ranked

__all__ = ["Search"]

#: Candidates that are tried for every one that is to be registered, at most: some cannot be.
LOOKS = 2


class Search:
    """One target's way through a library."""

    def __init__(self, models: Models, target: Boundary, options: TransferOptions, progress: Progress | None) -> None:
        if not isinstance(target, Boundary):
            raise InputError(f"target must be a Boundary (see read_boundary), got {type(target).__name__}")
        options_of(options).decided(models.continuity)
        self._models, self._target = models, target
        self._progress = None if progress is None else _Unwarned(progress)
        # Which of several results to take is decided at the end.
        self._options: TransferOptions = {**options, "on_failure": "return"}
        self._clock = Clock(progress)
        self.begun: dict[str, tuple[Begun, dict[str, float]]] = {}
        self._results: dict[str, TransferResult] = {}
        self.candidates: dict[str, Ranked] = {}
        outlines = target_outlines(target)
        check_loops(target.loops, "target boundary")
        self._loops = len(outlines)
        with self._clock("signatures") as stage:
            models.known()
            self._signature = signature(outlines)
            stage.found = f"{len(models.entries)} models"
        self._compare(self._signature)

    def _compare(self, own: Signature) -> None:
        """All models by number of loops and signature."""
        self.candidates = {}
        for name, (of, refusal) in self._models.known().items():
            if of.loops != own.loops:
                reason = f"{of.loops} boundary loops, the target has {own.loops}"
                self.candidates[name] = Ranked(name, "loops", of.loops, reason=reason)
            elif refusal is not None:
                self.candidates[name] = Ranked(name, "source", of.loops, of.distance(own), reason=refusal)
            else:
                self.candidates[name] = Ranked(name, "signature", of.loops, of.distance(own))

    def register(self, keep: int) -> None:
        """Register the nearest ones by signature."""
        if keep < 1:
            raise InputError(f"keep must be at least 1, got {keep}")
        with self._clock("registration") as stage:
            try:
                self._register(keep)
            except StaleError:
                self._models.look_again()
                self.begun = {}
                self._compare(self._signature)
                self._register(keep)
            stage.found = f"{len(self.begun)} candidates"

    def _register(self, keep: int) -> None:
        near = sorted(self._at("signature"), key=lambda c: (c.distance, c.name))
        for candidate in near[: LOOKS * keep]:
            if len(self.begun) == keep:
                break
            self._register_one(candidate)
        for candidate in self._at("signature"):
            self._set(candidate, reason=f"{len(self.begun)} others are nearer by signature")

    def _register_one(self, candidate: Ranked) -> None:
        try:
            plan = self._models.plan(candidate.name)
            run = Run.of(self._options, plan._interior.step_cost, self._progress, plan.continuity)
            begun = plan._begun(self._target, None, run)
        except TransferError as error:
            self._set(candidate, stage="registration", status="not registered", reason=str(error))
            return
        registration = begun.registered.registration
        self.begun[candidate.name] = begun, run.clock.seconds
        self._set(
            candidate,
            stage="registration",
            score=registration.loops[0].score,
            confidence=registration.confidence,
            expected=registration.expected and registration.expected.min_scaled_jacobian.median,
        )

    def transfer(self, tries: int) -> None:
        """Transfer the best ones with their registration, and more of them while none succeeds."""
        by_score = sorted(self.begun, key=lambda name: self.candidates[name].score or 0.0)
        with self._clock("transfer") as stage:
            for number, name in enumerate(by_score):
                if number >= tries and self.succeeded:
                    self._set(self.candidates[name], reason=f"{number} others fit better by registration")
                else:
                    self._transfer_one(name)
            stage.found = f"{len(self._results)} candidates"

    def _transfer_one(self, name: str) -> None:
        begun, seconds = self.begun[name]
        run = Run.of(self._options, begun.owner._interior.step_cost, self._progress, begun.owner.continuity)
        run.clock.seconds.update(seconds)
        try:
            self._tried(name, begun.owner._ended(begun, run))
        except TransferError as error:
            self._set(self.candidates[name], stage="transfer", status="failed", reason=str(error))

    def parameterize(self) -> None:
        """A layout of the target's own."""
        from ..sources.auto_layout import parameterize

        options = options_of(self._options)
        self.candidates[PARAMETERIZE] = Ranked(PARAMETERIZE, "transfer", self._loops)
        with self._clock("parameterize") as stage:
            try:
                result = parameterize(
                    self._target,
                    continuity=self._models.continuity,
                    fit_tolerance=options.fit_tolerance,
                    time_limit=options.time_limit,
                    on_failure="return",
                )
                self._tried(PARAMETERIZE, result)
                stage.found = f"{len(result.multipatch.patches)} patches, {result.certificate.status}"
            except TransferError as error:
                self._set(self.candidates[PARAMETERIZE], status="failed", reason=str(error))

    def _tried(self, name: str, result: TransferResult) -> None:
        self._results[name] = result
        proved, failure = result.quality.proved, failure_of(result)
        self._set(
            self.candidates.get(name) or Ranked(name, "transfer"),
            stage="transfer",
            status="boundary missed" if result.missed and result.certificate.injective else result.certificate.status,
            min_scaled_jacobian=None if proved is None else proved.min_scaled_jacobian,
            boundary_error=result.boundary_error,
            reason=None if failure is None else str(failure),
        )

    @property
    def succeeded(self) -> bool:
        """Whether one of those tried is certified and meets the target."""
        return any(result.succeeded for result in self._results.values())

    @property
    def least(self) -> float:
        """The largest proved minimum of the scaled Jacobian of those that succeeded; -1 without any."""
        return max((_worth(result)[2] for result in self._results.values() if result.succeeded), default=-1.0)

    def result(self) -> LibraryResult:
        """The best of those tried."""
        chosen = max(self._results, key=lambda name: _worth(self._results[name]), default=None)
        if chosen is not None and self.succeeded:
            self._set(self.candidates[chosen], stage="chosen", reason=self._why(chosen))
        return LibraryResult(
            None if chosen is None else self._results[chosen],
            chosen,
            tuple(self.ordered()),
            dict(self._clock.seconds),
            self._models.notes,
        )

    def _why(self, chosen: str) -> str:
        if chosen == PARAMETERIZE:
            return "no model fits as well as a layout of the target's own"
        good = sum(result.succeeded for result in self._results.values())
        return f"the best proved minimum of {good}" if good > 1 else "the only one certified"

    def ordered(self) -> list[Ranked]:
        """All candidates, the furthest first."""
        stages, worth = list(STAGES), {name: _worth(result) for name, result in self._results.items()}

        def place(candidate: Ranked) -> tuple[object, ...]:
            tried = worth.get(candidate.name, (False, False, -2.0))
            score, distance = candidate.score, candidate.distance
            return (
                -stages.index(candidate.stage),
                *(-x for x in tried),
                score is None,
                score or 0.0,
                distance or 0.0,
                candidate.name,
            )

        return sorted(self.candidates.values(), key=place)

    def none_of_these_loops(self) -> bool:
        """Whether no model has as many loops as the target."""
        return all(candidate.stage == "loops" for candidate in self.candidates.values())

    def no_candidate(self) -> str:
        """Why there is nothing to register."""
        counts = collections.Counter(candidate.loops for candidate in self.candidates.values())
        have = ", ".join(f"{n} with {loops}" for loops, n in sorted(counts.items(), key=lambda item: item[0] or 0))
        if self.none_of_these_loops():
            return (
                f"no model of the library has {self._loops} boundary loops, as the target has: {have}; add one that "
                "has, or let parameterize make one"
            )
        refused = [c for c in self.candidates.values() if c.stage == "source"]
        return f"no model of the library with {self._loops} boundary loops can be transferred: {refused[0].reason}"

    def _at(self, stage: str) -> list[Ranked]:
        return [candidate for candidate in self.candidates.values() if candidate.stage == stage]

    def _set(self, candidate: Ranked, **found: object) -> None:
        self.candidates[candidate.name] = replace(candidate, **found)  # type: ignore[arg-type]


def _worth(result: TransferResult) -> tuple[bool, bool, float]:
    """What is better comes later: certified maps of the target, then by the proved minimum of the scaled Jacobian."""
    proved = result.quality.proved
    least = result.quality.scaled_jacobian.min if proved is None else proved.min_scaled_jacobian.lower
    return result.succeeded, result.certificate.status == "certified", least


class _Unwarned:
    """Progress that is told nothing of what speaks against a candidate: most are no choice, and their table says so."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def __call__(self, stage: str, step: int, energy: float, least: float) -> None:
        self._progress(stage, step, energy, least)

    def ended(self, stage: str, seconds: float, found: str) -> None:
        ended = getattr(self._progress, "ended", None)
        if ended is not None:
            ended(stage, seconds, found)
