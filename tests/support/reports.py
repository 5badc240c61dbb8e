"""Reports held to the published schema."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

import patchtransfer as pt

SCHEMA = json.loads((Path(pt.__file__).parent / "report.schema.json").read_text(encoding="utf-8"))


@cache
def validator(name: str) -> Draft202012Validator:
    """Of the reports with this name among the definitions."""
    return Draft202012Validator({"$ref": f"#/$defs/{name}", "$defs": SCHEMA["$defs"]})


def faults(content: Any, *names: str) -> list[str]:
    """Where a report differs from all definitions of these names: from the one that is nearest."""
    found = []
    for name in names:
        errors = sorted(validator(name).iter_errors(content), key=lambda error: [str(step) for step in error.path])
        if not errors:
            return []
        found.append([f"{name} {error.json_path}: {error.message[:300]}" for error in errors])
    return min(found, key=len)


def written(arguments: list[str], stdout: str) -> list[tuple[Any, tuple[str, ...]]]:
    """The reports of a command, with the names of what each may be."""
    found: list[tuple[Any, tuple[str, ...]]] = []
    command = arguments[0]
    if "--json" in arguments[:-1]:
        path = arguments[arguments.index("--json") + 1]
        text = stdout if path == "-" else Path(path).read_text() if Path(path).is_file() else ""
        # An error of the options comes before any report, and an input is none that was not replaced.
        if text.startswith("{") and arguments.count(path) == 1:
            found.append((json.loads(text), (command, "failure")))
    if command in ("batch", "morph", "examples") and "-o" in arguments[:-1]:
        folder = Path(arguments[arguments.index("-o") + 1])
        kinds = {"report.json": command, "summary.json": "batch"}
        for path in folder.glob("*.json") if folder.is_dir() else ():
            kind = "batch_target" if path.name.endswith(".report.json") else kinds.get(path.name)
            # A folder may hold broken files of a test.
            if kind is not None and path.read_text().startswith("{"):
                found.append((json.loads(path.read_text()), (kind,)))
    return found
