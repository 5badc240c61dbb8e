"""Command line: ``patchtransfer COMMAND``, a module a command.

Exit status: 0 a certified result (or model), 1 not certified, 2 bad input or an infeasible target. Nothing is
written with status 2, nor with 1 unless ``--keep-uncertified``.

Commands import what they work with when they run, so that help and version are there at once.
"""

from __future__ import annotations

import click

from .._core import __version__
from .batch import batch
from .build import build
from .compare import compare
from .convert import convert
from .examples import examples
from .inspect import check, plot, refine
from .library import library
from .morph import morph
from .parameterize import parameterize
from .poisson import poisson
from .quality import quality
from .studio import studio
from .support import Commands
from .transfer import transfer

__all__ = ["main"]


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="patchtransfer")
def main() -> None:
    """Transfer multi-patch B-spline parameterizations to new boundaries, with a proof of injectivity."""


COMMANDS = (
    parameterize,
    transfer,
    library,
    build,
    refine,
    convert,
    check,
    quality,
    compare,
    plot,
    examples,
    batch,
    studio,
    morph,
    poisson,
)
for command in COMMANDS:
    main.add_command(command)
