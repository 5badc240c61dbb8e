"""Quad layouts in JSON: vertices, quads, and the file that holds the boundary."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..multipatch import Boundary

__all__ = ["LayoutFile", "parse_layout"]

FIELDS = ("vertices", "quads", "boundary", "degree", "spans", "assignment")


@dataclass(frozen=True)
class LayoutFile:
    """Contents of a layout file, the arguments of `from_layout`."""

    vertices: list[Any]
    quads: list[Any]
    boundary: Boundary
    degree: int
    spans: int
    assignment: dict[int, list[float]]
    boundary_file: Path


def parse_layout(data: bytes, folder: Path, read_boundary: Any) -> LayoutFile:
    """Parse a layout; `boundary` names a file relative to `folder`, read by `read_boundary`.

    Raises
    ------
    InputError
        On malformed JSON, missing or unknown fields, and values of the wrong kind.
    """
    try:
        content = json.loads(data)
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"malformed JSON: {error}") from None
    if not isinstance(content, dict):
        raise InputError(f"a layout is an object with {', '.join(FIELDS[:3])}, got a {type(content).__name__}")
    for name in FIELDS[:3]:
        if name not in content:
            raise InputError(f'"{name}" is missing; a layout has {", ".join(FIELDS[:3])}')
    unknown = sorted(set(content) - set(FIELDS))
    if unknown:
        raise InputError(f'unknown field "{unknown[0]}"; known are {", ".join(FIELDS)}')
    for name, kind in (("vertices", list), ("quads", list), ("boundary", str)):
        if not isinstance(content[name], kind):
            raise InputError(f'"{name}" must be a {kind.__name__}')
    numbers = {}
    for name, default in (("degree", 3), ("spans", 2)):
        value = content.get(name, default)
        if not isinstance(value, int) or isinstance(value, bool):
            raise InputError(f'"{name}" must be an integer, got {value!r}')
        numbers[name] = value
    try:
        assignment = {int(v): [float(x), float(y)] for v, (x, y) in content.get("assignment", {}).items()}
    except (AttributeError, TypeError, ValueError):
        raise InputError('"assignment" must map vertex numbers to points [x, y]') from None
    file = folder / content["boundary"]
    return LayoutFile(
        content["vertices"],
        content["quads"],
        read_boundary(file),
        **numbers,
        assignment=assignment,
        boundary_file=file,
    )
