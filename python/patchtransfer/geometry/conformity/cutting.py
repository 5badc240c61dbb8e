"""Patches cut in two and more along parameter lines, with their interfaces and the names of their sides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from ...numeric.arrays import FloatArray
from ..patch import Patch
from ..sides import Interface, Side

__all__ = ["Pieces"]


class Pieces:
    """What becomes of patches that are cut.

    The first piece of a patch keeps its number, the others follow after all patches.

    Parameters
    ----------
    patches : sequence of Patch
    cuts : mapping of (patch, axis) to sorted parameters
        In the patch's own knots. Across every interface the cuts must match.
    """

    def __init__(self, patches: Sequence[Patch], cuts: Mapping[tuple[int, int], Sequence[float]]) -> None:
        self.patches: list[Patch] = list(patches)
        self.origins = list(range(len(patches)))
        """Of every piece the patch it was cut from."""
        self._grids: dict[int, list[list[int]]] = {}
        for k in sorted({k for k, _ in cuts}):
            grid = [split(column, 1, cuts.get((k, 1), ())) for column in split(patches[k], 0, cuts.get((k, 0), ()))]
            self._grids[k] = [[self._number(k, i + j, piece) for j, piece in enumerate(c)] for i, c in enumerate(grid)]

    def _number(self, k: int, position: int, piece: Patch) -> int:
        if position == 0:
            self.patches[k] = piece
            return k
        self.patches.append(piece)
        self.origins.append(k)
        return len(self.patches) - 1

    def on(self, side: tuple[int, Side]) -> list[tuple[int, Side]]:
        """The pieces of a side, in the order of its parameter."""
        k, name = side
        return [(int(piece), name) for piece in name.of(np.array(self.grid(k)))]

    def grid(self, k: int) -> list[list[int]]:
        """The pieces of a patch by column and row: along u, then along v."""
        return self._grids.get(k, [[k]])

    def glued(self, interfaces: Sequence[Interface]) -> list[Interface]:
        """The interfaces between the pieces: of the given ones, and along the cuts."""
        found = []
        for f in interfaces:
            b = self.on((f.patch_b, f.side_b))
            for (i, _), (j, _) in zip(self.on((f.patch_a, f.side_a)), b[::-1] if f.reversed else b, strict=True):
                found.append(Interface(i, f.side_a, j, f.side_b, f.reversed))
        for grid in self._grids.values():
            for left, right in pairwise(grid):
                found += [Interface(i, Side.EAST, j, Side.WEST, False) for i, j in zip(left, right, strict=True)]
            for column in grid:
                found += [Interface(i, Side.NORTH, j, Side.SOUTH, False) for i, j in pairwise(column)]
        return found


def split(patch: Patch, axis: int, at: Sequence[float]) -> list[Patch]:
    """Pieces of a patch between parameters `at` of a direction; neighbours share control points to the bit."""
    if not len(at):
        return [patch]
    p = patch.degrees[axis]
    missing = [np.repeat(t, p - np.count_nonzero(patch.knots[axis] == t)) for t in at]
    patch = patch.insert_knots(axis, np.concatenate(missing))
    knots = patch.knots[axis]
    pieces = []
    for low, high in pairwise([knots[0], *at, knots[-1]]):
        inner = knots[(knots > low) & (knots < high)]
        first = max(int(np.searchsorted(knots, low, side="right")) - p - 1, 0)
        index = slice(first, first + len(inner) + p + 1)
        own = np.concatenate([np.full(p + 1, low), inner, np.full(p + 1, high)])
        pieces.append(_part(patch, axis, own, index))
    return pieces


def _part(patch: Patch, axis: int, knots: FloatArray, index: slice) -> Patch:
    where = (index, slice(None)) if axis == 0 else (slice(None), index)
    both = (knots, patch.knots[1]) if axis == 0 else (patch.knots[0], knots)
    weights = None if patch.weights is None else patch.weights[where]
    return Patch(both, patch.degrees, patch.control_points[where], weights)
