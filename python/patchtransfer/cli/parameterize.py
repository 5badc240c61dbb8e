"""Command line: ``patchtransfer parameterize OUTLINE -o OUT.xml``."""

from __future__ import annotations

from functools import partial

import click

from ..interior.polish_report import GOALS
from ..progress import Clock
from .delivery import deliver, draw_patches, leave
from .options import (
    FILE,
    continuity_option,
    html_option,
    json_option,
    keep_uncertified_option,
    polish_option,
    threads_option,
    volume_options,
)
from .outlines import Outlines, outline_options
from .support import Report, check_outputs, failures, keep_inputs, set_threads
from .transfer_options import fit_tolerance_option
from .watch import watched

__all__ = ["parameterize"]


@click.command()
@click.argument("outline", type=click.Path())
@click.option("-o", "--output", required=True, type=FILE, metavar="OUT.xml", help="Multi-patch (G+Smo XML).")
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
@fit_tolerance_option
@polish_option(GOALS[:1], GOALS[0], "Make the smallest scaled Jacobian of the best layout better, proved.")
@click.option("--time-limit", type=float, metavar="S", help="Seconds after which no further layout is tried.")
@keep_uncertified_option
@outline_options
@click.option("--plot", "plot_path", type=FILE, metavar="P.png", help="Picture of the multi-patch.")
@html_option
@json_option
@volume_options
@threads_option
def parameterize(
    outline: str,
    output: str,
    degree: int,
    spans: int,
    max_patches: int | None,
    prefer: str,
    continuity: str,
    fit_tolerance: float,
    polish: str | None,
    time_limit: float | None,
    keep_uncertified: bool,
    plot_path: str | None,
    html_path: str | None,
    json_path: str | None,
    threads: int | None,
    outlines: Outlines,
) -> None:
    """Parameterize the inside of OUTLINE, which needs no source: the layout of patches is found.

    OUTLINE is a boundary, holes included: G+Smo XML, closed point lists (CSV), a drawing (SVG, DXF), a polygon
    (GeoJSON), an airfoil or an image.
    """
    from ..sources.auto_layout import parameterize as run

    report = Report(json_path)
    with failures(report):
        check_outputs(model=output, picture=plot_path, page=html_path, report=json_path)
        keep_inputs([outline], [output, plot_path, html_path, json_path])
        set_threads(threads)
        with watched(_stage) as progress:
            with Clock(progress)("reading") as stage:
                boundary = outlines.read(outline)
                stage.found = repr(boundary)
            result = run(
                boundary,
                degree=degree,
                spans=spans,
                max_patches=max_patches,
                prefer=prefer,
                continuity=continuity,
                fit_tolerance=fit_tolerance,
                polish=polish,
                time_limit=time_limit,
                on_failure="return" if keep_uncertified else "raise",
                progress=progress,
            )
        deliver(result, output, report, [(plot_path, partial(draw_patches, result))], html_path, boundary)
    leave(result)


def _stage(stage: str, number: int, *_: float) -> str:
    """What a parameterization tells of its progress."""
    return f"{stage} {number}" if number else stage
