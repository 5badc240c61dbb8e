"""Command line: ``patchtransfer examples [NAME]``."""

from __future__ import annotations

import os
from pathlib import Path

import click

from .delivery import summary
from .options import FOLDER, volume_options
from .streams import say, warn
from .support import Report, failures
from .watch import watched

__all__ = ["examples"]


def _names(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Names that begin so: of the folders that hold examples, since loading their module takes long."""
    folder = Path(__file__).parents[1] / "examples"
    return sorted(path.parent.name for path in folder.glob(f"{incomplete}*/source.xml"))


@click.command()
@click.argument("name", required=False, shell_complete=_names)
@click.option("-o", "--output", type=FOLDER, metavar="DIR", help="Folder for all files (default: the example's name).")
@volume_options
def examples(name: str | None, output: str | None) -> None:
    """List the bundled examples, or run the example NAME and keep its files in DIR."""
    from .. import examples as bundled

    if name is None:
        say(*(f"{key}: {description}" for key, description in bundled.EXAMPLES.items()))
        return
    folder = name if output is None else output
    with failures(Report(None)), watched() as progress:
        result = bundled.run(name, folder, progress)
    summary(result.to_dict(), os.path.join(folder, ""))
    warn(result.warnings)
