"""Command line: ``patchtransfer convert IN OUT``."""

from __future__ import annotations

import click

from .options import polynomial_option
from .streams import say
from .support import Report, all_or_nothing, check_outputs, failures, keep_inputs

__all__ = ["convert"]


@click.command()
@click.argument("file", metavar="IN", type=click.Path())
@click.argument("output", metavar="OUT", type=click.Path())
@polynomial_option("Make a rational (NURBS) model polynomial: its sides move by at most this part of the diameter.")
def convert(file: str, output: str, polynomial: float | None) -> None:
    """Write the multi-patch or outline IN in the format that the extension of OUT names.

    The format of IN is told by its content. What the other format cannot hold is named in a warning.
    """
    from .. import io

    with failures(Report(None)):
        check_outputs(model=output)
        keep_inputs([file], [output])
        with all_or_nothing(output):
            if polynomial is None:
                said = [f"{io.convert(file, output)!r} written to {output}"]
            else:
                from ..conversion import to_polynomial

                made = to_polynomial(io.read(file), polynomial)
                io.write(made.multipatch, output)
                said = [*made.notes, str(made), f"{made.multipatch!r} written to {output}"]
            for line in said:
                say(line)
