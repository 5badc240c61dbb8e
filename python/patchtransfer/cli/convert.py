"""Command line: ``patchtransfer convert IN OUT``."""

from __future__ import annotations

import click

from .streams import say
from .support import Report, all_or_nothing, check_outputs, failures, keep_inputs

__all__ = ["convert"]


@click.command()
@click.argument("file", metavar="IN", type=click.Path())
@click.argument("output", metavar="OUT", type=click.Path())
def convert(file: str, output: str) -> None:
    """Write the multi-patch or outline IN in the format that the extension of OUT names.

    The format of IN is told by its content. What the other format cannot hold is named in a warning.
    """
    from .. import io

    with failures(Report(None)):
        check_outputs(model=output)
        keep_inputs([file], [output])
        with all_or_nothing(output):
            written = io.convert(file, output)
            say(f"{written!r} written to {output}")
