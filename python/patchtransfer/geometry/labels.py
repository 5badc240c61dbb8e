"""Labels: names of sides of a multi-patch, checked, and carried over where patches are split, dropped or renumbered."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from operator import index
from types import MappingProxyType
from typing import Any

from ..errors import InputError
from .blocks import Parts
from .sides import Side

__all__ = ["Labels", "checked", "plain", "relabelled"]

#: Names of sides: (patch, side) pairs of each.
Labels = Mapping[str, tuple[tuple[int, Side], ...]]


def checked(labels: Mapping[str, Iterable[Any]], patches: int) -> Labels:
    """Labels as a read-only mapping to pairs.

    Parameters
    ----------
    labels : mapping of str to iterables of (patch, side), or to one such pair
        Sides as `Side`, number or name ("west").
    patches : int
        How many there are.

    Raises
    ------
    InputError
        Naming the label and what is wrong with it.
    """
    if not isinstance(labels, Mapping):
        raise InputError(f"labels are a mapping of names to (patch, side) pairs, not a {type(labels).__name__}")
    sides = {}
    for name, where in labels.items():
        if not isinstance(name, str) or not name.strip():
            raise InputError(f"a label is a name, not {name!r}")
        named = [_pair(name, pair, patches) for pair in _pairs(name, where)]
        if len(set(named)) != len(named):
            raise InputError(f"label {name!r} names a side twice")
        sides[name] = tuple(named)
    return MappingProxyType(sides)


def _pairs(name: str, where: object) -> list[Any]:
    if isinstance(where, (str, bytes)) or not isinstance(where, Iterable):
        raise InputError(f"label {name!r}: expected (patch, side) pairs such as [(0, Side.WEST)], got {where!r}")
    found = list(where)
    # One pair without its list.
    single = len(found) == 2 and not any(isinstance(part, (tuple, list)) for part in found)
    return [tuple(found)] if single else found


def _pair(name: str, pair: Any, patches: int) -> tuple[int, Side]:
    if isinstance(pair, (str, bytes)) or not isinstance(pair, Sequence) or len(pair) != 2:
        raise InputError(f"label {name!r}: {pair!r} is not a pair (patch, side)")
    try:
        patch = index(pair[0])
    except TypeError:
        raise InputError(f"label {name!r}: a patch is a whole number, not {pair[0]!r}") from None
    if not 0 <= patch < patches:
        raise InputError(f"label {name!r}: there is no patch {patch}, the patches are 0 to {patches - 1}")
    side = Side.__members__.get(pair[1].upper()) if isinstance(pair[1], str) else pair[1]
    if side not in list(Side):
        raise InputError(
            f"label {name!r}: side {pair[1]!r} of patch {patch} is not one of 1, 2, 3, 4 (west, east, south, north)"
        )
    return patch, Side(side)


def plain(labels: Labels) -> dict[str, list[dict[str, int]]]:
    """Labels for JSON: of each the patches and sides, numbered as in Python."""
    return {name: [{"patch": k, "side": int(side)} for k, side in where] for name, where in labels.items()}


def relabelled(labels: Labels, parts: Parts) -> tuple[dict[str, list[tuple[int, Side]]], list[str]]:
    """Labels after patches were split, dropped or renumbered.

    Parameters
    ----------
    labels : mapping
        As of the old model.
    parts : mapping of (old patch, side) to sequence of (new patch, side)
        What became of every side, in order along it; a side that is missing, or has no parts, is gone.

    Returns
    -------
    labels : dict
        Of the new model.
    lost : list of str
        A line for every label that lost sides, naming them.
    """
    new: dict[str, list[tuple[int, Side]]] = {}
    lost = []
    for name, where in labels.items():
        new[name] = list(dict.fromkeys(part for side in where for part in parts.get(side, ())))
        gone = [f"patch {k} {side.name.lower()}" for k, side in where if not parts.get((k, side))]
        if gone:
            lost.append(f"label {name!r} lost {', '.join(gone)}: there is no such side any more")
    return new, lost
