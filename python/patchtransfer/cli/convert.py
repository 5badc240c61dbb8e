"""Command line: ``patchtransfer convert IN OUT``."""

from __future__ import annotations

import click

from ..progress import Clock
from .options import polynomial_option, volume_options
from .streams import say
from .support import Report, all_or_nothing, check_outputs, failures, keep_inputs
from .watch import read_model, watched

__all__ = ["convert"]


@click.command()
@click.argument("file", metavar="IN", type=click.Path())
@click.argument("output", metavar="OUT", type=click.Path())
@polynomial_option("Make a rational (NURBS) model polynomial: its sides move by at most this part of the diameter.")
@volume_options
def convert(file: str, output: str, polynomial: float | None) -> None:
    """Write the multi-patch or outline IN in the format that the extension of OUT names.

    The format of IN is told by its content. What the other format cannot hold is named in a warning.
    """
    from .. import io

    with failures(Report(None)):
        check_outputs(model=output)
        keep_inputs([file], [output])
        with all_or_nothing(output):
            with watched() as progress:
                clock = Clock(progress)
                if polynomial is None:
                    with clock("reading and writing") as stage:
                        stage.found = f"{io.convert(file, output)!r} written to {output}"
                    said = [stage.found]
                else:
                    said = _polynomial(file, output, polynomial, clock)
            say(*said)


def _polynomial(file: str, output: str, tolerance: float, clock: Clock) -> list[str]:
    """Convert to a polynomial model; what is said of it."""
    from .. import io
    from ..conversion import to_polynomial

    model = read_model(clock, file)
    with clock("conversion") as stage:
        made = to_polynomial(model, tolerance)
        stage.found = str(made)
    with clock("writing") as stage:
        io.write(made.multipatch, output)
        stage.found = output
    return [*made.notes, str(made), f"{made.multipatch!r} written to {output}"]
