"""Ctrl-C on the command line: no traceback at any moment, and child processes that leave it to their parent.

Nothing but the standard library is imported here: this has to be in place before what takes long to load.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

__all__ = ["caught", "close_at_once", "held_back", "ignore", "leave_silently", "raise_lost"]

STATUS = 130
#: Whether Ctrl-C was pressed since the command started.
happened = False


def _leave(signum: int, frame: FrameType | None) -> None:
    os._exit(STATUS)


def _raise(signum: int, frame: FrameType | None) -> None:
    global happened
    happened = True
    raise KeyboardInterrupt


def raise_lost() -> None:
    """Raise `KeyboardInterrupt` if Ctrl-C was pressed and a library has swallowed it, as SciPy does while it loads."""
    if happened:
        raise KeyboardInterrupt


def _is_command() -> bool:
    """Whether this process is the command line, not a program that imports the package."""
    started_as_module = sys.orig_argv[1:3] in (["-m", "patchtransfer"], ["-m", "patchtransfer.cli"])
    program = os.path.basename(sys.argv[0]) if sys.argv else ""
    return started_as_module or os.path.splitext(program)[0] == "patchtransfer"


def leave_silently() -> None:
    """Let Ctrl-C end the command line at once while it is loaded: there is nothing to tidy up yet.

    A program that imports the package keeps its own ways.
    """
    on_main_thread = threading.current_thread() is threading.main_thread()
    if on_main_thread and _is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def close_at_once() -> None:
    """End the command line, interrupted and tidied up, without what Python does when it closes down.

    A library that was interrupted while it was loaded can abort the process there, and the status with it. A program
    that imports the package closes down in its own way.
    """
    if not _is_command():
        return
    for stream in (sys.stdout, sys.stderr):
        # Either may be closed, or on a full disk.
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(STATUS)


@contextmanager
def caught() -> Iterator[None]:
    """Raise `KeyboardInterrupt` on Ctrl-C, also from where Python would only print that it was lost."""
    global happened
    happened = False
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before not in (_leave, signal.default_int_handler):
        # Somebody else's handler, or Ctrl-C is ignored.
        yield
        return
    hook = sys.unraisablehook

    def again(lost: Any) -> None:
        # In a destructor or a callback of the garbage collector exceptions end.
        if isinstance(lost.exc_value, KeyboardInterrupt):
            _thread.interrupt_main()
        else:
            hook(lost)

    sys.unraisablehook = again
    signal.signal(signal.SIGINT, _raise)
    try:
        yield
    finally:
        # The command is done: nothing that comes shall change its status, not even while Python closes down. Where
        # Ctrl-C came through an `exec` (of a dataclass that was being loaded, say), Python would end by the signal,
        # though the exception was handled, unless another `exec` goes well.
        exec("")
        signal.signal(signal.SIGINT, signal.SIG_IGN if before is _leave else before)
        sys.unraisablehook = hook


@contextmanager
def held_back() -> Iterator[None]:
    """Hold Ctrl-C back, from processes that are started meanwhile too; this process sees it afterwards."""
    on_main_thread = threading.current_thread() is threading.main_thread()
    # A handler that is not Python's could not be put back.
    if not on_main_thread or not hasattr(signal, "pthread_sigmask") or signal.getsignal(signal.SIGINT) is None:
        yield
        return
    seen: list[int] = []
    # The mask is what the processes inherit. This process's other threads may still be handed the signal.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    handler = signal.signal(signal.SIGINT, lambda signum, _: seen.append(signum))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if seen:
            signal.raise_signal(signal.SIGINT)


def ignore() -> None:
    """Leave Ctrl-C to the parent process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
