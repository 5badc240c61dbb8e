"""Command line: what is seen of a command while it works: a status line on terminals, a log where asked for."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from .. import records
from .streams import QUIET, one_line, print_line, redirected, told, volume, write_line

if TYPE_CHECKING:
    from rich.live import Live

    from ..geometry.multipatch import MultiPatch
    from ..progress import Clock

__all__ = ["Watch", "read_model", "watched"]

#: Seconds after which a status line appears: what is over before needs none, and pays for no library that draws.
DELAY = 1.0


def newton_step(stage: str, step: int, energy: float, determinant: float) -> str:
    """What a transfer tells of its progress: a stage that begins, or a Newton step."""
    return f"{stage}: step {step}, energy {energy:.4g}, smallest determinant {determinant:.3g}" if step else stage


def read_model(clock: Clock, file: str) -> MultiPatch:
    """The multi-patch of a file, as a stage of its own."""
    from .. import io

    with clock("reading") as stage:
        model = io.read(file)
        stage.found = repr(model)
    return model


class Watch:
    """Progress as people see it.

    Parameters
    ----------
    line : callable
        From what is told to the text of the status line.

    Attributes
    ----------
    warnings : list of str
        Those that were shown while the command worked.
    """

    def __init__(self, line: Callable[..., str]) -> None:
        self._line = line
        self._live: Live | None = None
        self._text, self._stage = "", ""
        self.warnings: list[str] = []

    def __call__(self, stage: str, *told: Any) -> None:
        """Show what goes on, a new stage at once: it may be over before the line is drawn the next time."""
        self._text = one_line(self._line(stage, *told))
        if self._live is not None and stage != self._stage:
            self._live.refresh()
        self._stage = stage

    def warned(self, text: str) -> None:
        """Show at once, and once, what speaks against the work that begins: it may take long."""
        if text not in self.warnings:
            self.warnings.append(text)
            if volume() != QUIET:
                print_line(told("warning", text, "yellow"))

    def write(self, text: str) -> None:
        """A line on standard error: above the status line, which is drawn again below, where there is one."""
        if self._live is None:
            write_line(text)
            return
        from rich.text import Text

        self._live.console.print(Text.from_ansi(text), soft_wrap=True, highlight=False)

    def show(self) -> None:
        """Begin the status line."""
        from rich.console import Console
        from rich.live import Live
        from rich.spinner import Spinner
        from rich.text import Text

        spinner = Spinner("dots")

        def drawn() -> Spinner:
            spinner.update(text=Text(self._text))
            return spinner

        # Whatever is written meanwhile comes through `write`.
        live = Live(
            get_renderable=drawn,
            console=Console(stderr=True),
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        live.start(refresh=True)
        self._live = live

    def hide(self) -> None:
        """End the status line, if there is one."""
        if self._live is not None:
            self._live.stop()
            self._live = None


@contextmanager
def watched(line: Callable[..., str] = newton_step) -> Iterator[Watch]:
    """A status line on terminals after a while, a log where asked for; when piped without, early warnings only."""
    watch, loud = Watch(line), volume()
    with ExitStack() as stack:
        if loud != QUIET and sys.stderr.isatty():
            stack.enter_context(_status_line(watch))
            stack.enter_context(redirected(watch.write))
        if loud > 0:
            stack.enter_context(_listening(loud))
        yield watch


@contextmanager
def _status_line(watch: Watch) -> Iterator[None]:
    """The status line from `DELAY` on: a thread waits for it, since a stage in the core may take long."""
    over = Event()

    def appear() -> None:
        if not over.wait(DELAY):
            watch.show()

    waiting = Thread(target=appear, daemon=True)
    if DELAY:
        waiting.start()
    else:
        watch.show()
    try:
        yield
    finally:
        over.set()
        try:
            if DELAY:
                waiting.join()
        finally:
            watch.hide()


@contextmanager
def _listening(loud: int) -> Iterator[None]:
    """Print the records of the package's logger: stages, and decisions as well if it is loud."""
    import logging

    class Lines(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            # Warnings are shown by the command, each once.
            if record.levelno < logging.WARNING:
                print_line(one_line(record.getMessage()))

    logger, lines = logging.getLogger(records.NAME), Lines()
    before = logger.level
    logger.addHandler(lines)
    logger.setLevel(logging.INFO if loud == 1 else logging.DEBUG)
    try:
        yield
    finally:
        logger.setLevel(before)
        logger.removeHandler(lines)
