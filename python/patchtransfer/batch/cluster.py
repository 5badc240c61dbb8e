"""A Dask cluster's workers: found, checked, and sent the plan once each."""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._core import __version__
from ..errors import InputError, TransferError
from ..libraries import library
from .executors import Crew, Deaths
from .targets import BatchRow, Job
from .worker import Died, Sent

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["Cluster", "connected"]

#: Seconds for a scheduler to answer, and for its first worker to come: they may have been started just now.
ANSWER, FIRST_WORKER = 5.0, 10.0
#: Seconds without any worker after which nobody is waited for: Dask's nannies start a new process in less.
NOBODY = 30.0
KEPT = "finished targets are kept, run the same batch again to resume"
#: Seconds for which the number of workers is taken to be the same.
SAME = 2.0


@contextmanager
def connected(scheduler: str | Client) -> Iterator[Client]:
    """A client of a scheduler whose workers have this package in this version; one that is given is left open.

    Raises
    ------
    InputError
        When nobody answers at the address, when there are no workers, and when one has another version.
    """
    distributed = library("distributed", user="a scheduler")
    if not isinstance(scheduler, str):
        _check(scheduler, "the scheduler")
        yield scheduler
        return
    name = f"the scheduler {scheduler}"
    _ask(distributed, scheduler, name)
    # What is wrong is said by errors.
    log = logging.getLogger("distributed.client")
    level, client = log.level, distributed.Client(scheduler, timeout=ANSWER, set_as_default=False)
    log.setLevel(logging.CRITICAL)
    try:
        _check(client, name)
        yield client
    finally:
        client.close(timeout=ANSWER)
        log.setLevel(level)


def _ask(distributed: Any, address: str, name: str) -> None:
    """Raise an error unless a scheduler answers.

    A client would wait without end where something else listens, and for ten seconds more after it has failed.
    """

    async def ask() -> Any:
        arguments = distributed.Security().get_connection_args("client")
        # A second less than all this may take, so that the reason is told.
        comm = await distributed.core.connect(address, timeout=ANSWER - 1, **arguments)
        try:
            await comm.write({"op": "identity", "reply": True})
            return (await comm.read())["type"]
        finally:
            comm.abort()

    async def in_time() -> Any:
        return await asyncio.wait_for(ask(), ANSWER)

    try:
        # Not in this thread, where a notebook's loop may run.
        with ThreadPoolExecutor(1) as thread:
            kind = thread.submit(asyncio.run, in_time()).result()
    except TimeoutError:
        told = f"nothing within {ANSWER:g} s"
    except MemoryError:
        told = "what listens there is something else"
    except (OSError, ValueError, TypeError, LookupError) as error:
        # What is no scheduler can answer anything.
        told = str(error.__cause__ or "") or str(error) or type(error).__name__
    else:
        if kind == "Scheduler":
            return
        told = f"it is a {kind}"
    raise InputError(f"{name} does not answer ({told}); give what `dask scheduler` prints, as tcp://HOST:8786")


def _check(client: Any, name: str) -> None:
    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER)
    except TimeoutError:
        raise InputError(f"{name}: no worker after {FIRST_WORKER:g} s; start some, as with `dask worker`") from None

    def version() -> str:
        # Local, so that it is sent as it is: workers need not have this module to be asked.
        import patchtransfer

        return patchtransfer.__version__

    for address, had in client.run(version, on_error="return").items():
        if had != __version__:
            has = f"has patchtransfer {had}" if isinstance(had, str) else f"cannot load patchtransfer ({had})"
            raise InputError(f"{name}: its worker {address} {has}, this is {__version__}; install the same there")


class Cluster(Crew):
    """Workers of a Dask cluster, which may come and go."""

    def __init__(self, client: Any, sent: Sent, scratch: Path) -> None:
        super().__init__(client.get_executor(pure=False), 1, sent)
        self._client, self._content = client, sent
        self.losses = (BrokenExecutor, CancelledError, library("distributed").scheduler.KilledWorker)
        for address, seen in client.run(os.path.isdir, str(scratch)).items():
            if not seen:
                raise InputError(
                    f"{scratch.parent}: not seen by the worker {address}; workers need the folders of targets and "
                    "results under the same paths, on a file system that all share"
                )
        self._scatter()
        self._counted = -SAME
        self._alive = time.monotonic()

    def _scatter(self) -> None:
        # Its future takes the plan's place in every task; a worker that comes later gets it from another one.
        self._sent: Any = self._client.scatter(self._content, broadcast=True, hash=False)

    def _count(self) -> None:
        """How many threads the workers have; none for long is an error."""
        now = time.monotonic()
        if now < self._counted + SAME:
            return
        with self._heard():
            self._workers, self._counted = sum(self._client.nthreads().values()), now
        if self._workers:
            self._alive = now
        elif now > self._alive + NOBODY:
            raise TransferError(f"no worker is left for {NOBODY:g} s; {KEPT}")

    @contextmanager
    def _heard(self) -> Iterator[None]:
        """Say so when the scheduler is gone, instead of what the client makes of that."""
        try:
            yield
        except Exception as error:
            if self._client.status == "running" and not isinstance(error, OSError):
                raise
            raise TransferError(f"the scheduler is gone ({str(error) or type(error).__name__}); {KEPT}") from error

    def submit(self, job: Job, mark: Path) -> Future[BatchRow | Died]:
        """Hand over a target."""
        with self._heard():
            return super().submit(job, mark)

    def at_once(self) -> int:
        """How many targets may be under way."""
        self._count()
        return max(super().at_once(), 1)

    def check(self) -> None:
        """Raise an error if the scheduler is gone, or all workers are."""
        self._count()

    def renew(self, error: BaseException, lost: Deaths) -> None:
        """Wait for a worker, and send the plan again: it may be lost with all workers that had it."""
        with self._heard():
            try:
                self._client.wait_for_workers(1, timeout=NOBODY)
            except TimeoutError:
                if self._client.status == "running":
                    raise TransferError(f"no worker is left for {NOBODY:g} s; {KEPT}") from error
                raise
            self._scatter()
