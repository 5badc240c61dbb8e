"""Command line: ``patchtransfer batch SOURCE TARGETS... -o DIR``."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..files import write_atomic
from .options import FOLDER, continuity_option, html_option, volume_options
from .outlines import Outlines, outline_options
from .streams import QUIET, one_line, print_error, print_line, say, table, told, volume
from .support import INTERRUPTED, NOT_CERTIFIED, Report, check_outputs, command_line, failures, keep_inputs
from .transfer_options import transfer_options

if TYPE_CHECKING:
    from ..batch import BatchRow

__all__ = ["batch"]


@click.command()
@click.argument("source", type=click.Path())
@click.argument("targets", type=click.Path(), nargs=-1, required=True)
@click.option(
    "-o", "--output", required=True, type=FOLDER, metavar="DIR", help="Folder for all files; made if it does not exist."
)
@continuity_option("c1")
@transfer_options
@outline_options
@click.option(
    "--workers", type=click.IntRange(1, 256), metavar="N", help="Processes (default: one a core, at most one a target)."
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Of a Dask cluster, as tcp://HOST:8786: its workers do the work, not this machine.",
)
@click.option("--force", is_flag=True, help="Do finished targets again.")
@html_option
@volume_options
def batch(
    source: str,
    targets: tuple[str, ...],
    output: str,
    continuity: str,
    workers: int | None,
    scheduler: str | None,
    force: bool,
    html_path: str | None,
    outlines: Outlines,
    **options: Any,
) -> None:
    """Transfer SOURCE to all TARGETS; for NAME.svg write NAME.xml and NAME.report.json to DIR.

    Landmarks are taken from NAME.landmarks.csv beside a target. Finished targets are skipped: run the same command
    again to resume. summary.csv and summary.json list all targets. Exit status 1 when a target has no certified result,
    2 when the source is bad.
    """
    from ..batch import SUMMARY, BatchOptions, run_batch, write_summary

    if scheduler is None and workers is None:
        workers = os.cpu_count() or 1
    with failures(Report(None)):
        check_outputs(page=html_path)
        keep_inputs([source, *targets], [html_path, *(os.path.join(output, name) for name in SUMMARY)])
        try:
            with _bar(len(targets)) as progress:
                rows = run_batch(
                    source,
                    targets,
                    output,
                    BatchOptions(**outlines.keywords(), **options),
                    continuity=continuity,
                    workers=None if workers is None else min(workers, len(targets)),
                    scheduler=scheduler,
                    force=force,
                    progress=progress,
                )
        except KeyboardInterrupt:
            print_error("interrupted; finished targets are kept, run the same command again to resume")
            sys.exit(INTERRUPTED)
        write_summary(rows, output)
        if html_path is not None:
            from ..web.index import index_page

            write_atomic(Path(html_path), index_page(source, rows, Path(html_path).parent, command_line()))
        _table(rows)
    sys.exit(0 if all(row.ok for row in rows) else NOT_CERTIFIED)


@contextmanager
def _bar(total: int) -> Iterator[Callable[[BatchRow], None] | None]:
    """A progress bar on terminals, and a line for every target where asked for; nothing when piped without."""
    verbose = volume() > 0
    if volume() == QUIET or not sys.stderr.isatty():
        yield (lambda row: print_line(_line(row))) if verbose else None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=total)

        def done(row: BatchRow) -> None:
            if verbose:
                bar.console.print(_line(row), soft_wrap=True, highlight=False, markup=False, emoji=False)
            bar.update(task, advance=1, description=escape(f"{os.path.basename(row.target)}: {row.status}"))

        yield done


def _line(row: BatchRow) -> str:
    """A target that is finished, with its seconds and the figures that matter."""
    seconds = "finished before" if row.skipped else f"{row.seconds or 0.0:.3f} s"
    figures = [] if row.boundary_error is None else [f"boundary error {row.boundary_error:.1e} of the diameter"]
    if row.min_scaled_jacobian is not None:
        figures.append(f"scaled Jacobian min {row.min_scaled_jacobian:.3f}, mean {row.mean_scaled_jacobian:.3f}")
    return one_line(", ".join([f"{row.target}: {seconds}", row.status, *figures]))


def _table(rows: list[BatchRow]) -> None:
    def number(x: float | None, form: str) -> str:
        return "-" if x is None else format(x, form)

    lines = [("target", "status", "min", "mean", "boundary error", "time", "")]
    for row in rows:
        lines.append(
            (
                one_line(os.path.basename(row.target)),
                click.style(row.status, fg="green" if row.ok else "red"),
                number(row.min_scaled_jacobian, ".3f"),
                number(row.mean_scaled_jacobian, ".3f"),
                number(row.boundary_error, ".1e"),
                "-" if row.seconds is None else f"{row.seconds:.2f} s",
                "finished before" if row.skipped else "",
            )
        )
    done = sum(row.ok for row in rows)
    count = f"{done} of {len(rows)} targets certified, {sum(row.skipped for row in rows)} finished before"
    say(table(lines, right=range(2, 6)), count)
    for row in rows:
        if row.error is not None:
            print_line(told(row.target, row.error.removeprefix(f"{row.target}: "), "red", bold=True))
