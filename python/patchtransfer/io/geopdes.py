"""GeoPDEs text files: multi-patches with interfaces, subdomains and named boundaries.

Conventions, from the format's specifications (``geo_specs_v06`` to ``v21``, the same for several patches) and GeoPDEs'
own reader: every record is a line; ``#`` starts a comment line. The first says ``dim rdim patches interfaces
subdomains``, the last ones optional, and without ``rdim`` before version 1.0. u runs fastest in coordinates, which are
multiplied by their weights. Patches are counted from 1; sides are 1 u=0, 2 u=1, 3 v=0, 4 v=1. An interface is two
sides and 1 if their parameters run in the same sense, -1 if not. Subdomains are lists of patches, boundaries lists of
sides; both have names, and so may patches and interfaces.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, InputWarning
from ..geometry.blocks import Block
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import Interface, Side
from ..limits import MAX_PATCHES, at_most
from .options import DEFAULT, BoundaryOptions
from .tensor import boundary_of, check_sizes, homogeneous, patch_of
from .text import TextLines, is_number

__all__ = ["format_multipatch", "looks_like_geopdes", "read_boundary", "read_multipatch"]

NAME = "GeoPDEs"
VERSION = re.compile(r"nurbs.*?\bv\.?\s*([0-9]{1,4})\.([0-9])", re.IGNORECASE)
#: Interfaces or subdomains of a file: more than patches have sides.
MAX_RECORDS = 4 * MAX_PATCHES

SideList = tuple[tuple[int, Side], ...]


def looks_like_geopdes(data: bytes) -> bool:
    """Whether a text says so in a comment, or starts with the counts of a model and a patch's name."""
    comments, rows = [], []
    for line in data[:65536].decode("utf-8-sig", errors="replace").splitlines():
        if line.startswith("#"):
            comments.append(line)
        elif line.strip():
            rows.append(line.split())
        if len(rows) == 2:
            break
    if not rows or not all(re.fullmatch("[0-9]{1,6}", word) for word in rows[0]) or not 2 <= len(rows[0]) <= 5:
        return False
    named = len(rows) == 2 and not is_number(rows[1][0])
    return named or any(VERSION.search(comment) for comment in comments)


@dataclass(frozen=True)
class _Header:
    """The counts in the first line, and the comments above it."""

    space: int
    patches: int
    interfaces: int
    subdomains: int
    comments: tuple[str, ...]


def _header(lines: TextLines) -> _Header:
    counts = lines.integers("the numbers of dimensions and patches", (2, 3, 4, 5))
    versions = [(int(v[1]), int(v[2])) for c in lines.comments if (v := VERSION.search(c))]
    # Without a version: no geometry has fewer dimensions than its parameters.
    old = versions[-1] < (1, 0) if versions else counts[1] < counts[0]
    if old:
        counts.insert(1, counts[0])
    elif len(counts) == 2:
        counts.append(1)
    counts += [0] * (5 - len(counts))
    if len(counts) > 5:
        raise InputError(f"line {lines.number}: 5 numbers instead of 4 in a file before version 1.0; correct it")
    limits = {"patches": MAX_PATCHES, "interfaces": MAX_RECORDS, "subdomains": MAX_RECORDS}
    for count, (what, limit) in zip(counts[2:], limits.items(), strict=True):
        if count < (what == "patches"):
            raise InputError(f"line {lines.number}: {count} {what}; correct the number")
        at_most(count, limit, what, "split the model")
    if counts[0] != 2:
        kind = {1: "curves", 3: "volumes"}.get(counts[0], f"geometry of dimension {counts[0]}")
        raise InputError(
            f"line {lines.number}: holds {kind} (dimension {counts[0]}); only planar patches are supported"
        )
    if counts[1] not in (2, 3):
        raise InputError(f"line {lines.number}: space of dimension {counts[1]}; only planar patches are supported")
    kept = tuple(c for c in lines.comments if c and not VERSION.search(c))
    return _Header(counts[1], counts[2], counts[3], counts[4], kept)


def _patch(lines: TextLines, number: int, space: int, before: int) -> tuple[Patch, str, int]:
    """A patch, its name, and the control points of all so far."""
    default = where = f"patch {number}"
    name, ahead = default, lines.peek()
    if ahead is not None and not all(map(is_number, ahead.replace(",", " ").split(None, 1)[:1])):
        name = lines.next(where)
        where = where if _same(name, default) else f"patch {number} ({name[:40]})"
    degrees = lines.integers(f"degrees of {where}", (2,))
    counts = lines.integers(f"numbers of control points of {where}", (2,))
    total = check_sizes(degrees, counts, before, where)
    knots = [
        lines.numbers(f"knots {axis} of {where}", count + degree + 1)
        for axis, count, degree in zip("uv", counts, degrees, strict=True)
    ]
    size = counts[0] * counts[1]
    rows = [lines.numbers(f"{axis} of {where}", size) for axis in "xyz"[:space]]
    weights = lines.numbers(f"weights of {where}", size)
    points = np.stack([row.reshape(counts[::-1]).T for row in rows], axis=2)
    return patch_of(where, knots, degrees, points, weights.reshape(counts[::-1]).T, True), name, total


def _side(lines: TextLines, what: str, patches: int) -> tuple[int, Side]:
    """A line ``patch side``."""
    patch, side = lines.integers(what, (2,))
    if not 1 <= patch <= patches:
        raise InputError(f"line {lines.number}, {what}: there is no patch {patch}, the patches are 1 to {patches}")
    if not 1 <= side <= 4:
        raise InputError(f"line {lines.number}, {what}: side {side} is not 1, 2, 3 or 4; correct it")
    return patch - 1, Side(side)


def _interface(lines: TextLines, number: int, patches: int) -> tuple[Interface, str]:
    name = lines.next(f"interface {number}")
    a, b = (_side(lines, f"interface {number}", patches) for _ in range(2))
    (sense,) = lines.integers(f"orientation of interface {number}", (1,))
    if sense not in (1, -1):
        raise InputError(f"line {lines.number}, interface {number}: orientation {sense} is not 1 or -1; correct it")
    return Interface(*a, *b, sense == -1), name


def _subdomain(lines: TextLines, number: int, patches: int) -> Block:
    name = lines.next(f"subdomain {number}")
    members = lines.integers(f"patches of subdomain {number}")
    if not all(1 <= k <= patches for k in members):
        raise InputError(f"line {lines.number}, subdomain {number}: the patches are 1 to {patches}; correct it")
    return Block(NAME, "subdomain", f"{name}\n{' '.join(map(str, members))}")


def _boundaries(lines: TextLines, patches: int) -> dict[str, SideList]:
    """Sides by the names of the boundaries, to the end of the file."""
    labels: dict[str, SideList] = {}
    while lines.peek() is not None:
        number = len(labels) + 1
        what = f"boundary {number}"
        name = lines.next(what)
        (count,) = lines.integers(f"the number of sides of {what}", (1,))
        if count < 0:
            raise InputError(f"line {lines.number}, {what}: {count} sides; correct the number")
        at_most(count, 4 * patches, f"sides of {what} (line {lines.number})", "correct the number")
        sides = tuple(_side(lines, what, patches) for _ in range(count))
        if len(set(sides)) != len(sides):
            raise InputError(f"line {lines.number}, {what}: names a side twice; delete one")
        if name in labels:
            free = f"{name} ({number})"
            warnings.warn(f"two boundaries are called {name!r}; one is read as {free!r}", InputWarning, stacklevel=5)
            name = free
        labels[name] = sides
    return labels


def _same(name: str, default: str) -> bool:
    """Whether a name is the one that programs give by number."""
    return name.casefold().split() == default.split()


def _names(names: Iterable[str], kind: str) -> list[Block]:
    """The names of patches or interfaces, if any is not its number."""
    listed = list(names)
    if all(_same(name, f"{kind} {k}") for k, name in enumerate(listed, 1)):
        return []
    return [Block(NAME, f"{kind} names", "\n".join(listed))]


def read_multipatch(data: bytes) -> MultiPatch:
    """Multi-patch of a GeoPDEs text file; see `patchtransfer.read`."""
    lines = TextLines(data)
    header = _header(lines)
    patches, patch_names, total = [], [], 0
    for k in range(header.patches):
        patch, name, total = _patch(lines, k + 1, header.space, total)
        patches.append(patch)
        patch_names.append(name)
    stated = [_interface(lines, k + 1, len(patches)) for k in range(header.interfaces)]
    subdomains = [_subdomain(lines, k + 1, len(patches)) for k in range(header.subdomains)]
    labels = _boundaries(lines, len(patches))
    on_boundary = {side for sides in labels.values() for side in sides}
    # All sides listed as boundary says "no interfaces"; nothing listed says nothing.
    silent = not stated and len(on_boundary) < 4 * len(patches)
    blocks = [Block(NAME, "comment", "\n".join(header.comments))] if header.comments else []
    blocks += [*_names(patch_names, "patch"), *_names([name for _, name in stated], "interface"), *subdomains]
    try:
        return MultiPatch(patches, None if silent else [f for f, _ in stated], None, labels, blocks)
    except InputError as error:
        # Messages count patches from 0, the file from 1.
        raise InputError(f"{error} (patches counted from 0)") from None


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of a GeoPDEs text file; see `patchtransfer.read_boundary`."""
    return boundary_of(read_multipatch(data))


def format_multipatch(multipatch: MultiPatch) -> str:
    """GeoPDEs text, version 2.1: patches, interfaces, subdomains, and a boundary for each label.

    GeoPDEs knows no boundary condition on a side without a boundary, so every side that no label names is one of its
    own.
    """
    blocks = [block for block in multipatch.blocks if block.format == NAME]
    count = len(multipatch)
    subdomains = [b.text for b in blocks if b.kind == "subdomain" and _valid_subdomain(b, count)]
    lines = ["# nurbs mesh v.2.1"]
    lines += [f"# {line}" for b in blocks if b.kind == "comment" for line in b.text.split("\n")]
    lines += [f"2 2 {count} {len(multipatch.interfaces)} {len(subdomains)}"]
    for k, (patch, name) in enumerate(zip(multipatch, _written_names(blocks, "patch", count), strict=True)):
        lines += [name, *_patch_lines(patch, f"patch {k}")]
    names = _written_names(blocks, "interface", len(multipatch.interfaces))
    for f, name in zip(multipatch.interfaces, names, strict=True):
        sides = [f"{f.patch_a + 1} {int(f.side_a)}", f"{f.patch_b + 1} {int(f.side_b)}"]
        lines += [name, *sides, "-1" if f.reversed else "1"]
    lines += subdomains
    for name, boundary in _written_boundaries(multipatch).items():
        lines += [name, str(len(boundary)), *(f"{k + 1} {int(side)}" for k, side in boundary)]
    return "\n".join([*lines, ""])


def _patch_lines(patch: Patch, where: str) -> list[str]:
    points = homogeneous(patch, where)
    rows: list[list[float]] = [knots.tolist() for knots in patch.knots]
    rows += [points[..., k].T.ravel().tolist() for k in range(3)]
    sizes = [" ".join(map(str, pair)) for pair in (patch.degrees, patch.shape)]
    return sizes + [" ".join(map(repr, row)) for row in rows]


def _written_names(blocks: list[Block], kind: str, count: int) -> list[str]:
    kept = [block.text.split("\n") for block in blocks if block.kind == f"{kind} names"]
    if kept and len(kept[0]) == count:
        return kept[0]
    if kept:
        lost = f"{len(kept[0])} {kind} names of the file read do not fit {count}; left out"
        warnings.warn(lost, InputWarning, stacklevel=4)
    return [f"{kind.upper()} {k}" for k in range(1, count + 1)]


def _valid_subdomain(block: Block, patches: int) -> bool:
    name, _, members = block.text.partition("\n")
    if all(word.isdigit() and 1 <= int(word) <= patches for word in members.split()):
        return True
    lost = f"subdomain {name!r} names patches that the model no longer has; left out"
    warnings.warn(lost, InputWarning, stacklevel=4)
    return False


def _written_boundaries(multipatch: MultiPatch) -> dict[str, SideList]:
    """Names as a line can hold them, and sides; those without a label one by one."""
    on_boundary = set(multipatch.boundaries)
    written: dict[str, SideList] = {}
    for label, named in multipatch.sides.items():
        name = " ".join(label.split()).lstrip("# ") or "BOUNDARY"
        while name in written:
            name += "'"
        if name != label:
            warnings.warn(f"label {label!r} is written as {name!r}", InputWarning, stacklevel=4)
        sides = tuple(side for side in named if side in on_boundary)
        if len(sides) < len(named):
            lost = f"label {label!r}: {len(named) - len(sides)} sides inside the model are no boundary; left out"
            warnings.warn(lost, InputWarning, stacklevel=4)
        written[name] = sides
    labelled = {side for sides in written.values() for side in sides}
    for side in multipatch.boundaries:
        if side not in labelled:
            number = len(written) + 1
            while f"BOUNDARY {number}" in written:
                number += 1
            written[f"BOUNDARY {number}"] = (side,)
    return written
