"""Command line: ``patchtransfer parameterize OUTLINE -o OUT.xml``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

from .support import (
    NOT_CERTIFIED,
    Report,
    all_or_nothing,
    check_outputs,
    continuity_option,
    failures,
    json_option,
    keep_inputs,
    set_threads,
    summary,
    warn,
)

__all__ = ["parameterize"]


@click.command()
@click.argument("outline", type=click.Path())
@click.option("-o", "--output", required=True, metavar="OUT.xml", help="Multi-patch (G+Smo XML).")
@click.option("--degree", type=click.IntRange(1), default=3, show_default=True, metavar="P", help="Of all patches.")
@click.option(
    "--spans", type=click.IntRange(1), default=3, show_default=True, metavar="N", help="Knot spans a direction."
)
@click.option("--max-patches", type=click.IntRange(1), metavar="N", help="Most patches.")
@click.option(
    "--prefer",
    type=click.Choice(["few", "quality"]),
    default="few",
    show_default=True,
    help="What counts more where one costs the other.",
)
@continuity_option("c0")
@click.option("--fit-tolerance", type=float, default=1e-3, show_default=True, metavar="X", help="Boundary error.")
@click.option("--time-limit", type=float, metavar="S", help="Seconds after which no further layout is tried.")
@click.option("--keep-uncertified", is_flag=True, help="Write the best map even without a certificate.")
@click.option("--plot", "plot_path", metavar="P.png", help="Picture of the multi-patch.")
@json_option
@click.option("--threads", type=click.IntRange(1, 1024), metavar="N", help="Threads of the core (default: all).")
def parameterize(
    outline: str,
    output: str,
    degree: int,
    spans: int,
    max_patches: int | None,
    prefer: str,
    continuity: str,
    fit_tolerance: float,
    time_limit: float | None,
    keep_uncertified: bool,
    plot_path: str | None,
    json_path: str | None,
    threads: int | None,
) -> None:
    """Parameterize the inside of OUTLINE, which needs no source: the layout of patches is found.

    OUTLINE is a boundary: G+Smo XML, closed point lists (CSV) or an SVG drawing, holes included.
    """
    from .. import io
    from ..plot import figures as plot
    from ..sources.auto_layout import parameterize as run

    report = Report(json_path)
    with failures(report):
        check_outputs(model=output, picture=plot_path, report=json_path)
        keep_inputs([outline], [output, plot_path, json_path])
        set_threads(threads)
        boundary = io.read_boundary(outline)
        with _stage_line() as progress:
            result = run(
                boundary,
                degree=degree,
                spans=spans,
                max_patches=max_patches,
                prefer=prefer,
                continuity=continuity,
                fit_tolerance=fit_tolerance,
                time_limit=time_limit,
                on_failure="return" if keep_uncertified else "raise",
                progress=progress,
            )
        content = result.to_dict()
        if not result.certificate.injective:
            content["error"] = str(result.certificate)
        with all_or_nothing(output, plot_path, json_path):
            if plot_path is not None:
                plot.savefig(plot.multipatch(result.multipatch), plot_path)
            io.write(result.multipatch, output)
            report.write(content)
            if json_path != "-":
                summary(content, output)
    warn(result.warnings)
    sys.exit(0 if result.certificate.injective else NOT_CERTIFIED)


@contextmanager
def _stage_line() -> Iterator[Callable[[str, int], None] | None]:
    """The stage on terminals, nothing when piped."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    with console.status("reading") as status:
        yield lambda stage, number: status.update(f"{stage} {number}" if number else stage)
