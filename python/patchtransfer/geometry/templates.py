"""Patches replaced by several of a fixed pattern, after templates of quadrilateral meshing.

A template is drawn in the unit square, the patch's own parameters; its quadrilaterals become patches. Where its edges
are parameter lines of the patch they stay what they are. Other edges, and what is between, are interpolated at Greville
points: the map from a quadrilateral to its patch is not affine there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..numeric import dense
from ..numeric.arrays import FloatArray
from .basis import collocation_matrix, greville
from .conformity.overlaps import missing_knots
from .curve import BSplineCurve
from .patch import Patch
from .sides import Interface, Side

__all__ = ["Filling", "Template", "filled_in"]

#: Ends of a quadrilateral's sides, among its corners (0, 0), (1, 0), (1, 1), (0, 1).
ENDS = {Side.SOUTH: (0, 1), Side.NORTH: (3, 2), Side.WEST: (0, 3), Side.EAST: (1, 2)}
#: Where the unit square's sides are: axis across, and value there.
PLACES = {Side.WEST: (0, 0.0), Side.EAST: (0, 1.0), Side.SOUTH: (1, 0.0), Side.NORTH: (1, 1.0)}


@dataclass(frozen=True)
class Template:
    """Quadrilaterals that fill the unit square.

    Attributes
    ----------
    quads : tuple of quadruples of (x, y)
        Corners at parameters (0, 0), (1, 0), (1, 1), (0, 1) of each; on the square's sides their directions are the
        square's.
    """

    quads: tuple[tuple[tuple[float, float], ...], ...]

    def flipped(self, x: bool, y: bool) -> Template:
        """The mirror image in either direction, or both."""

        def moved(quad: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
            quad = [(1 - a if x else a, 1 - b if y else b) for a, b in quad]
            order = [1, 0, 3, 2] if x else [0, 1, 2, 3]
            if y:
                order = [order[3 - i] for i in range(4)]
            return tuple(quad[i] for i in order)

        return Template(tuple(map(moved, self.quads)))

    def swapped(self) -> Template:
        """With x and y swapped."""
        return Template(tuple(tuple((quad[i][1], quad[i][0]) for i in (0, 3, 2, 1)) for quad in self.quads))

    def on(self, side: Side) -> list[tuple[int, float, float]]:
        """Quadrilaterals on a side of the square, and where they begin and end, in order along it."""
        axis, value = PLACES[side]
        found = []
        for i, quad in enumerate(self.quads):
            a, b = (quad[j] for j in ENDS[side])
            if a[axis] == b[axis] == value:
                found.append((i, a[1 - axis], b[1 - axis]))
        return sorted(found, key=lambda part: part[1])

    def cuts(self, side: Side) -> list[float]:
        """Where a side of the square is cut."""
        return [end for _, _, end in self.on(side)[:-1]]


class Filling(NamedTuple):
    """Patches of a template.

    Attributes
    ----------
    patches : list of Patch
    interfaces : list of Interface
        Between them.
    ranges : list of pairs of ranges
        Smallest ranges of x and y that each lies in.
    """

    patches: list[Patch]
    interfaces: list[Interface]
    ranges: list[tuple[tuple[float, float], tuple[float, float]]]


def filled_in(patch: Patch, template: Template) -> Filling:
    """The patches that a template makes of a polynomial one, all on [0, 1]², with common knots where they meet."""
    sides = {(i, side): (quad[a], quad[b]) for i, quad in enumerate(template.quads) for side, (a, b) in ENDS.items()}
    meeting: dict[frozenset[tuple[float, float]], list[tuple[int, Side]]] = {}
    for at, ends in sides.items():
        meeting.setdefault(frozenset(ends), []).append(at)
    interfaces = [
        Interface(*pair[0], *pair[1], sides[pair[0]] != sides[pair[1]]) for pair in meeting.values() if len(pair) == 2
    ]
    splines = _splines(patch, len(template.quads), sides, interfaces)
    patches = []
    for i, quad in enumerate(template.quads):
        (ku, p), (kv, q) = splines[i, 0], splines[i, 1]
        points = _interpolated(patch, np.array(quad), (ku, kv), (p, q))
        for side in Side:
            exact = _line(patch, *sides[i, side])
            if exact is not None:
                _put(points, side, exact, *splines[i, side.axis])
        patches.append(Patch((ku, kv), (p, q), points))
    ranges = []
    for quad in template.quads:
        (x0, y0), (x1, y1) = np.min(quad, axis=0).tolist(), np.max(quad, axis=0).tolist()
        ranges.append(((x0, x1), (y0, y1)))
    return Filling(patches, interfaces, ranges)


Spline = tuple[FloatArray, int]


def _splines(
    patch: Patch,
    count: int,
    sides: dict[tuple[int, Side], tuple[tuple[float, float], tuple[float, float]]],
    interfaces: Sequence[Interface],
) -> dict[tuple[int, int], Spline]:
    """Knots on [0, 1] and degree of every quadrilateral's directions: what all edges of their strip need."""
    found: dict[tuple[int, int], Spline] = {}
    for i in range(count):
        for axis in (0, 1):
            along = [_needed(patch, *sides[i, side]) for side in Side if side.axis == axis]
            found[i, axis] = _common(along)
    # Strips inside a template are short: as often as there are quadrilaterals is enough.
    for _ in range(count):
        for f in interfaces:
            a, b = (f.patch_a, f.side_a.axis), (f.patch_b, f.side_b.axis)
            found[a] = _common([found[a], _turned(found[b], f.reversed)])
            found[b] = _turned(found[a], f.reversed)
    return found


def _needed(patch: Patch, start: tuple[float, float], end: tuple[float, float]) -> Spline:
    """A spline space that suits the patch along a line: knots of both directions where it is not parallel to one."""
    parts = []
    for axis in (0, 1):
        low, high = start[axis], end[axis]
        if low != high:
            knots, p = _unit(patch.knots[axis]), patch.degrees[axis]
            inner = (knots[(knots > min(low, high)) & (knots < max(low, high))] - low) / (high - low)
            parts.append((np.concatenate([np.zeros(p + 1), np.sort(inner), np.ones(p + 1)]), p))
    return _common(parts)


def _unit(knots: FloatArray) -> FloatArray:
    moved = (knots - knots[0]) / (knots[-1] - knots[0])
    return np.asarray(np.where(knots == knots[-1], 1.0, moved))


def _turned(spline: Spline, reversed_: bool) -> Spline:
    return (np.asarray(1.0 - spline[0][::-1]), spline[1]) if reversed_ else spline


def _common(splines: Sequence[Spline]) -> Spline:
    """The smallest space that has all of these."""
    degree = max(p for _, p in splines)
    common = np.repeat([0.0, 1.0], degree + 1)
    for knots, p in splines:
        values, counts = np.unique(knots, return_counts=True)
        raised = np.repeat(values, counts + (degree - p))
        common = np.sort(np.concatenate([common, missing_knots(common, raised, degree)]))
    return common, degree


def _interpolated(
    patch: Patch, quad: FloatArray, knots: tuple[FloatArray, FloatArray], degrees: tuple[int, int]
) -> FloatArray:
    """Control points of the patch on a quadrilateral of its unit square."""
    s, t = (greville(k, p) for k, p in zip(knots, degrees, strict=True))
    a, b, c, d = quad
    s_, t_ = s[:, None, None], t[None, :, None]
    at = np.clip((1 - s_) * (1 - t_) * a + s_ * (1 - t_) * b + s_ * t_ * c + (1 - s_) * t_ * d, 0.0, 1.0)
    (u0, u1), (v0, v1) = patch.domain
    values = patch(np.clip(u0 + (u1 - u0) * at[..., 0], u0, u1), np.clip(v0 + (v1 - v0) * at[..., 1], v0, v1))
    m, n = len(s), len(t)
    rows = dense.solve(collocation_matrix(knots[0], degrees[0], s), values.reshape(m, -1)).reshape(m, n, 2)
    columns = rows.transpose(1, 0, 2).reshape(n, -1)
    solved = dense.solve(collocation_matrix(knots[1], degrees[1], t), columns)
    return np.array(solved.reshape(n, m, 2).transpose(1, 0, 2))


def _line(patch: Patch, start: tuple[float, float], end: tuple[float, float]) -> BSplineCurve | None:
    """The patch on one of its sides, or a part of it; None elsewhere."""
    for side, (axis, value) in PLACES.items():
        if start[axis] == end[axis] == value:
            own = patch.knots[1 - axis]
            curve = BSplineCurve(own, patch.degrees[1 - axis], side.of(patch.control_points))
            low, high = (float(own[0] + x * (own[-1] - own[0])) for x in (start[1 - axis], end[1 - axis]))
            ends = (float(own[0]) if start[1 - axis] == 0 else low, float(own[-1]) if end[1 - axis] == 1 else high)
            return curve.restrict(*ends)
    return None


def _put(points: FloatArray, side: Side, curve: BSplineCurve, knots: FloatArray, degree: int) -> None:
    """Control points of a side on a finer space put into those of a patch."""
    raised = curve.elevate(degree - curve.degree) if degree > curve.degree else curve
    a, b = raised.domain
    wanted = a + knots * (b - a)
    row = raised.insert_knots(missing_knots(raised.knots, wanted, degree)).control_points
    side.of(points)[:] = row
