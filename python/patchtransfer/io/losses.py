"""What a file format cannot hold of a model, said when it is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..geometry.interfaces import infer_interfaces
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Interface, Side
from .formats import Format

__all__ = ["losses"]

#: Names that a message lists.
LISTED = 5


def losses(mp: MultiPatch, format_: Format) -> list[str]:
    """What is left out when a model is written in a format, a line each; empty where nothing is."""
    lost = list(_lost(mp, format_))
    return [f"{format_.name} holds no {what}; left out" for what in lost]


def _lost(mp: MultiPatch, format_: Format) -> Iterator[str]:
    holds = format_.holds
    if "weights" not in holds and mp.is_rational:
        yield "weights: its geometry is another one"
    if "labels" not in holds and mp.sides:
        yield f"labels of sides ({_listed(list(mp.sides))})"
    for origin in sorted({block.format for block in mp.blocks}):
        # Comments and heads of elements are not worth a word.
        found = [b for b in mp.blocks if b.format == origin and b.kind != "comment" and not b.kind.endswith("head")]
        if found and "all blocks" not in holds and not ("blocks" in holds and origin == format_.name):
            yield f"{_listed(list(dict.fromkeys(block.name for block in found)))} of {origin}"
    if "ids" not in holds and mp.ids != tuple(range(len(mp))):
        yield "ids of patches: they are numbered from 0"
    if "interfaces" not in holds and _sides(infer_interfaces(mp.patches)) != _sides(mp.interfaces):
        yield "interfaces: reading finds other ones than the model has"


def _sides(interfaces: Iterable[Interface]) -> set[frozenset[tuple[int, Side]]]:
    """Glued sides, whichever comes first."""
    return {frozenset([(f.patch_a, f.side_a), (f.patch_b, f.side_b)]) for f in interfaces}


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
