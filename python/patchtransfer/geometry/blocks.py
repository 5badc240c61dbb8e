"""`Block`: a part of a file that is not geometry."""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["Block"]

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
