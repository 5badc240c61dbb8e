"""A loop of the outline, run with the domain on its left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.outline import Outline
from ...numeric.arrays import FloatArray

__all__ = ["DirectedLoop", "directed_loops"]

#: Arc lengths this close to a corner, relative to the loop's length, are meant to be at the corner.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class DirectedLoop:
    """An outline by arc length t that runs with the domain on the left.

    Attributes
    ----------
    outline : Outline
        As the user gave it.
    reversed : bool
        Whether it runs the other way.
    """

    outline: Outline
    reversed: bool

    @property
    def length(self) -> float:
        """Total length."""
        return self.outline.length

    def own(self, t: FloatArray) -> FloatArray:
        """Arc lengths on the user's outline, in [0, length)."""
        s = np.mod(-t if self.reversed else t, self.length)
        s = np.where(s >= self.length, 0.0, s)
        corners = np.sort(self.outline.corners[0])
        if len(corners):
            # Negating and wrapping round; beside a corner both tangents would be those of one side.
            around = np.concatenate([corners[-1:] - self.length, corners, corners[:1] + self.length])
            i = np.searchsorted((around[1:] + around[:-1]) / 2, s)
            near = np.abs(around[i] - s) <= ROUNDING * self.length
            s = np.where(near, corners[(i - 1) % len(corners)], s)
        return s

    def point(self, t: FloatArray) -> FloatArray:
        """Points (n, 2)."""
        return self.outline.point(self.own(t))

    def tangents(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unit tangents (n, 2) with which the loop arrives and leaves."""
        s = self.own(t)
        before, after = self.outline.tangent(s, from_left=True), self.outline.tangent(s)
        return (-after, -before) if self.reversed else (before, after)

    @property
    def corners(self) -> FloatArray:
        """Sorted arc lengths of the corners."""
        s = self.outline.corners[0]
        return np.sort(np.mod(-s, self.length) if self.reversed else s)


def directed_loops(outlines: Sequence[Outline]) -> list[DirectedLoop]:
    """The loops of an outline in the given order; the one of the largest area is the outer one."""
    outer = int(np.argmax([abs(outline.area) for outline in outlines]))
    return [DirectedLoop(outline, (outline.area > 0) != (k == outer)) for k, outline in enumerate(outlines)]
