"""A plan's transfer as a task for an executor's threads or processes."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import cached_property
from uuid import uuid4

from numpy.typing import ArrayLike

from . import _core
from .errors import TransferError
from .multipatch import Boundary
from .result import TransferResult

__all__ = ["TransferTask"]

#: Tasks that arrived in this process, the latest last, and how many of them are kept.
_arrivals: dict[str, TransferTask] = {}
KEPT_TASKS = 2


class TransferTask:
    """A plan's method `transfer` with its options.

    A process pool pickles it with every target. It arrives as bytes that are read only once a process, so that the plan
    there keeps its factorizations from one target to the next.
    """

    def __init__(self, transfer: Callable[..., TransferResult], options: dict[str, object]) -> None:
        self.transfer, self.options = transfer, options
        self.name = uuid4().hex

    def __call__(self, numbered: tuple[int, Boundary | tuple[Boundary, ArrayLike]]) -> TransferResult:
        """Transfer to a target, or to a pair of target and landmarks; the number is for messages."""
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

    def __reduce__(self) -> tuple[Callable[[str, bytes], TransferTask], tuple[str, bytes]]:
        return _arrived, (self.name, self._content)

    @cached_property
    def _content(self) -> bytes:
        return pickle.dumps((self.transfer, self.options))


def _arrived(name: str, content: bytes) -> TransferTask:
    task = _arrivals.get(name)
    if task is None:
        # The pool's processes share the cores; threads of their own would only be in each other's way.
        _core.set_threads(1)
        task = TransferTask(*pickle.loads(content))
        task.name = name
        _arrivals[name] = task
        for old in list(_arrivals)[:-KEPT_TASKS]:
            _arrivals.pop(old, None)
    return task
