"""Command line: what is seen of a command while it works: a status line on terminals, a log where asked for."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from .streams import one_line, print_line, told, warn

if TYPE_CHECKING:
    from rich.live import Live
    from rich.spinner import Spinner

__all__ = ["Watch", "watched"]


def newton_step(stage: str, step: int, energy: float, determinant: float) -> str:
    """What a transfer tells of its progress: a stage that begins, or a Newton step."""
    return f"{stage}: step {step}, energy {energy:.4g}, smallest determinant {determinant:.3g}" if step else stage


class Watch:
    """Progress as people see it: a status line on a terminal, and a line of the log for every stage that ends.

    Parameters
    ----------
    status : (Live, Spinner), optional
        The status line.
    verbose : bool
        Whether there is a log.
    line : callable
        From what is told to the text of the status line.

    Attributes
    ----------
    warnings : list of str
        Those that were shown while the command worked.
    """

    def __init__(self, status: tuple[Live, Spinner] | None, verbose: bool, line: Callable[..., str]) -> None:
        self._status, self._verbose, self._line = status, verbose, line
        self._stage: str | None = None
        self.warnings: list[str] = []

    def __call__(self, stage: str, *told: Any) -> None:
        """Show what goes on, a new stage at once: it may be over before the line is drawn the next time."""
        if self._status is None:
            return
        from rich.text import Text

        live, spinner = self._status
        spinner.update(text=Text(one_line(self._line(stage, *told))))
        if stage != self._stage:
            self._stage = stage
            live.refresh()

    def warned(self, text: str) -> None:
        """Show at once, and once, what speaks against the work that begins: it may take long."""
        if text in self.warnings:
            return
        self.warnings.append(text)
        if self._status is None:
            warn([text])
        else:
            self._above(told("warning", text, "yellow"))

    def ended(self, stage: str, seconds: float, found: str) -> None:
        """Log a stage with its seconds and the figures that matter."""
        if not self._verbose:
            return
        text = one_line(f"{stage}: {seconds:.3f} s" + (f", {found}" if found else ""))
        if self._status is None:
            print_line(text)
        else:
            self._above(text)

    def _above(self, text: str) -> None:
        """A line above the status line, which is drawn again below."""
        from rich.text import Text

        assert self._status is not None
        self._status[0].console.print(Text.from_ansi(text), soft_wrap=True, highlight=False)


@contextmanager
def watched(verbose: bool, line: Callable[..., str] = newton_step) -> Iterator[Watch]:
    """A status line on terminals, a log where asked for; when piped without, early warnings only."""
    if not sys.stderr.isatty():
        yield Watch(None, verbose, line)
        return
    from rich.console import Console
    from rich.live import Live
    from rich.spinner import Spinner

    spinner = Spinner("dots")
    with Live(spinner, console=Console(stderr=True), transient=True) as live:
        yield Watch((live, spinner), verbose, line)
