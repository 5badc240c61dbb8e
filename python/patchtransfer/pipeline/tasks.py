"""A plan's transfers as tasks for an executor's threads or processes."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from functools import cached_property
from typing import TYPE_CHECKING, cast
from uuid import uuid4

from numpy.typing import ArrayLike

from .._core import set_threads
from ..errors import TransferError
from ..geometry.boundary import Boundary
from .result import TransferResult

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["TransferTask", "in_order"]

#: The number of a target, and the target or the pair of target and landmarks.
Numbered = tuple[int, Boundary | tuple[Boundary, ArrayLike]]

#: Control points of the source times targets in a chunk at most (some 50 ms of work), and the part of what is left that
#: a chunk takes.
CHUNK, SHARE = 2000, 8
#: Tasks that arrived in this process, the latest last, and how many of them are kept.
_arrivals: dict[str, TransferTask] = {}
KEPT_TASKS = 2


class TransferTask:
    """A plan's method `transfer` with its options.

    A process pool pickles it with every call. It arrives as bytes that are read only once a process, so that the plan
    there keeps its factorizations from one target to the next.
    """

    def __init__(self, transfer: Callable[..., TransferResult], options: dict[str, object]) -> None:
        self.transfer, self.options = transfer, options
        self.name = uuid4().hex

    def __call__(self, numbered: Numbered) -> TransferResult:
        """Transfer to a target; its number is for messages."""
        number, target = numbered
        arguments = (target,) if isinstance(target, Boundary) else target
        try:
            return self.transfer(*arguments, **self.options)
        except TransferError as error:
            error.args = (f"targets[{number}]: {error}", *error.args[1:])
            raise
        except Exception as error:
            error.add_note(f"at targets[{number}]")
            raise

    def several(self, chunk: Sequence[Numbered]) -> tuple[list[TransferResult], TransferError | None]:
        """Transfer to targets one after the other, up to the first that fails: the results, and its error."""
        results: list[TransferResult] = []
        for numbered in chunk:
            try:
                results.append(self(numbered))
            except TransferError as error:
                return results, error
        return results, None

    def __reduce__(self) -> tuple[Callable[[str, bytes], TransferTask], tuple[str, bytes]]:
        return _arrived, (self.name, self._content)

    @cached_property
    def _content(self) -> bytes:
        return pickle.dumps((self.transfer, self.options))


def in_order(
    task: TransferTask, numbered: Sequence[Numbered], executor: Executor, n_points: int
) -> Iterator[TransferResult]:
    """Results of an executor, in order; all targets are given to it before the first is read.

    Those of a source of few control points go in chunks, for sending a result there takes a tenth of the time that it
    took to find. Chunks get smaller towards the end, so that all workers are busy to the last.
    """
    chunks, start = [], 0
    while start < len(numbered):
        size = max(1, min(CHUNK // n_points, (len(numbered) - start) // SHARE))
        chunks.append(numbered[start : start + size])
        start += size
    return _each(executor.map(task.several, chunks))


def _each(chunks: Iterator[tuple[list[TransferResult], TransferError | None]]) -> Iterator[TransferResult]:
    # Executors' iterators are generators, which cancel what is not done when they are closed.
    with closing(cast("Generator[tuple[list[TransferResult], TransferError | None]]", chunks)):
        for results, error in chunks:
            yield from results
            if error is not None:
                raise error


def _arrived(name: str, content: bytes) -> TransferTask:
    task = _arrivals.get(name)
    if task is None:
        # The pool's processes share the cores; threads of their own would only be in each other's way.
        set_threads(1)
        task = TransferTask(*pickle.loads(content))
        task.name = name
        _arrivals[name] = task
        for old in list(_arrivals)[:-KEPT_TASKS]:
            _arrivals.pop(old, None)
    return task
