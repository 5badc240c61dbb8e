"""Command line: what all commands share: exit status, errors, reports, and outputs that are complete or left alone."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich import markup
from rich.console import Console

from .errors import InputError, NotCertifiedError, TransferError

__all__ = [
    "NOT_CERTIFIED",
    "Report",
    "all_or_nothing",
    "check_outputs",
    "escape",
    "failures",
    "json_option",
    "keep_inputs",
    "print_error",
    "set_threads",
    "status_line",
    "time_limit_option",
    "warn",
]

NOT_CERTIFIED, BAD_INPUT = 1, 2
SUFFIXES = {"model": (".xml", ".vtu"), "picture": (".png", ".svg", ".pdf"), "report": (".json", ".txt")}


@contextmanager
def all_or_nothing(*paths: str | None) -> Iterator[None]:
    """Put files back as they were when writing one of several fails."""
    files = [Path(path) for path in paths if path is not None and path != "-"]
    if len({file.absolute() for file in files}) < len(files):
        raise InputError("two outputs have the same path; give each a file of its own")
    before = {file: file.read_bytes() if file.is_file() else None for file in files}
    try:
        yield
    except BaseException:
        for file, content in before.items():
            if content is None:
                file.unlink(missing_ok=True)
            elif file.read_bytes() != content:
                file.write_bytes(content)
        raise


def print_error(message: str) -> None:
    """One line on standard error."""
    Console(stderr=True, soft_wrap=True, highlight=False).print(f"[bold red]error:[/] {escape(message)}")


def warn(warnings: Iterable[str]) -> None:
    """A line each on standard error."""
    for warning in warnings:
        Console(stderr=True, soft_wrap=True, highlight=False).print(f"[yellow]warning:[/] {escape(warning)}")


def escape(text: str) -> str:
    """Text on one line, without markup."""
    return markup.escape(" ".join(str(text).split()))


@contextmanager
def failures(report: Report) -> Iterator[None]:
    """Turn the package's errors into one line on standard error, a JSON report and an exit status."""
    try:
        yield
    except NotCertifiedError as error:
        print_error(str(error))
        details = error.result.to_dict() if error.result is not None else {}
        report.write(details | {"error": str(error)}, failed=True)
        sys.exit(NOT_CERTIFIED)
    except TransferError as error:
        print_error(str(error))
        report.write({"error": str(error)}, failed=True)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        print_error("interrupted; nothing was written")
        sys.exit(130)


class Report:
    """The JSON report: a file, standard output for "-", or nowhere."""

    def __init__(self, path: str | None) -> None:
        self.path = path

    def write(self, content: dict[str, Any], failed: bool = False) -> None:
        """Write the report; after a failure only to standard output, because files are left alone then."""
        if self.path is None or (failed and self.path != "-"):
            return
        text = json.dumps(content, indent=2, allow_nan=False) + "\n"
        if self.path == "-":
            click.echo(text, nl=False)
        else:
            from .io.atomic import write_atomic

            write_atomic(Path(self.path), text)


def check_outputs(**outputs: str | None) -> None:
    """Refuse unwritable outputs and unknown formats before the work starts."""
    for kind, path in outputs.items():
        if path is None or (kind == "report" and path == "-"):
            continue
        if Path(path).suffix.lower() not in SUFFIXES[kind]:
            raise InputError(f"{path}: unknown format for a {kind}; use {', '.join(SUFFIXES[kind])}")
        folder = Path(path).absolute().parent
        if not folder.is_dir():
            raise InputError(f"{path}: the folder {folder} does not exist; create it first")
        if not os.access(folder, os.W_OK) or Path(path).is_dir():
            raise InputError(f"{path}: cannot be written; choose another place or change the permissions")


def keep_inputs(inputs: Iterable[str | Path | None], outputs: Iterable[str | Path | None]) -> None:
    """Refuse outputs that are files which the command reads: a model would be lost to its own result."""
    given = [Path(path) for path in inputs if path is not None]
    for output in (Path(path) for path in outputs if path is not None and str(path) != "-"):
        for path in given:
            if _same_file(path, output):
                raise InputError(f"{output}: the result would replace the input {path}; choose another output")


def _same_file(a: Path, b: Path) -> bool:
    try:
        return a.samefile(b)
    except OSError:
        # One of them does not exist.
        return os.path.realpath(a) == os.path.realpath(b)


def set_threads(threads: int | None) -> None:
    """Limit the core's threads, if a number is given."""
    if threads is not None:
        from . import _core

        _core.set_threads(threads)


json_option = click.option("--json", "json_path", metavar="R.json", help='JSON report; "-" for standard output.')
time_limit_option = click.option(
    "--time-limit",
    type=float,
    metavar="S",
    help="Seconds for a target, after which the search ends with the best map so far (default: none).",
)


@contextmanager
def status_line() -> Iterator[Callable[[str, int, float, float], None] | None]:
    """A status line on terminals, nothing when piped."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    with console.status("transferring") as status:

        def show(stage: str, step: int, energy: float, determinant: float) -> None:
            status.update(f"{stage}: step {step}, energy {energy:.4g}, smallest determinant {determinant:.3g}")

        yield show
