"""Command line: ``patchtransfer schema [COMMAND]``: what is in a report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from ..files import json_text
from .options import volume_options
from .streams import write_out

__all__ = ["schema"]

FILE, PLACE = Path(__file__).parents[1] / "report.schema.json", "#/$defs/"
#: Commands with a report; batch and morph write theirs to their folder, and so do examples.
REPORTING = (
    *("batch", "build", "check", "compare", "examples", "library", "morph", "parameterize", "poisson", "quality"),
    *("refine", "transfer"),
)


@click.command()
@click.argument("command", required=False, type=click.Choice(REPORTING))
@volume_options
def schema(command: str | None) -> None:
    """Write the JSON schema (draft 2020-12) of all reports, or of those of COMMAND, to standard output.

    Every key is described, with its unit.
    """
    write_out(FILE.read_text(encoding="utf-8") if command is None else json_text(_of_command(command)))


def _of_command(command: str) -> dict[str, Any]:
    """Of a command's reports, and nothing else."""
    whole: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    roots = [command, *(["batch_target"] if command == "batch" else []), "failure"]
    needed: list[str] = []
    left = list(roots)
    while left:
        name = left.pop()
        if name not in needed:
            needed.append(name)
            left += _named(whole["$defs"][name])
    return {
        "$schema": whole["$schema"],
        "title": f"Reports of patchtransfer {command}",
        "description": whole["description"],
        "anyOf": [{"$ref": f"{PLACE}{name}"} for name in roots],
        "$defs": {name: text for name, text in whole["$defs"].items() if name in needed},
    }


def _named(part: Any) -> list[str]:
    """The definitions that a part of a schema refers to."""
    if isinstance(part, list):
        return [name for item in part for name in _named(item)]
    if not isinstance(part, dict):
        return []
    own = [part["$ref"].removeprefix(PLACE)] if "$ref" in part else []
    return own + [name for item in part.values() for name in _named(item)]
