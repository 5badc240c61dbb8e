"""Command line: what all commands share: exit status, errors, reports, and outputs that are complete or left alone."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, cast

import click

from .. import interruption
from ..errors import InfeasibleTargetError, InputError, InputWarning, TransferError
from ..files import json_text, write_atomic
from .streams import print_error, warn, write_out

__all__ = [
    "COMMAND_LINE",
    "INTERRUPTED",
    "NOT_CERTIFIED",
    "Report",
    "all_or_nothing",
    "check_outputs",
    "command_line",
    "failures",
    "keep_inputs",
    "only_own_warnings",
    "set_threads",
]

NOT_CERTIFIED, BAD_INPUT, INTERRUPTED = 1, 2, 130
COMMAND_LINE = "patchtransfer.command_line"


@contextmanager
def all_or_nothing(*paths: str | None) -> Iterator[None]:
    """Put files back as they were when writing one of several fails; nothing is written after Ctrl-C."""
    interruption.raise_lost()
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


@contextmanager
def failures(report: Report) -> Iterator[None]:
    """Turn all errors into one line on standard error, a JSON report and an exit status."""
    try:
        yield
    except (SystemExit, click.ClickException, click.exceptions.Exit):
        raise
    except BaseException as error:
        if os.environ.get("PATCHTRANSFER_TRACEBACK"):
            raise
        status, message = _outcome(error)
        print_error(message)
        if status != INTERRUPTED:
            # Standard output may be what failed; one line is enough.
            with suppress(InputError):
                report.write(_best_map(error) | {"error": message}, failed=True)
        sys.exit(status)


def _outcome(error: BaseException) -> tuple[int, str]:
    """Exit status and message of an error."""
    # Some libraries turn an interruption of their import into an error of their own.
    if isinstance(error, (KeyboardInterrupt, click.Abort)) or interruption.happened:
        return INTERRUPTED, "interrupted; nothing was written"
    if isinstance(error, (InputError, InfeasibleTargetError)):
        return BAD_INPUT, str(error)
    if isinstance(error, TransferError):
        return NOT_CERTIFIED, str(error)
    if isinstance(error, MemoryError):
        return BAD_INPUT, "not enough memory for a model of this size; take a coarser one"
    if isinstance(error, OSError) and error.strerror:
        where = "" if error.filename is None else f"{error.filename}: "
        return BAD_INPUT, f"{where}{error.strerror}; check the path, its permissions and the disk"
    # No bad file should get here. Those who see it can help to find out why one did.
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return BAD_INPUT, f"unexpected {what} (please report this with the files; PATCHTRANSFER_TRACEBACK=1 shows where)"


def _best_map(error: BaseException) -> dict[str, Any]:
    """The report on the best map that an error comes with."""
    # Those of bad input come without, and before the result's module is loaded.
    result = getattr(error, "result", None)
    return {} if result is None else cast(dict[str, Any], result.to_dict())


def command_line() -> str | None:
    """The command that runs, as one would type it; None outside of one."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.meta.get(COMMAND_LINE)


@contextmanager
def only_own_warnings() -> Iterator[None]:
    """Show the package's warnings about files as lines of its own, and no other library's."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", InputWarning)
        warnings.showwarning = lambda message, *_args, **_kwargs: warn([str(message)])
        yield


class Report:
    """The JSON report: a file, standard output for "-", or nowhere."""

    def __init__(self, path: str | None) -> None:
        self.path = path

    def write(self, content: dict[str, Any], failed: bool = False) -> None:
        """Write the report; after a failure only to standard output, because files are left alone then."""
        if self.path is None or (failed and self.path != "-"):
            return
        text = json_text(content)
        if self.path == "-":
            write_out(text)
        else:
            write_atomic(Path(self.path), text)


def check_outputs(**outputs: str | None) -> None:
    """Refuse unwritable outputs and unknown formats before the work starts."""
    for kind, path in outputs.items():
        if path is None or (kind == "report" and path == "-"):
            continue
        if Path(path).suffix.lower() not in (known := _suffixes(kind)):
            raise InputError(f"{path}: unknown format for a {kind}; use {', '.join(known)}")
        if kind == "picture":
            from ..plot.drawing import need_matplotlib

            need_matplotlib(f"{path}: the picture")
        folder = Path(path).absolute().parent
        if not folder.is_dir():
            raise InputError(f"{path}: the folder {folder} does not exist; create it first")
        if not os.access(folder, os.W_OK) or Path(path).is_dir():
            raise InputError(f"{path}: cannot be written; choose another place or change the permissions")


def _suffixes(kind: str) -> tuple[str, ...]:
    """Suffixes of the files that an output can be written to: "model", "picture", "page", "landmarks" or "report"."""
    if kind == "page":
        return (".html", ".htm")
    if kind == "landmarks":
        return (".csv",)
    if kind == "picture":
        # Pictures take time to load, and most commands make none.
        from ..plot.figures import SUFFIXES

        return SUFFIXES
    from ..io import FORMATS

    models = tuple(suffix for format_ in FORMATS if format_.write for suffix in format_.extensions)
    return {"model": models, "report": (".json", ".txt")}[kind]


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
        from .._core import set_threads as core_set_threads

        core_set_threads(threads)
