"""The outline as polygons."""

from __future__ import annotations

from dataclasses import dataclass

from ...geometry.outline import Outline
from ...numeric.arrays import FloatArray, IntArray

__all__ = ["SampledOutline"]


@dataclass(frozen=True, eq=False)
class SampledOutline:
    """Closed polygons on the loops of an outline.

    Attributes
    ----------
    points : (n, 2) array
        Polygon nodes, loop by loop in the user's order, each loop with the domain on its left.
    loop : (n,) array of int
        Loop of every node.
    s : (n,) array
        Arc length of every node on the user's own outline of its loop.
    next : (n,) array of int
        The node that follows.
    corner_angle : (n,) array
        Interior angle at corners in radians, NaN elsewhere.
    step : float
        Largest wanted edge length.
    outlines : tuple of Outline
        The user's loops, in his order and sense.
    """

    points: FloatArray
    loop: IntArray
    s: FloatArray
    next: IntArray
    corner_angle: FloatArray
    step: float
    outlines: tuple[Outline, ...]
