"""Command line: what all commands share: exit status, errors, reports, and outputs that are complete or left alone."""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO, cast

import click
from rich import markup
from rich.console import Console, RenderableType

from .. import interruption
from ..errors import InfeasibleTargetError, InputError, InputWarning, TransferError
from ..files import json_text, write_atomic
from ..pipeline.options import CHOICES, Options

if TYPE_CHECKING:
    from ..geometry.boundary import Boundary
    from ..pipeline.result import TransferResult

__all__ = [
    "INTERRUPTED",
    "NOT_CERTIFIED",
    "Commands",
    "Report",
    "all_or_nothing",
    "check_outputs",
    "chosen",
    "continuity_option",
    "deliver",
    "draw_patches",
    "escape",
    "failures",
    "fit_tolerance_option",
    "json_option",
    "keep_inputs",
    "keep_uncertified_option",
    "leave",
    "only_own_warnings",
    "outline_options",
    "print_error",
    "print_line",
    "say",
    "set_threads",
    "status_line",
    "summary",
    "transfer_options",
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


json_option = click.option("--json", "json_path", metavar="R.json", help='JSON report; "-" for standard output.')


def continuity_option(default: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option for continuity across patches."""
    return click.option(
        "--continuity",
        type=click.Choice(["c0", "c1", "g1"]),
        default=default,
        show_default=True,
        help="Across patches.",
    )


def outline_options(command: Callable[..., None]) -> Callable[..., None]:
    """How an outline is read: keywords of `read_boundary`."""
    for option in (
        click.option(
            "--layer",
            "layers",
            multiple=True,
            callback=lambda context, parameter, value: value or None,
            metavar="NAME",
            help="Layer of the drawing to read, or GeoJSON polygon; repeatable (default: all that are visible).",
        ),
        click.option(
            "--no-clean",
            "clean",
            is_flag=True,
            default=True,
            flag_value=False,
            help="Do not mend slips of the outline.",
        ),
        click.option(
            "--smooth/--polygon",
            default=None,
            help="Points are samples of smooth curves, or corners of polygons (default: all turns decide).",
        ),
    ):
        command = option(command)
    return command


fit_tolerance_option = click.option(
    "--fit-tolerance",
    type=float,
    default=Options.fit_tolerance,
    show_default=True,
    metavar="X",
    help="Boundary error.",
)
keep_uncertified_option = click.option(
    "--keep-uncertified", is_flag=True, help="Write the best map even without a certificate."
)


def transfer_options(command: Callable[..., None]) -> Callable[..., None]:
    """The options of a transfer, for `chosen`."""
    for option in reversed(
        (
            click.option("--method", type=click.Choice(CHOICES["method"]), default=Options.method, show_default=True),
            click.option(
                "--refine",
                type=click.Choice(CHOICES["refine"]),
                default=Options.refine,
                show_default=True,
                help="auto: insert knots into the source where it misses the target by 5 times the fit tolerance; "
                "refine it if no certified map is found. tolerance: wherever it misses by more than the tolerance.",
            ),
            fit_tolerance_option,
            click.option(
                "--fixed-correspondence/--sliding-joints",
                default=None,
                help="Keep all joints where registration puts them, or let those that are neither corners nor "
                "landmarks slide to lower the distortion (default, but for the paper's method).",
            ),
            keep_uncertified_option,
            click.option(
                "--time-limit",
                type=float,
                metavar="S",
                help="Seconds for a target, after which the search ends with the best map so far (default: none).",
            ),
        )
    ):
        command = option(command)
    return command


def chosen(options: dict[str, Any]) -> Options:
    """What the user chose of `transfer_options`."""
    given = dict(options)
    return Options(on_failure="return" if given.pop("keep_uncertified") else "raise", **given)


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


def deliver(
    result: TransferResult,
    output: str,
    report: Report,
    pictures: Sequence[tuple[str | None, Callable[[str], None]]],
    outline: Boundary,
) -> None:
    """Write pictures (path, or None for none, and what draws there), model and report, all or none of them.

    The report has the outline's notes besides.
    """
    from .. import io
    from ..pipeline.result import failure_of

    content = result.to_dict() | {"notes": list(outline.notes)}
    error = failure_of(result)
    if error is not None:
        content["error"] = str(error)
    with all_or_nothing(output, *(path for path, _ in pictures), report.path):
        for path, draw in pictures:
            if path is not None:
                draw(path)
        io.write(result.multipatch, output)
        report.write(content)
        if report.path != "-":
            summary(content, output)
    for note in outline.notes:
        print_line(f"[cyan]note:[/] {escape(note)}")


def leave(result: TransferResult) -> NoReturn:
    """End with the result's warnings and status."""
    warn(result.warnings)
    sys.exit(0 if result.succeeded else NOT_CERTIFIED)


def draw_patches(result: TransferResult, path: str) -> None:
    """Picture of a result's patches."""
    from ..plot import figures as plot

    plot.savefig(plot.multipatch(result.multipatch), path)


def summary(content: dict[str, Any], output: str | None) -> None:
    """Certificate, metrics, errors and times as a table."""
    from rich.table import Table

    table = Table(show_header=False, box=None, pad_edge=False)
    certificate, metrics = content["certificate"], content["quality"]
    bound = f", det J ≥ {certificate['lower_bound']:.3g} of its mean" if certificate["status"] == "certified" else ""
    colour = "green" if certificate["injective"] else "red"
    table.add_row("certificate", f"[bold {colour}]{certificate['status']}[/]{bound}")
    for name in ("scaled_jacobian", "condition_number"):
        low, mean, high = (_number(metrics[name][k]) for k in ("min", "mean", "max"))
        table.add_row(name.replace("_", " "), f"min {low}   mean {mean}   max {high}")
    if "corner_bound" in content:
        table.add_row("  corners allow at most", _number(content["corner_bound"]))
    kink = content["continuity"]["kink_deg"]
    table.add_row("kink across patches", f"mean {_number(kink['mean'])}°   max {_number(kink['max'])}°")
    smooth = content["continuity"]
    table.add_row(
        "residuals across patches",
        f"C0 {smooth['c0_gap']:.1e}   C1 rows {smooth['c1_residual']:.1e}   AS-G1 {smooth['as_g1_residual']:.1e}",
    )
    if smooth.get("rows") is not None:
        rows = smooth["rows"]
        table.add_row(
            "continuity rows", f"{rows['active']} kept to {rows['residual']:.1e}, {rows['left_out']} left out"
        )
    if "topology" in content:
        topology = content["topology"]
        valences = ", ".join(map(str, sorted(v["valence"] for v in topology["extraordinary_vertices"])))
        table.add_row(
            "topology",
            f"{topology['patches']} patches, {topology['interfaces']} interfaces, "
            f"{topology['boundary_loops']} boundary loops, valences of extraordinary vertices: {valences or 'none'}",
        )
    if content.get("labels"):
        table.add_row("labels", "; ".join(_label(*item) for item in content["labels"].items()))
    if "patches" in content:
        table.add_row("patches", str(content["patches"]))
    if "boundary_error" in content:
        table.add_row("boundary error", f"{content['boundary_error']:.2e} of the diameter")
        times = content["timings"]
        table.add_row("time", f"{1e3 * sum(times.values()):.1f} ms")
        for stage, seconds in times.items():
            table.add_row(f"  {stage}", f"{1e3 * seconds:.1f} ms")
    if output is not None:
        table.add_row("written", output)
    say(table)


def _label(name: str, sides: list[dict[str, int]]) -> str:
    from ..geometry.sides import Side

    where = ", ".join(f"{side['patch']} {Side(side['side']).name.lower()}" for side in sides)
    return f"{escape(name)}: {where or 'no side'}"


def _number(x: float | None) -> str:
    return "-" if x is None or math.isnan(x) else f"{x:.4g}"
