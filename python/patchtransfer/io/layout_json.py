"""Quad layouts in JSON: vertices, quads, and the file that holds the boundary."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..limits import LARGEST, MAX_LAYOUT_BYTES, MAX_LAYOUT_DEGREE, MAX_QUADS, at_most

__all__ = ["LayoutFile", "looks_like_a_layout", "parse_layout"]

FIELDS = ("vertices", "quads", "boundary", "degree", "spans", "assignment")

#: Digits of whole numbers: more do not fit into a coordinate, and thousands would take Python long.
MAX_DIGITS = 17


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


def looks_like_a_layout(data: bytes) -> bool:
    """Whether it is a JSON object that names the first fields of a layout."""
    return data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and b'"quads"' in data and b'"vertices"' in data


def parse_layout(data: bytes, folder: Path, read_boundary: Any) -> LayoutFile:
    """Parse a layout; `boundary` names a file relative to `folder`, read by `read_boundary`.

    Raises
    ------
    InputError
        On malformed JSON, missing or unknown fields, and values of the wrong kind.
    """
    at_most(len(data), MAX_LAYOUT_BYTES, "bytes", "a layout is coarse; name the boundary's file instead")
    try:
        content = json.loads(data, parse_constant=_no_number, parse_int=_whole)
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"malformed JSON: {error}") from None
    except RecursionError:
        raise InputError("lists or objects are nested thousands deep; a layout needs three levels") from None
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
            raise InputError(f'"{name}" must be an integer, got {str(value)[:30]}')
        numbers[name] = value
    try:
        assignment = {int(v[:MAX_DIGITS]): _point(x) for v, x in content.get("assignment", {}).items()}
    except (AttributeError, TypeError, ValueError):
        raise InputError('"assignment" must map vertex numbers to points [x, y] of finite numbers') from None
    _check_lists(content["vertices"], content["quads"])
    at_most(numbers["degree"], MAX_LAYOUT_DEGREE, "as degree", "take a lower one (2 or 3 are usual)")
    file = folder / content["boundary"]
    return LayoutFile(
        content["vertices"],
        content["quads"],
        read_boundary(file),
        **numbers,
        assignment=assignment,
        boundary_file=file,
    )


def _no_number(name: str) -> Any:
    raise InputError(f"{name} is not a number; give finite numbers")


def _whole(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise InputError(f"{text[:10]}... has {len(text)} digits; write large numbers as 1e20")
    return int(text)


def _point(value: Any) -> list[float]:
    x, y = (float(coordinate) for coordinate in value)
    if isinstance(value, str) or not max(abs(x), abs(y)) <= LARGEST:
        raise ValueError
    return [x, y]


def _check_lists(vertices: list[Any], quads: list[Any]) -> None:
    """Raise `InputError` on vertices that are not points and quads that are not four vertices, naming the first."""
    at_most(len(quads), MAX_QUADS, "quads", "take larger ones and more spans in each")
    at_most(len(vertices), 4 * MAX_QUADS, "vertices", "delete those of no quad")
    for k, vertex in enumerate(vertices):
        try:
            good = len(vertex) == 2 and _point(vertex) is not None and not any(isinstance(x, str) for x in vertex)
        except (TypeError, ValueError):
            good = False
        if not good:
            raise InputError(f'"vertices": number {k} is not a point [x, y] of numbers up to {LARGEST:g}; correct it')
    for k, quad in enumerate(quads):
        whole = isinstance(quad, list) and all(isinstance(v, int) and not isinstance(v, bool) for v in quad)
        if not whole or len(quad) != 4:
            raise InputError(f'"quads": number {k} is not a list of four vertex numbers; correct it')
