"""Command line: ``patchtransfer COMMAND``, a module a command.

Exit status: 0 done, with a certified result (or model), 1 not certified, 2 bad input or an infeasible target, 130
Ctrl-C; ``docs/guide/command-line.md`` says what that means for each command. ``report.schema.json`` describes reports.

A command's module is loaded when it runs, and loads what it works with later still, so that help, version and the
shell's completions are there at once.
"""

from __future__ import annotations

import click

from .._core import __version__
from .group import Commands

__all__ = ["main"]

#: Every command, which is in the module of its name, and the first paragraph of its help: a list loads none of them.
COMMANDS = {
    "parameterize": "Parameterize the inside of OUTLINE, which needs no source: the layout of patches is found.",
    "transfer": "Transfer the parameterization SOURCE to the boundary TARGET.",
    "library": "Transfer to the boundary TARGET the model of the folder DIR that suits it best.",
    "build": "Parameterize a domain from the quad layout LAYOUT (JSON) and the boundary that it names.",
    "refine": "Raise degrees, split knot spans or repeat knots of the multi-patch FILE; its geometry stays.",
    "convert": "Write the multi-patch or outline IN in the format that the extension of OUT names.",
    "check": "Topology, certificate, quality and continuity of the multi-patch FILE.",
    "quality": "Scaled Jacobian and condition number of the multi-patch FILE, of samples and proved.",
    "compare": "How similar the multi-patches A and B of one layout are: the dilatation of the map from A to B.",
    "plot": "Draw the multi-patch FILE: iso-parametric lines coloured by quality.",
    "examples": "List the bundled examples, or run the example NAME and keep its files in DIR.",
    "batch": "Transfer SOURCE to all TARGETS; for NAME.svg write NAME.xml and NAME.report.json to DIR.",
    "studio": "Open a local page where the target is dragged and the certified result follows.",
    "morph": "Certified multi-patches in between A and B, which differ in their control points only.",
    "schema": "Write the JSON schema (draft 2020-12) of all reports, or of those of COMMAND, to standard output.",
    "poisson": "Solve -Δu = f on the multi-patch FILE, with values and fluxes on the sides of labels.",
}


@click.group(cls=Commands, told=COMMANDS, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="patchtransfer")
def main() -> None:
    """Transfer multi-patch B-spline parameterizations to new boundaries, with a proof of injectivity."""
