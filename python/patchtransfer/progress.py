"""How a transfer goes on: what it tells, where its time goes, how long it may go on."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from .records import DEBUG, INFO, record

__all__ = ["FIRST", "Budget", "Clock", "Progress", "Stage", "StopReason", "reporter"]

#: Called with (stage, step, energy, smallest scaled determinant): before every Newton step, and with step 0 and NaN
#: when a stage begins. Where it has a method ``ended(stage, seconds, found)``, that is called when the stage ends;
#: where it has a method ``warned(text)``, that is called as soon as something speaks against the work that begins.
Progress = Callable[[str, int, float, float], None]

#: Work of a search that has no alternative: 8 to 10 s on one core of a present machine, at 0.13 to 0.17 µs a node. The
#: hardest boundary of the tests spends 38 million in one search and is certified; nearly all others need less than a
#: tenth.
WORK = 6e7
#: Newton steps on the nodes of a large source itself; sources of the samples' size can take more for the work above.
STEPS = 3000
#: Newton steps that the first rung of a search may take whatever work is left: of 220 certified maps between drawings
#: none needed more than 55.
FIRST = 60


def reporter(progress: Progress | None, stage: str) -> Callable[[int, float, float], None] | None:
    """A stage's own progress callback."""
    return None if progress is None else (lambda step, energy, least: progress(stage, step, energy, least))


class StopReason(str):
    """Last entry in the log of a search that its budget has ended."""


class Stage:
    """A stage while it runs.

    Attributes
    ----------
    found : str
        The figures that matter of what it came to, for those who watch; to be set inside.
    """

    def __init__(self) -> None:
        self.found = ""
        self.inner = 0.0


#: The clock of the outermost stage that is open.
_outermost: ContextVar[Clock | None] = ContextVar("outermost", default=None)


class Clock:
    """Seconds per stage, also for the package's logger; a stage inside another is not counted twice.

    Parameters
    ----------
    progress : Progress, optional
        Told of every stage, those inside others too.
    ended : callable, optional
        Told of the end of every stage; default the method of this name of `progress`, if it has one.
    """

    def __init__(
        self, progress: Progress | None = None, ended: Callable[[str, float, str], None] | None = None
    ) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._ended = ended or getattr(progress, "ended", None)
        self._open: list[Stage] = []

    @property
    def nested(self) -> bool:
        """Whether its stages are inside a stage of another clock: of one attempt among several."""
        return _outermost.get() not in (None, self)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[Stage]:
        """Time what runs inside as `stage`; when it fails, nobody is told of its end."""
        # Attempts inside a stage are its details, unless somebody has asked for them.
        level = DEBUG if self.nested and self._progress is None and self._ended is None else INFO
        record(DEBUG, "%s begins", stage, stage=stage)
        if self._progress is not None:
            self._progress(stage, 0, math.nan, math.nan)
        begin = time.perf_counter()
        this = Stage()
        self._open.append(this)
        outer = _outermost.get()
        _outermost.set(outer or self)
        try:
            yield this
        finally:
            _outermost.set(outer)
            self._open.pop()
            spent = time.perf_counter() - begin
            self.seconds[stage] = self.seconds.get(stage, 0.0) + spent - this.inner
            if self._open:
                self._open[-1].inner += spent
        own, found = spent - this.inner, this.found
        record(level, "%s: %.3f s%s", stage, own, f", {found}" if found else "", stage=stage, seconds=own, found=found)
        if self._ended is not None:
            self._ended(stage, own, found)


class Budget:
    """Work and time that are left to a search, which asks it between its steps.

    Work is counted in nodes: a Newton step costs what `SplineOptimizer.step_cost` says. That does not depend on the
    machine, so neither does the result. Time does, and a result that was cut by it may be another one elsewhere.

    Parameters
    ----------
    work : float, default unlimited
    time_limit : float, optional
        Seconds from now.
    """

    def __init__(self, work: float = math.inf, time_limit: float | None = None) -> None:
        self.work = self.work_left = work
        self.time_limit = time_limit
        self._end = math.inf if time_limit is None else time.monotonic() + time_limit

    @classmethod
    def of_source(cls, step_cost: float, time_limit: float | None = None) -> Budget:
        """The default budget for a source on whose own nodes a Newton step costs `step_cost`."""
        return cls(max(WORK, STEPS * step_cost), time_limit)

    def part(self, share: float) -> Budget:
        """One for a search of several: this share of the whole work, until the same time."""
        part = Budget(share * self.work, self.time_limit)
        part._end = self._end
        return part

    def spend(self, work: float) -> None:
        """Count work that was done."""
        self.work_left -= work

    def renew(self) -> None:
        """Have the whole work left again, for a search that gets on."""
        self.work_left = self.work

    def steps(self, step_cost: float, most: int) -> int:
        """Newton steps that may still be taken, `most` at most; none when the time is over."""
        if self.expired():
            return 0
        if self.work_left >= most * step_cost:
            return most
        return int(max(self.work_left, 0.0) // step_cost)

    def first_steps(self, step_cost: float, most: int) -> int:
        """Newton steps of a search's first rung: as `steps`, but `FIRST` of them at least."""
        return max(self.steps(step_cost, most), min(FIRST, most))

    def expired(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() >= self._end

    def seconds_left(self) -> float | None:
        """Until the time is over; None without a limit."""
        return None if math.isinf(self._end) else max(self._end - time.monotonic(), 0.0)

    def reason(self) -> StopReason:
        """Why a search that used it up has ended."""
        if self.expired():
            return StopReason(f"stopped by the time limit of {self.time_limit:g} s")
        return StopReason("stopped by the budget of Newton steps: what would be tried next seldom helps")
