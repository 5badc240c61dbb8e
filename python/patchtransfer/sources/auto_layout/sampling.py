"""The outline as polygons, fine enough to carry a cross field.

Corners and kinks are nodes. Along the smooth pieces between them nodes are spread evenly in ds / h + |dθ| / 8°: they
are at most h apart, and the outline turns by at most 8° from one to the next.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...geometry.boundary import Boundary
from ...geometry.outline import CORNER, Outline
from ...numeric.arrays import FloatArray, IntArray
from .reasons import NoLayoutError

__all__ = ["SampledOutline", "sample_outline"]

#: Triangles that a domain without small features gets: enough for every figure tried, and a tenth of a second.
TRIANGLES = 5000
#: Fewest steps around all loops: long thin domains have little area and much outline.
STEPS = 200
#: Turn of the outline from node to node in radians: crosses are exact at 0°, ambiguous at 45°.
TURN = np.radians(8.0)
#: Joints that turn by more (radians) are nodes, and so that the polygon is no coarser there than elsewhere.
KINK = np.radians(1.0)
#: Fewest steps of a piece for each corner at its ends, that the fans of triangles at two corners do not touch.
CORNER_STEPS = 2
#: Halvings of a table's interval, an eighth of a step, until the outline turns little in it: enough for roundings of a
#: thousandth of a step. Smaller ones would cost more triangles than they are worth.
HALVINGS = 9
#: Interior angles are kept this far (radians) from 0 and 360°, where there is no room for a spoke.
CUSP = 1e-3


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

    def loop_nodes(self) -> Iterator[IntArray]:
        """Nodes of every loop, in order."""
        for k in range(len(self.outlines)):
            yield np.flatnonzero(self.loop == k)


def sample_outline(boundary: Boundary, triangles: int = TRIANGLES) -> SampledOutline:
    """Sample all loops of a boundary.

    Parameters
    ----------
    boundary : Boundary
        One outer loop and holes in any order and sense; the loop of the largest area is the outer one.
    triangles : int
        About as many equilateral triangles of the step's size fill the domain; it gets more where it is narrow.

    Returns
    -------
    SampledOutline

    Raises
    ------
    NoLayoutError
        When the holes are as large as what contains them.
    """
    outlines = tuple(Outline(loop) for loop in boundary.loops)
    areas = np.array([outline.area for outline in outlines])
    outer = int(np.argmax(abs(areas)))
    area = 2 * abs(areas[outer]) - abs(areas).sum()
    if not area > 0:
        raise NoLayoutError("sampling", f"the holes leave no area: {area:.6g} of {abs(areas[outer]):.6g} are left")
    length = sum(outline.length for outline in outlines)
    # Equilateral triangles of side h have the area √3/4 h².
    step = float(min(np.sqrt(4 / np.sqrt(3) * area / triangles), length / STEPS))
    parts = [_sample_loop(outline, step, bool((areas[k] > 0) != (k == outer))) for k, outline in enumerate(outlines)]
    counts = [len(s) for s, _ in parts]
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    arrays = SampledOutline(
        points=np.concatenate([outline.point(s) for outline, (s, _) in zip(outlines, parts, strict=True)]),
        loop=np.repeat(np.arange(len(parts)), counts),
        s=np.concatenate([s for s, _ in parts]),
        next=np.concatenate([a + np.roll(np.arange(n), -1) for a, n in zip(starts, counts, strict=True)]),
        corner_angle=np.concatenate([angle for _, angle in parts]),
        step=step,
        outlines=outlines,
    )
    for array in (arrays.points, arrays.loop, arrays.s, arrays.next, arrays.corner_angle):
        array.flags.writeable = False
    return arrays


def _sample_loop(outline: Outline, step: float, reverse: bool) -> tuple[FloatArray, FloatArray]:
    """Arc lengths and interior angles at corners (NaN elsewhere), in the order with the domain on the left."""
    breaks = outline.piece_breaks
    turns = outline.turn(breaks)
    kinked = abs(turns) > KINK
    breaks, turns = (breaks[kinked], turns[kinked]) if kinked.any() else (np.zeros(1), np.zeros(1))
    corner = abs(turns) > CORNER
    ends = np.append(breaks[1:], breaks[0] + outline.length)
    # A piece's end is a joint by its own arc length only: the sum with the length is rounded, perhaps beyond it.
    arrivals = outline.tangent(np.roll(breaks, -1), from_left=True)
    fewest = np.maximum(1, CORNER_STEPS * (corner.astype(int) + np.roll(corner, -1)))
    pieces = [_sample_piece(outline, *p, step) for p in zip(breaks, ends, arrivals, fewest.tolist(), strict=True)]
    s = np.mod(np.concatenate(pieces), outline.length)
    first = np.concatenate([[0], np.cumsum([len(piece) for piece in pieces])[:-1]])
    s[first] = breaks
    angle = np.full(len(s), np.nan)
    inner = np.clip(np.pi + turns if reverse else np.pi - turns, CUSP, 2 * np.pi - CUSP)
    angle[first[corner]] = inner[corner]
    return (s[::-1].copy(), angle[::-1].copy()) if reverse else (s, angle)


def _sample_piece(outline: Outline, a: float, b: float, arrival: FloatArray, fewest: int, step: float) -> FloatArray:
    """Nodes of the piece from arc length a to b, where it arrives with a given tangent; without its end."""

    def turns() -> FloatArray:
        before, after = outline.tangent(table[:-1]), outline.tangent(table[1:], from_left=True)
        after[-1] = arrival
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        return abs(np.arctan2(cross, (before * after).sum(axis=1)))

    table = np.linspace(a, b, max(16, int(8 * (b - a) / step)) + 1)
    for _ in range(HALVINGS):
        sharp = turns() > TURN / 4
        if not sharp.any():
            break
        table = np.sort(np.concatenate([table, (table[:-1] + table[1:])[sharp] / 2]))
    density = np.concatenate([[0], np.cumsum(np.diff(table) / step + turns() / TURN)])
    steps = max(fewest, int(np.ceil(density[-1] - 1e-9)))
    return np.interp(np.linspace(0, density[-1], steps + 1), density, table)[:-1]
