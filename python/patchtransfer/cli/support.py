"""Command line: what all commands share: exit status, errors, reports, and outputs that are complete or left alone."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

import click
from rich import markup
from rich.console import Console, RenderableType

from .. import interruption
from ..errors import InfeasibleTargetError, InputError, InputWarning, TransferError
from ..files import json_text, write_atomic

if TYPE_CHECKING:
    pass

__all__ = [
    "INTERRUPTED",
    "NOT_CERTIFIED",
    "Commands",
    "Report",
    "all_or_nothing",
    "check_outputs",
    "escape",
    "failures",
    "keep_inputs",
    "only_own_warnings",
    "print_error",
    "print_line",
    "say",
    "set_threads",
    "status_line",
    "warn",
    "write_out",
]

NOT_CERTIFIED, BAD_INPUT, INTERRUPTED = 1, 2, 130
#: Letters of a message: names in files may be as long as the file.
MAX_LINE = 2000
#: Piped output has no width to respect.
PIPED_WIDTH = 160


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


def say(*items: RenderableType) -> None:
    """Texts and tables on standard output; `InputError` when it takes no more."""
    text = StringIO()
    console = _console(text, sys.stdout, None if sys.stdout.isatty() else PIPED_WIDTH)
    for item in items:
        console.print(item, markup=not isinstance(item, str), soft_wrap=isinstance(item, str))
    write_out(text.getvalue())


def _console(file: StringIO, stream: TextIO, width: int | None) -> Console:
    """Console that lays texts out in memory as for a stream: the library's own writing fails in ways of its own."""
    return Console(file=file, force_terminal=stream.isatty(), width=width, highlight=False)


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
    print_line(f"[bold red]error:[/] {escape(message)}")


def warn(warnings: Iterable[str]) -> None:
    """A line each on standard error."""
    for warning in warnings:
        print_line(f"[yellow]warning:[/] {escape(warning)}")


def print_line(text: str) -> None:
    """A line of markup on standard error."""
    line = StringIO()
    _console(line, sys.stderr, None).print(text, soft_wrap=True)
    try:
        sys.stderr.write(line.getvalue())
        sys.stderr.flush()
    except OSError:
        # There is no place left to say so; the exit status does.
        _abandon(sys.stderr)


def _abandon(stream: TextIO) -> None:
    """Let what a stream still holds go nowhere: Python would complain about it at exit and change the status."""
    with suppress(OSError, ValueError), open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def escape(text: str) -> str:
    """Text on one line, without markup."""
    line = " ".join(str(text).split())
    return markup.escape(line if len(line) <= MAX_LINE else f"{line[:MAX_LINE]} ...")


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


class Commands(click.Group):
    """Group of commands without tracebacks: also errors and interruptions outside of `failures` are one line."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command line; everything that goes wrong from here on is one line on standard error."""
        with interruption.caught(), only_own_warnings(), failures(Report(None)):
            return super().main(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; before click makes an "Aborted!" with status 1 of an interruption."""
        with failures(Report(None)):
            return super().invoke(ctx)


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
        folder = Path(path).absolute().parent
        if not folder.is_dir():
            raise InputError(f"{path}: the folder {folder} does not exist; create it first")
        if not os.access(folder, os.W_OK) or Path(path).is_dir():
            raise InputError(f"{path}: cannot be written; choose another place or change the permissions")


def _suffixes(kind: str) -> tuple[str, ...]:
    """Suffixes of the files that an output can be written to: "model", "picture" or "report"."""
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


def newton_step(stage: str, step: int, energy: float, determinant: float) -> str:
    """What a transfer tells of its progress."""
    return f"{stage}: step {step}, energy {energy:.4g}, smallest determinant {determinant:.3g}"


@contextmanager
def status_line(
    first: str = "transferring", line: Callable[..., str] = newton_step
) -> Iterator[Callable[..., None] | None]:
    """A status line on terminals, nothing when piped: a callback that shows `line` of what it is told."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    with console.status(first) as status:
        yield lambda *told: status.update(line(*told))
