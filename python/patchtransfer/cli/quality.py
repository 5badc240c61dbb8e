"""Command line: ``patchtransfer quality FILE``."""

from __future__ import annotations

from typing import Any

import click

from ..progress import Clock
from .delivery import figures, quality_lines
from .options import json_option, volume_options
from .streams import say, table
from .support import Report, all_or_nothing, check_outputs, failures, keep_inputs
from .watch import read_model, watched

__all__ = ["quality"]


@click.command()
@click.argument("file", type=click.Path())
@click.option("--proved", is_flag=True, help="Prove bounds of the worst values.")
@click.option("--width", type=float, default=1e-3, show_default=True, help="How far proved bounds may be apart.")
@click.option("--samples", type=click.IntRange(2, 1000), default=10, show_default=True, help="Along every knot span.")
@json_option
@volume_options
def quality(file: str, proved: bool, width: float, samples: int, json_path: str | None) -> None:
    """Scaled Jacobian and condition number of the multi-patch FILE, of samples and proved.

    Nothing is left out: at a degenerate corner the one is 0, the other infinite.
    """
    from ..measure.quality import quality as measured

    report = Report(json_path)
    with failures(report):
        check_outputs(report=json_path)
        keep_inputs([file], [json_path])
        with watched() as progress:
            clock = Clock(progress)
            model = read_model(clock, file)
            with clock("quality") as stage:
                found = measured(model, samples, proved=proved, width=width)
                stage.found = figures(found)
        content: dict[str, Any] = {"quality": found.to_dict(), "error": None}
        with all_or_nothing(json_path):
            report.write(content)
            if json_path != "-":
                patch, u, v = found.worst
                folded = ("samples", f"{found.nonpositive} of {found.n_samples} folded")
                worst = ("worst sample", f"patch {patch} at (u, v) = ({u:.6g}, {v:.6g})")
                say(table([*quality_lines(content["quality"]), folded, worst]))
