"""Sides of patches, and the interfaces that glue them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["CORNERS", "Interface", "Side", "around_corner"]

Number = TypeVar("Number", bound=np.generic)

CORNERS = ((0, 0), (-1, 0), (0, -1), (-1, -1))
"""Patch corners as indices into the control points."""


class Side(IntEnum):
    """A side of a patch, numbered as in G+Smo."""

    WEST = 1
    """u = first knot."""
    EAST = 2
    """u = last knot."""
    SOUTH = 3
    """v = first knot."""
    NORTH = 4
    """v = last knot."""

    @property
    def axis(self) -> int:
        """Direction that runs along the side: 1 (v) for west and east, 0 (u) for south and north."""
        return 1 if self <= Side.EAST else 0

    @property
    def at_end(self) -> bool:
        """Whether the side lies at the last knot of the direction across it."""
        return self in (Side.EAST, Side.NORTH)

    def of(self, array: NDArray[Number], row: int = 0) -> NDArray[Number]:
        """The slice of an (n_u, n_v, ...) array on this side, `row` rows into the patch."""
        index = -1 - row if self.at_end else row
        return array[index] if self.axis == 1 else array[:, index]


@dataclass(frozen=True)
class Interface:
    """Two patch sides that are glued.

    `reversed` says whether the parameters along the two sides run in opposite directions.
    """

    patch_a: int
    side_a: Side
    patch_b: int
    side_b: Side
    reversed: bool

    @property
    def name(self) -> str:
        """The two sides, as messages name them: "patch 0 east - patch 1 west"."""
        return f"patch {self.patch_a} {self.side_a.name.lower()} - patch {self.patch_b} {self.side_b.name.lower()}"


def around_corner(array: NDArray[Number], corner: int) -> NDArray[Number]:
    """Entries (3, ...) of an (n_u, n_v, ...) array at a patch corner, 0 to 3, next to it along u, and along v."""
    i, j = CORNERS[corner]
    return np.stack([array[i, j], array[1 if i == 0 else -2, j], array[i, 1 if j == 0 else -2]])
