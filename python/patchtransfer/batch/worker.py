"""What a worker does: one target, with a plan that came to its process but once.

A task names the plan by its digest and says where its bytes are; the process unpickles them with its first task. Before
it begins a target it leaves a mark, a small file, and takes it away at the end. So when a worker dies, its marks tell
which targets it was at; and whoever gets such a task again, as Dask hands it on, sees that a worker has died of it
instead of dying as well.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import socket
import threading
from dataclasses import dataclass
from pathlib import Path

from .._core import __version__, set_threads
from ..errors import InputError
from ..pipeline.plan import TransferPlan
from .targets import BatchOptions, BatchRow, Job, transferred

__all__ = ["Died", "Sent", "died_at", "do"]

#: Plans that this process has unpickled, the latest last; and how many are kept, for batches that take turns.
_opened: dict[str, tuple[TransferPlan, BatchOptions]] = {}
KEPT = 2
_lock = threading.Lock()


@dataclass(frozen=True)
class Died:
    """Instead of a row: the worker that had begun the target and ended without a result."""

    worker: str


@dataclass(frozen=True)
class Sent:
    """A plan with its options on the way to workers, as bytes or in a file.

    Attributes
    ----------
    version : str
        Of the package that sends it.
    home : str
        The process that sends it.
    digest : str
        Of its bytes: a file that somebody has changed is not unpickled.
    content : bytes or Path
    """

    version: str
    home: str
    digest: str
    content: bytes | Path

    @classmethod
    def of(cls, plan: TransferPlan, options: BatchOptions, file: Path | None = None) -> Sent:
        """A plan, in a file that is written now, or by itself."""
        content = pickle.dumps((plan, options))
        if file is not None:
            file.write_bytes(content)
        return cls(__version__, here(), hashlib.sha256(content).hexdigest(), content if file is None else file)

    def opened(self) -> tuple[TransferPlan, BatchOptions]:
        """Plan and options; unpickled once a process."""
        with _lock:
            if self.digest not in _opened:
                _opened[self.digest] = self._unpickled()
                for old in list(_opened)[:-KEPT]:
                    del _opened[old]
            return _opened[self.digest]

    def _unpickled(self) -> tuple[TransferPlan, BatchOptions]:
        if self.version != __version__:
            raise InputError(
                f"the worker {here()} has patchtransfer {__version__}, the batch {self.version}; install the same"
            )
        if isinstance(self.content, Path):
            try:
                content = self.content.read_bytes()
            except OSError as error:
                raise unseen(self.content, error) from None
            if hashlib.sha256(content).hexdigest() != self.digest:
                raise InputError(f"{self.content}: somebody has changed the batch's plan; run it again")
        else:
            content = self.content
        if here() != self.home:
            # Processes share the cores.
            set_threads(1)
        plan, options = pickle.loads(content)
        return plan, options


def here() -> str:
    """The process that asks, for messages."""
    return f"process {os.getpid()} on {socket.gethostname()}"


def unseen(path: object, error: OSError) -> InputError:
    """What to say when a worker does not see the batch's folder."""
    return InputError(
        f"{path}: not seen by the worker {here()} ({error.strerror}); workers need the folders of targets and results "
        "under the same paths, on a file system that all share"
    )


def do(sent: Sent, job: Job, mark: Path) -> BatchRow | Died:
    """A target's row; or who has died of it, if the mark says that somebody had begun this very task."""
    plan, options = sent.opened()
    try:
        with mark.open("x") as stream:
            stream.write(here())
    except FileExistsError:
        return Died(died_at(mark) or "a process")
    except OSError as error:
        raise unseen(mark.parent, error) from None
    try:
        return transferred(plan, job, options)
    finally:
        mark.unlink(missing_ok=True)


def died_at(mark: Path) -> str | None:
    """Who left a mark and did not take it away; None without one."""
    try:
        # Not whether it exists: of shared file systems only opening asks the server.
        return mark.read_text() or "a process"
    except OSError:
        return None
