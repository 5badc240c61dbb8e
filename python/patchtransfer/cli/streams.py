"""Command line: texts and tables on standard output, messages on standard error, as loud as the command is.

With ``--quiet`` there are errors only, and what is asked for by ``--json -``.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TextIO

import click

from ..errors import InputError

__all__ = [
    "QUIET",
    "VOLUME",
    "one_line",
    "print_error",
    "print_line",
    "redirected",
    "say",
    "table",
    "told",
    "volume",
    "warn",
    "write_line",
    "write_out",
]

#: Where a command's context keeps how loud it is, and what it is with ``--quiet``; otherwise the number of ``-v``.
VOLUME, QUIET = "patchtransfer.volume", -1

#: Letters of a message: names in files may be as long as the file.
MAX_LINE = 2000
#: What would ring, go back or start a command of the terminal.
CONTROL = dict.fromkeys((7, 8, 27))
#: Blanks between the columns of a table.
GAP = "  "


#: What takes lines of standard error meanwhile: a status line would be torn by them.
_above: Callable[[str], None] | None = None


def volume() -> int:
    """How loud the command that runs is: `QUIET`, or how often ``-v`` is given."""
    context = click.get_current_context(silent=True)
    loud: int = 0 if context is None else context.meta.get(VOLUME, 0)
    return loud


@contextmanager
def redirected(above: Callable[[str], None]) -> Iterator[None]:
    """Hand lines of standard error to a function."""
    global _above
    before, _above = _above, above
    try:
        yield
    finally:
        _above = before


def say(*texts: str) -> None:
    """Texts on standard output, coloured on a terminal, nothing if quiet; `InputError` when it takes no more."""
    if volume() == QUIET:
        return
    write_out("".join(_for(sys.stdout, text) + "\n" for text in texts))


def table(rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> str:
    """Rows of cells of one line as columns; those in `right` end below each other."""
    widths = [max(len(click.unstyle(cell)) for cell in column) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        blanks = [" " * (width - len(click.unstyle(cell))) for cell, width in zip(row, widths, strict=True)]
        cells = [b + cell if k in right else cell + b for k, (cell, b) in enumerate(zip(row, blanks, strict=True))]
        lines.append(GAP.join(cells).rstrip())
    return "\n".join(lines)


def write_out(text: str) -> None:
    """Text on standard output as it is; `InputError` when it takes no more."""
    encoding = sys.stdout.encoding or "utf-8"
    try:
        # Names of files may hold bytes that are no text, and a terminal may know few letters.
        sys.stdout.write(text.encode(encoding, "backslashreplace").decode(encoding))
        sys.stdout.flush()
    except OSError as error:
        _abandon(sys.stdout)
        raise InputError(
            f"standard output cannot be written ({error.strerror or error}); write to a file on a disk with space"
        ) from None


def print_error(message: str) -> None:
    """One line on standard error."""
    print_line(told("error", message, "red", bold=True))


def warn(warnings: Iterable[str], kind: str = "warning", colour: str = "yellow") -> None:
    """A line each on standard error, unless quiet."""
    if volume() == QUIET:
        return
    for warning in warnings:
        print_line(told(kind, warning, colour))


def told(what: str, text: str, colour: str, bold: bool = False) -> str:
    """A message on one line, what it is in colour."""
    return f"{click.style(f'{what}:', fg=colour, bold=bold)} {one_line(text)}"


def print_line(text: str) -> None:
    """A line on standard error, above the status line where there is one."""
    (_above or write_line)(text)


def write_line(text: str) -> None:
    """A line on standard error as it is."""
    try:
        sys.stderr.write(_for(sys.stderr, text) + "\n")
        sys.stderr.flush()
    except OSError:
        # There is no place left to say so; the exit status does.
        _abandon(sys.stderr)


def one_line(text: str) -> str:
    """Text on one line of bounded length, without what a terminal would obey."""
    line = " ".join(str(text).split()).translate(CONTROL)
    return line if len(line) <= MAX_LINE else f"{line[:MAX_LINE]} ..."


def _for(stream: TextIO, text: str) -> str:
    """Text with its colours where the stream shows them (https://no-color.org)."""
    return text if stream.isatty() and not os.environ.get("NO_COLOR") else click.unstyle(text)


def _abandon(stream: TextIO) -> None:
    """Let what a stream still holds go nowhere: Python would complain about it at exit and change the status."""
    with suppress(OSError, ValueError), open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())
