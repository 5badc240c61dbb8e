"""`Block`: a part of a file that is not geometry."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Block"]


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
    """

    format: str
    kind: str
    text: str

    def __repr__(self) -> str:
        return f"<Block: {self.kind} of {self.format}, {len(self.text)} characters>"
