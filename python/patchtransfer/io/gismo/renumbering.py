"""Boundary conditions of G+Smo XML: their rows name patches, which may be split, dropped or renumbered."""

from __future__ import annotations

import re

from ...geometry.blocks import Block, Parts
from ...geometry.sides import Side
from .outside import FORMAT

__all__ = ["renumbered"]

#: A condition with rows of patches and sides; those by label have no content.
_CONDITION = re.compile(r"(<bc\b[^<>]*(?<!/)>)([\s0-9]*)(</bc\s*>)")
#: A value at a corner of a patch.
_CORNER = re.compile(r"<cv\b[^<>]*>")
_PATCH, _NUMBER = (re.compile(rf"""(\s{name}\s*=\s*["'])\s*(\d+)\s*(["'])""") for name in ("patch", "corner"))

CORNERS = {
    1: (Side.WEST, Side.SOUTH),
    2: (Side.EAST, Side.SOUTH),
    3: (Side.WEST, Side.NORTH),
    4: (Side.EAST, Side.NORTH),
}
"""The sides that meet in a corner, by its number in G+Smo."""


def renumbered(block: Block, parts: Parts) -> tuple[Block, list[str]]:
    """A block with the numbers of the new model, and a line for everything that could not follow.

    Parameters
    ----------
    block : Block
        Of any format; others than boundary conditions stay as they are.
    parts : mapping of (old patch, side) to sequence of (new patch, side)
    """
    if block.format != FORMAT or block.kind != "boundaryConditions":
        return block, []
    lost: list[str] = []

    def condition(found: re.Match[str]) -> str:
        numbers = [int(n) for n in found[2].split()]
        if len(numbers) % 2 or not numbers:
            return found[0]
        rows = []
        for k, s in zip(numbers[::2], numbers[1::2], strict=True):
            new = parts.get((k, Side(s)), ()) if s in list(Side) else ()
            rows += [f"{patch} {int(side)}" for patch, side in new]
            if not new:
                lost.append(f"{block.name}: patch {k} side {s} has a condition, and is there no more")
        return found[1] + "\n".join(rows) + found[3]

    def corner(found: re.Match[str]) -> str:
        patch, number = _PATCH.search(found[0]), _NUMBER.search(found[0])
        if patch is None or number is None:
            return found[0]
        new = _corner(int(patch[2]), int(number[2]), parts)
        if new is None:
            lost.append(f"{block.name}: the value at corner {number[2]} of patch {patch[2]} keeps its old numbers")
            return found[0]
        text = _PATCH.sub(rf"\g<1>{new[0]}\g<3>", found[0])
        return _NUMBER.sub(rf"\g<1>{new[1]}\g<3>", text)

    text = _CORNER.sub(corner, _CONDITION.sub(condition, block.text))
    return Block(block.format, block.kind, text, block.of_place), lost


def _corner(patch: int, number: int, parts: Parts) -> tuple[int, int] | None:
    """The one new patch and corner where the parts of both sides of a corner meet."""
    sides = CORNERS.get(number, ())
    along = [dict(parts.get((patch, side), ())) for side in sides]
    if len(along) != 2:
        return None
    found = [
        (k, c)
        for k in along[0].keys() & along[1].keys()
        for c, pair in CORNERS.items()
        if {along[0][k], along[1][k]} == set(pair)
    ]
    return found[0] if len(found) == 1 else None
