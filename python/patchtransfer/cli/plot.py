"""Command line: ``patchtransfer plot FILE -o P.png``."""

from __future__ import annotations

import click

from ..progress import Clock
from .options import FILE, completed, volume_options
from .support import Report, check_outputs, failures, keep_inputs
from .watch import watched

__all__ = ["plot"]

#: Of `plot.multipatch`, and none.
COLORS = ("scaled_jacobian", "condition", "stretch", "dilatation", "patch", "none")


@click.command()
@click.argument("file", type=click.Path())
@click.option("-o", "--output", required=True, type=FILE, metavar="P.png", help="Picture (PNG, PDF or SVG).")
@click.option(
    "--color",
    default="scaled_jacobian",
    metavar="NAME",
    show_default=True,
    shell_complete=completed(COLORS),
    help="What lines show: scaled_jacobian, condition, stretch, dilatation, patch or none.",
)
@click.option(
    "--source",
    "source_path",
    type=FILE,
    metavar="S.xml",
    help="For stretch and dilatation: a model of the same layout.",
)
@click.option("--ids", is_flag=True, help="Number the patches.")
@click.option("--control-net", is_flag=True, help="Draw the control nets.")
@volume_options
def plot(file: str, output: str, color: str, source_path: str | None, ids: bool, control_net: bool) -> None:
    """Draw the multi-patch FILE: iso-parametric lines coloured by quality."""
    from .. import io
    from ..plot import figures as plots

    with failures(Report(None)):
        check_outputs(picture=output)
        keep_inputs([file, *([source_path] if source_path else [])], [output])
        with watched() as progress:
            clock = Clock(progress)
            with clock("reading") as stage:
                source = io.read(source_path) if source_path else None
                model = io.read(file)
                stage.found = repr(model)
            with clock("drawing") as stage:
                named = None if color == "none" else color
                figure = plots.multipatch(model, color=named, source=source, ids=ids, control_net=control_net)
                plots.savefig(figure, output)
                stage.found = output
