"""What a G+Smo file holds besides its patches: kept word for word, in the file's order.

Three kinds of blocks belong to the patches' own elements: the root's start tag, if it is not plain, and, with all that
is read cut out, the ``MultiPatch``, which also says where the patches stood, and those ``Geometry`` elements that hold
more than a spline.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from xml.etree.ElementTree import Element, tostring

from ...geometry.blocks import Block
from .cutting import cut

__all__ = ["FORMAT", "GEOMETRY", "HEAD", "ROOT", "default_head", "outside"]

FORMAT = "G+Smo XML"
ROOT, HEAD, GEOMETRY = "root head", "MultiPatch head", "Geometry head"
"""Kinds of the blocks that belong to the patches' own elements."""

READ = {"MultiPatch": {"patches", "interfaces", "boundary"}, "Geometry": {"Basis", "coefs"}}
"""Children of elements that are read, and written anew."""

#: A coordinate in an expression.
_COORDINATE = re.compile(r"(?<!\w)[xyz](?!\w)")


def outside(
    root: Element, data: bytes, used: Iterable[Element], block: Element | None, ids: Sequence[int]
) -> tuple[Block, ...]:
    """Blocks of a file, in its order.

    Parameters
    ----------
    root : Element
    data : bytes
        What it was parsed from.
    used : iterable of Element
        The geometries that became patches.
    block : Element or None
        The ``MultiPatch`` that was read.
    ids : sequence of int
        Of the patches.
    """
    number = {id(element): i for element, i in zip(used, ids, strict=True)}
    read = {*number, id(block)}
    tag, pieces = cut(data)
    before, after, heads, found = list[Block](), list[Block](), list[Block](), False
    for piece in pieces:
        element = None if piece.child is None else root[piece.child]
        if element is None or (piece.kind != "comment" and id(element) not in read):
            place = element is not None and _of_place(element)
            (after if found else before).append(Block(FORMAT, piece.kind, piece.text, place))
        elif id(element) in read:
            found = True
            if piece.kind == "comment":
                after.append(Block(FORMAT, "comment", piece.text))
            elif element is not block:
                heads += _geometry_head(element, number[id(element)])
    default = default_head(ids, (*before, *after))
    head = default if block is None else _shell(block)
    # Without a head the patches come first.
    own = [] if head == default and not before else [Block(FORMAT, HEAD, head)]
    start = [] if tag == "<xml>" else [Block(FORMAT, ROOT, tag)]
    return (*start, *before, *own, *heads, *after)


def default_head(ids: Sequence[int], blocks: Iterable[Block]) -> str:
    """The ``MultiPatch`` element, without content, of patches that come with none; its id is free."""
    return f'<MultiPatch parDim="2" id="{max(-1, *ids, *_taken_ids(blocks)) + 1}"></MultiPatch>'


def _taken_ids(blocks: Iterable[Block]) -> set[int]:
    """Ids of the blocks that are elements of their own."""
    own = (ROOT, HEAD, GEOMETRY)
    return {b.id for b in blocks if b.format == FORMAT and b.kind not in own and b.id is not None}


def _geometry_head(element: Element, number: int) -> list[Block]:
    """What a geometry holds besides a spline, under the id that it is written with."""
    plain = set(element.attrib) <= {"type", "id", "index"} and all(c.tag in READ["Geometry"] for c in element)
    if plain:
        return []
    numbered = Element(element.tag, {"id": str(number)} | {k: v for k, v in element.attrib.items() if k != "id"})
    numbered.extend(element)
    return [Block(FORMAT, GEOMETRY, _shell(numbered))]


def _shell(element: Element) -> str:
    """An element without what is read of it."""
    shell = Element(element.tag, element.attrib)
    for child in element:
        if child.tag not in READ[element.tag]:
            copy = Element(child.tag, child.attrib)
            copy.text = child.text
            copy.extend(child)
            shell.append(copy)
    return tostring(shell, encoding="unicode", short_empty_elements=False)


def _of_place(element: Element) -> bool:
    """Whether an element holds functions of the coordinates."""
    if element.tag in ("Geometry", "MultiPatch"):
        return False
    texts = (e.text or "" for e in element.iter() if e.tag in ("Function", "c", "cv"))
    return any(_COORDINATE.search(text) for text in texts)
