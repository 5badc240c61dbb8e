"""Command line: texts and tables on standard output, messages on standard error."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import TextIO

import click

from ..errors import InputError

__all__ = ["one_line", "print_error", "print_line", "say", "table", "told", "warn", "write_out"]

#: Letters of a message: names in files may be as long as the file.
MAX_LINE = 2000
#: What would ring, go back or start a command of the terminal.
CONTROL = dict.fromkeys((7, 8, 27))
#: Blanks between the columns of a table.
GAP = "  "


def say(*texts: str) -> None:
    """Texts on standard output, coloured on a terminal; `InputError` when it takes no more."""
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


def warn(warnings: Iterable[str]) -> None:
    """A line each on standard error."""
    for warning in warnings:
        print_line(told("warning", warning, "yellow"))


def told(what: str, text: str, colour: str, bold: bool = False) -> str:
    """A message on one line, what it is in colour."""
    return f"{click.style(f'{what}:', fg=colour, bold=bold)} {one_line(text)}"


def print_line(text: str) -> None:
    """A line on standard error."""
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
