"""Strips of patches: what is inserted into, or taken from, the knots of one patch concerns all of its strip.

Patches in a row, joined through opposite sides, have the same knots across the row: the pairs (patch, axis) of these
knot vectors make a strip.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

from .combinatorics import Quantity
from .sides import Interface
from .topology import Topology

__all__ = ["Strip", "strips", "strips_of"]


class Strip(NamedTuple):
    """Knot vectors that are the same.

    Attributes
    ----------
    members : dict of (patch, axis) to bool
        Whether the axis runs against the first one.
    interfaces : list of int
        Sorted, along which they meet.
    twisted : bool
        Whether some also run against themselves, as on a Möbius band.
    """

    members: dict[tuple[int, int], bool]
    interfaces: list[int]
    twisted: bool


@Quantity
def strips(topology: Topology) -> tuple[Strip, ...]:
    """All strips, in the order of their first patch and axis."""
    return strips_of(len(topology.patches), topology.interfaces)


def strips_of(count: int, interfaces: Sequence[Interface]) -> tuple[Strip, ...]:
    """The same of `count` patches that may have different knots across their interfaces."""
    beside: dict[tuple[int, int], list[tuple[int, tuple[int, int]]]] = defaultdict(list)
    for i, f in enumerate(interfaces):
        a, b = (f.patch_a, f.side_a.axis), (f.patch_b, f.side_b.axis)
        beside[a].append((i, b))
        beside[b].append((i, a))
    found: list[Strip] = []
    seen: set[tuple[int, int]] = set()
    for first in ((k, axis) for k in range(count) for axis in (0, 1)):
        if first in seen:
            continue
        members, twisted, queue = {first: False}, False, [first]
        inside: set[int] = set()
        for here in queue:
            for i, there in beside[here]:
                inside.add(i)
                flipped = members[here] != interfaces[i].reversed
                if there not in members:
                    members[there] = flipped
                    queue.append(there)
                twisted |= members[there] != flipped
        seen |= members.keys()
        found.append(Strip(members, sorted(inside), twisted))
    return tuple(found)
