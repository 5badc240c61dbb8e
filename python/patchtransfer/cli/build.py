"""Command line: ``patchtransfer build LAYOUT -o OUT.xml``."""

from __future__ import annotations

from functools import partial

import click

from ..errors import InputError
from ..progress import Clock
from .delivery import deliver, draw_patches, leave
from .options import FILE, html_option, json_option, keep_uncertified_option, volume_options
from .outlines import Outlines, outline_options
from .support import Report, check_outputs, failures, keep_inputs
from .watch import watched

__all__ = ["build"]


@click.command()
@click.argument("layout", type=click.Path())
@click.option("-o", "--output", required=True, type=FILE, metavar="OUT.xml", help="Multi-patch (G+Smo XML).")
@keep_uncertified_option
@outline_options
@click.option("--plot", "plot_path", type=FILE, metavar="P.png", help="Picture of the multi-patch.")
@html_option
@json_option
@volume_options
def build(
    layout: str,
    output: str,
    keep_uncertified: bool,
    plot_path: str | None,
    html_path: str | None,
    json_path: str | None,
    outlines: Outlines,
) -> None:
    """Parameterize a domain from the quad layout LAYOUT (JSON) and the boundary that it names."""
    from .. import io
    from ..sources.layout import from_layout

    report = Report(json_path)
    with failures(report):
        check_outputs(model=output, picture=plot_path, page=html_path, report=json_path)
        with watched() as progress:
            with Clock(progress)("reading") as stage:
                given = io.read_layout(layout, **outlines.keywords())
                keep_inputs([layout, given.boundary_file], [output, plot_path, html_path, json_path])
                stage.found = f"{len(given.quads)} quads, {given.boundary!r}"
            try:
                result = from_layout(
                    given.vertices,
                    given.quads,
                    given.boundary,
                    given.degree,
                    given.spans,
                    assignment=given.assignment,
                    on_failure="return" if keep_uncertified else "raise",
                    progress=progress,
                )
            except InputError as error:
                raise InputError(f"{layout}: {error}") from None
        deliver(result, output, report, [(plot_path, partial(draw_patches, result))], html_path, given.boundary)
    leave(result)
