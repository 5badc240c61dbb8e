"""`Block`: a part of a file that is not geometry."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    # Loads NumPy, which importing the package does not.
    from .sides import Side

__all__ = ["Block", "Parts", "renumber_with", "renumbered"]

#: What became of the sides of patches: of each (patch, side), its parts in the new model in order along it. A side that
#: is missing is gone.
Parts: TypeAlias = "Mapping[tuple[int, Side], Sequence[tuple[int, Side]]]"

#: The id in the first tag.
_ID = re.compile(r"""<[^<>]*?\sid\s*=\s*["']\s*(\d{1,17})\s*["']""")


@dataclass(frozen=True, repr=False)
class Block:
    """A part of a file that is not geometry, kept word for word and written back to files of its format.

    Attributes
    ----------
    format : str
        Name of the file format, such as "G+Smo XML".
    kind : str
        What it is there, such as "boundaryConditions".
    text : str
    of_place : bool, default False
        Whether it holds functions of the coordinates, which mean another place once the geometry has moved.
    """

    format: str
    kind: str
    text: str
    of_place: bool = False

    @property
    def id(self) -> int | None:
        """The id in the text's first tag, if there is one."""
        found = _ID.match(self.text)
        return int(found[1]) if found else None

    @property
    def name(self) -> str:
        """Kind and, if the text begins with a tag that has one, id: "Function id=2"."""
        return self.kind if self.id is None else f"{self.kind} id={self.id}"

    def __repr__(self) -> str:
        return f"<Block: {self.kind} of {self.format}, {len(self.text)} characters>"


_renumber: Callable[[Block, Parts], tuple[Block, list[str]]] | None = None


def renumber_with(function: Callable[[Block, Parts], tuple[Block, list[str]]]) -> None:
    """Set what renumbers: reading the formats is a floor above the geometry."""
    global _renumber
    _renumber = function


def renumbered(blocks: Iterable[Block], parts: Parts) -> tuple[tuple[Block, ...], list[str]]:
    """Blocks after patches were split, dropped or renumbered, and a line for all in them that could not follow."""
    if _renumber is None:
        raise RuntimeError("nothing renumbers blocks: the package fills this in")
    done = [_renumber(block, parts) for block in blocks]
    return tuple(block for block, _ in done), [line for _, lost in done for line in lost]
