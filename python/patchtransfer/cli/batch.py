"""Command line: ``patchtransfer batch SOURCE TARGETS... -o DIR``."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from .options import continuity_option, outline_options, transfer_options
from .support import INTERRUPTED, NOT_CERTIFIED, Report, escape, failures, keep_inputs, print_error, print_line, say

if TYPE_CHECKING:
    from ..batch import BatchRow

__all__ = ["batch"]


@click.command()
@click.argument("source", type=click.Path())
@click.argument("targets", type=click.Path(), nargs=-1, required=True)
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder for all files; made if it does not exist.")
@continuity_option("c1")
@transfer_options
@outline_options
@click.option(
    "--workers", type=click.IntRange(1, 256), metavar="N", help="Processes (default: one a core, at most one a target)."
)
@click.option("--force", is_flag=True, help="Do finished targets again.")
def batch(
    source: str,
    targets: tuple[str, ...],
    output: str,
    continuity: str,
    workers: int | None,
    force: bool,
    **options: Any,
) -> None:
    """Transfer SOURCE to all TARGETS; for NAME.svg write NAME.xml and NAME.report.json to DIR.

    Landmarks are taken from NAME.landmarks.csv beside a target. Finished targets are skipped: run the same command
    again to resume. summary.csv and summary.json list all targets. Exit status 1 when a target has no certified result,
    2 when the source is bad.
    """
    from ..batch import SUMMARY, BatchOptions, run_batch, write_summary

    processes = min(os.cpu_count() or 1, len(targets)) if workers is None else workers
    with failures(Report(None)):
        keep_inputs([source, *targets], [os.path.join(output, name) for name in SUMMARY])
        try:
            with _bar(len(targets)) as progress:
                rows = run_batch(
                    source,
                    targets,
                    output,
                    BatchOptions(**options),
                    continuity=continuity,
                    workers=processes,
                    force=force,
                    progress=progress,
                )
        except KeyboardInterrupt:
            print_error("interrupted; finished targets are kept, run the same command again to resume")
            sys.exit(INTERRUPTED)
        write_summary(rows, output)
        _table(rows)
    sys.exit(0 if all(row.ok for row in rows) else NOT_CERTIFIED)


@contextmanager
def _bar(total: int) -> Iterator[Callable[[BatchRow], None] | None]:
    """A progress bar on terminals, nothing when piped."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda row: bar.update(task, advance=1, description=f"{os.path.basename(row.target)}: {row.status}")


def _table(rows: list[BatchRow]) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for name in ("target", "status", "min", "mean", "boundary error", "time", ""):
        table.add_column(name, justify="left" if name in ("target", "status", "") else "right")

    def number(x: float | None, form: str) -> str:
        return "-" if x is None else format(x, form)

    for row in rows:
        table.add_row(
            escape(os.path.basename(row.target)),
            f"[{'green' if row.ok else 'red'}]{row.status}[/]",
            number(row.min_scaled_jacobian, ".3f"),
            number(row.mean_scaled_jacobian, ".3f"),
            number(row.boundary_error, ".1e"),
            "-" if row.seconds is None else f"{row.seconds:.2f} s",
            "finished before" if row.skipped else "",
        )
    done = sum(row.ok for row in rows)
    say(table, f"{done} of {len(rows)} targets certified, {sum(row.skipped for row in rows)} finished before")
    for row in rows:
        if row.error is not None:
            reason = row.error.removeprefix(f"{row.target}: ")
            print_line(f"[bold red]{escape(row.target)}:[/] {escape(reason)}")
