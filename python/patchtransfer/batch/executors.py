"""Targets through an executor: few at a time, rows as they come, and a worker's death is its target's affair only.

An executor is whatever has `submit`, as processes, MPI and Dask do. At most a few tasks a worker are under way. When
workers die, targets that nobody had begun are handed out again; one that had been begun is done again when the others
are finished, with nothing beside it, so that what happens then is its own doing.
"""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from uuid import uuid4

from .. import interruption
from ..errors import TransferError
from .targets import BatchRow, Job
from .worker import Died, Sent, died_at, do

__all__ = ["Crew", "Deaths", "processes", "streamed"]

#: Tasks under way for every worker: the next one waits there when a target is done.
AHEAD = 2
#: Times in a row that workers may die before any of them begins a target: one can be the machine's affair.
FRUITLESS = 3
#: Seconds without a result after which is asked whether there still are workers.
PATIENCE = 5.0

#: A target that a worker has begun and not ended, and that worker.
Deaths = list[tuple[Job, str]]


class Crew:
    """Workers of an executor, with the plan that they are sent.

    Parameters
    ----------
    executor : Executor, or a function that makes one
        What is given is left open; what was made here is shut down, and made anew when it is broken.
    workers : int
        How many it has, at most.
    sent : Sent
    """

    #: What the future of a lost task raises.
    losses: tuple[type[BaseException], ...] = (BrokenExecutor, CancelledError)

    def __init__(self, executor: Executor | Callable[[], Executor], workers: int, sent: Sent) -> None:
        self._make = None if isinstance(executor, Executor) else executor
        self._executor = executor if isinstance(executor, Executor) else None
        self._workers = workers
        self._sent = sent
        self._others: set[BaseProcess] = set()

    def submit(self, job: Job, mark: Path) -> Future[BatchRow | Died]:
        """Hand over a target."""
        if self._executor is None:
            assert self._make is not None
            self._others = set(multiprocessing.active_children())
            self._executor = self._make()
        # Processes start as jobs are handed over. A terminal sends Ctrl-C to all of them, and each would complain.
        with interruption.held_back():
            return self._executor.submit(do, self._sent, job, mark)

    def at_once(self) -> int:
        """How many targets may be under way."""
        return AHEAD * self._workers

    def check(self) -> None:
        """Raise an error if there is nobody left to wait for; an executor's futures say so themselves."""

    def renew(self, error: BaseException, lost: Deaths) -> None:
        """Be ready again after losses."""
        if not isinstance(error, BrokenExecutor):
            return
        if self._make is None:
            at = "".join(f"; {job.target} was begun by {worker}" for job, worker in lost)
            raise TransferError(
                f"the executor is broken, for one of its workers died{at}. Finished targets are kept. With a function "
                "that makes executors, as executor=partial(ProcessPoolExecutor, 4), such a death costs its target only"
            ) from error
        self._shut()

    def stop(self) -> None:
        """End at once: a transfer may take minutes, and is done again when the batch is resumed."""
        if self._make is not None and self._executor is not None:
            for process in set(multiprocessing.active_children()) - self._others:
                process.terminate()

    def close(self) -> None:
        """Shut down what was made here."""
        if self._make is not None:
            self._shut()

    def _shut(self) -> None:
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None


def processes(workers: int) -> Callable[[], Executor]:
    """A function that makes pools of this machine's processes."""
    # Not forked: this process may run threads, a progress bar's for one.
    return partial(ProcessPoolExecutor, workers, multiprocessing.get_context("spawn"), interruption.ignore)


def streamed(jobs: Sequence[Job], crew: Crew, scratch: Path) -> Iterator[tuple[Job, BatchRow]]:
    """Jobs with their rows, in the order in which they are finished.

    Parameters
    ----------
    jobs : sequence of Job
    crew : Crew
    scratch : Path
        A folder for marks that all workers see.
    """
    lost = yield from _handed_out(jobs, crew, scratch, crew.at_once)
    for job, _ in lost:
        for _, worker in (yield from _handed_out([job], crew, scratch, lambda: 1)):
            error = (
                f"the worker ended without a result, also with no other target beside ({worker}; out of memory?); "
                "try fewer workers or a smaller target"
            )
            yield job, BatchRow(str(job.target), "failed", False, landmarks=job.landmarks is not None, error=error)


def _handed_out(
    jobs: Sequence[Job], crew: Crew, scratch: Path, at_once: Callable[[], int]
) -> Generator[tuple[Job, BatchRow], None, Deaths]:
    """Yield jobs with their rows; return those whose workers died."""
    waiting, lost, fruitless = deque(jobs), Deaths(), 0
    running: dict[Future[BatchRow | Died], tuple[Job, Path]] = {}
    broken: BaseException | None = None
    try:
        while waiting or running:
            while waiting and broken is None and len(running) < at_once():
                job, mark = waiting[0], scratch / uuid4().hex
                try:
                    running[crew.submit(job, mark)] = job, mark
                    waiting.popleft()
                except crew.losses as error:
                    broken = error
            # Of broken workers all futures end.
            done, _ = wait(running, PATIENCE, FIRST_COMPLETED)
            for future in done:
                job, mark = running.pop(future)
                try:
                    row = future.result()
                except crew.losses as error:
                    broken, worker = error, died_at(mark)
                    if worker is None:
                        waiting.appendleft(job)
                        continue
                    row = Died(worker)
                fruitless = 0
                if isinstance(row, Died):
                    lost.append((job, row.worker))
                else:
                    yield job, row
            if broken is not None and not running:
                fruitless += 1
                if fruitless > FRUITLESS:
                    raise TransferError(
                        f"workers end before they begin a target, {fruitless} times in a row "
                        f"({str(broken) or type(broken).__name__}); see their own messages. Finished targets are kept"
                    )
                crew.renew(broken, lost)
                broken = None
            elif not done:
                crew.check()
    except BaseException:
        for future in running:
            future.cancel()
        raise
    return lost
