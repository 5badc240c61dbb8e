"""The parts of an XML document's root, cut out of its text as they stand there."""

from __future__ import annotations

import re
from typing import NamedTuple
from xml.parsers.expat import ParserCreate

__all__ = ["Piece", "cut"]

_DECLARED = re.compile(rb"""<\?xml[^>]*?\sencoding\s*=\s*["']([\w.-]+)""", re.ASCII)


class Piece(NamedTuple):
    """A part of the document.

    Attributes
    ----------
    kind : str
        An element's tag, "comment", "instruction" or "text".
    text : str
    child : int or None
        Of elements, and of comments inside them: which child of the root it is.
    """

    kind: str
    text: str
    child: int | None = None


def cut(data: bytes) -> tuple[str, list[Piece]]:
    """The root's start tag, and everything in the document but blanks and the declaration.

    Comments inside the root's children come twice, with the child and, before it, on their own. The document is known
    to be well-formed and free of a document type.
    """
    cutter = _Cutter(_as_utf8(data))
    return cutter.root, cutter.pieces


def _as_utf8(data: bytes) -> bytes:
    body = data.lstrip()
    if body.startswith((b"\xff\xfe", b"\xfe\xff")):
        return body.decode("utf-16").encode()
    declared = _DECLARED.match(body)
    return body.removeprefix(b"\xef\xbb\xbf").decode(declared[1].decode() if declared else "utf-8").encode()


class _Cutter:
    """Notes where the parts of the root begin; each ends where the next begins."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.root = ""
        self.pieces: list[Piece] = []
        self._open: tuple[str, int, int | None] | None = None
        self._depth = 0
        self._children = 0
        self._parser = parser = ParserCreate("utf-8")
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CommentHandler = self._comment
        parser.ProcessingInstructionHandler = lambda *_: self._begin("instruction") if self._depth < 2 else None
        parser.StartCdataSectionHandler = self._text
        parser.Parse(data, True)
        self._close(len(data))

    def _begin(self, kind: str, child: int | None = None) -> None:
        at = self._parser.CurrentByteIndex
        self._close(at)
        self._open = (kind, at, child)

    def _close(self, at: int) -> None:
        if self._open is None:
            return
        kind, start, child = self._open
        self._open = None
        text = self.data[start:at].decode().strip()
        if kind == "root":
            self.root = text
        elif text:
            self.pieces.append(Piece(kind, text, child))

    def _start(self, tag: str, _: dict[str, str]) -> None:
        self._depth += 1
        if self._depth == 1:
            self._begin("root")
        elif self._depth == 2:
            self._begin(tag, self._children)
            self._children += 1
        # Text inside the root's children is cut with them: not worth a call a line.
        self._parser.CharacterDataHandler = self._text if self._depth == 1 else None

    def _end(self, _: str) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._close(self._parser.CurrentByteIndex)
        self._parser.CharacterDataHandler = self._text if self._depth == 1 else None

    def _text(self, _: str = "") -> None:
        if self._depth == 1 and (self._open is None or self._open[0] != "text"):
            self._begin("text")

    def _comment(self, text: str) -> None:
        if self._depth < 2:
            self._begin("comment")
        else:
            self.pieces.append(Piece("comment", f"<!--{text}-->", self._children - 1))
