"""`certify` in a process of its own, with limits on memory and time: what breaks them is reported, not suffered."""

from __future__ import annotations

import multiprocessing
import os
from multiprocessing.connection import Connection
from types import TracebackType

from patchtransfer import Certificate, InputError, MultiPatch, certify

try:
    import resource
except ImportError:  # Windows has no such limits; there only the time counts.
    resource = None

#: A certificate of a model of a few patches takes milliseconds and kilobytes; libraries alone reserve about 1 GiB.
MEMORY, SECONDS = 3 * 2**30, 20.0


def _serve(pipe: Connection) -> None:
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # The allocator's last words would fill the log.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    while (model := pipe.recv()) is not None:
        try:
            pipe.send(certify(model))
        except InputError as error:
            pipe.send(f"InputError: {error}")


class LimitedCertify:
    """Use as a context manager and call it: a `Certificate`, or a line on why there is none."""

    def __enter__(self) -> LimitedCertify:
        self._start()
        return self

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs,), daemon=True)
        # One thread is enough for small models, and threads reserve memory.
        threads = {"RAYON_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        kept = {name: os.environ.get(name) for name in threads}
        os.environ.update(threads)
        self.process.start()
        for name, value in kept.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        theirs.close()

    def __call__(self, model: MultiPatch) -> Certificate | str:
        self.pipe.send(model)
        try:
            if self.pipe.poll(SECONDS):
                return self.pipe.recv()
            outcome = f"no certificate within {SECONDS:g} s"
        except (EOFError, ConnectionResetError):
            outcome = f"certify ended its process, which may use {MEMORY / 2**30:g} GiB"
        self._stop()
        self._start()
        return outcome

    def _stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stop()
