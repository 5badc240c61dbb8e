"""What it costs to collapse an arc: the one knob between few patches and patches of quality."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ...numeric.arrays import FloatArray
from .sampling import SampledOutline
from .t_mesh import TMesh
from .walks import Walks

__all__ = ["FEW", "QUALITY", "CollapsePrice", "arc_prices", "collapse_prices", "edge_prices", "shear_tangents"]

#: Prices are multiples of this part of an edge's: rounding noise in the arcs' lengths does not change them.
GRID = 1024
#: Weight of the canonical preference among layouts of equal price, in edges a unit of length of the program. A
#: hundred edges of the longest preference differ by less than the price of a patch.
PREFERENCE = 4e-4
#: Levels of that preference: differences above the solver's tolerance, and noise below a level.
LEVELS = 100
#: Shears beyond this tangent (63 degrees) all cost the same: they are forbidden by the steepest angle if at all.
LARGEST_TANGENT = 2.0


@dataclass(frozen=True)
class CollapsePrice:
    """Price of collapsing an arc, in edges of the layout.

    A collapse moves what was apart by the arc's length onto one line. Its price is the arc's length in units of
    ``size``, plus ``shear`` times the tangent of the angle by which the line between the critical points that come
    onto one line is turned.

    Attributes
    ----------
    size : float
        Length whose collapse costs as much as one edge, in units of the square root of the area.
    shear : float, default 0
        Price of a shear of 45 degrees.
    steepest : float, default 40
        Critical points come onto one line under a larger angle (degrees) only where nothing else is left; 90 allows
        all.
    turn : float, default 110
        Most that the outline turns along one edge of the layout (degrees).
    """

    size: float
    shear: float = 0.0
    steepest: float = 40.0
    turn: float = 110.0

    def __post_init__(self) -> None:
        if not (
            0 < self.size < np.inf and 0 <= self.shear < np.inf and 0 < self.steepest <= 90 and 0 < self.turn <= 180
        ):
            raise InputError(
                f"collapse prices need size > 0, shear >= 0, 0 < steepest <= 90 and 0 < turn <= 180, got {self}"
            )


#: Coarse first. The coarsest allow steep collapses: few patches are often the better ones after sliding all the same.
#: The first goes round the end of an oval three times as long as wide in one edge, and round a ring that is open by a
#: fifth in three.
FEW = (
    CollapsePrice(1 / 3, steepest=90.0, turn=142.0),
    CollapsePrice(1 / 3, steepest=90.0),
    CollapsePrice(1 / 6, steepest=90.0),
    CollapsePrice(1 / 12),
)
#: What is apart stays apart rather, and where it does not, lines turn little.
QUALITY = (
    CollapsePrice(1 / 6, 1.0),
    CollapsePrice(1 / 12, 2.0),
    CollapsePrice(1 / 24, 4.0),
    CollapsePrice(1 / 48, 8.0),
)


def collapse_prices(prefer: str) -> tuple[CollapsePrice, ...]:
    """The family of prices to try, for ``"few"`` patches or for ``"quality"``.

    Raises
    ------
    InputError
        On any other word.
    """
    families = {"few": FEW, "quality": QUALITY}
    if prefer not in families:
        raise InputError(f'prefer must be "few" or "quality", got {prefer!r}')
    return families[prefer]


def outline_area(outline: SampledOutline) -> float:
    """Area inside the polygons."""
    a, b = outline.points, outline.points[outline.next]
    # About a point nearby: far from the origin the products cancel.
    a, b = a - outline.points[0], b - outline.points[0]
    return float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) / 2


def arc_prices(t_mesh: TMesh, outline: SampledOutline, price: CollapsePrice) -> FloatArray:
    """Price of collapsing every arc (a,), in edges, on a grid."""
    sizes = t_mesh.arc_size / (price.size * np.sqrt(outline_area(outline)))
    prices = sizes + price.shear * shear_tangents(t_mesh) if price.shear else sizes
    return np.asarray(np.round(GRID * prices) / GRID)


def edge_prices(t_mesh: TMesh, outline: SampledOutline) -> FloatArray:
    """Price of one edge on every arc (a,): 1, and a trace more that decides between layouts of equal price.

    The trace depends on how short an arc is and how far from the middle, which rotations, mirrorings and other starts
    of the loops leave alone, and last on its number, for arcs that are each other's image under a symmetry.
    """
    polygon = outline.points
    middle = (polygon.min(axis=0) + polygon.max(axis=0)) / 2
    edges = np.linalg.norm(polygon[outline.next] - polygon, axis=1)
    centroid = middle + (edges[:, None] * (polygon + polygon[outline.next] - 2 * middle)).sum(axis=0) / (
        2 * edges.sum()
    )
    halfway = np.array([_halfway(points) for points in t_mesh.arc_points])
    away = np.linalg.norm(halfway - centroid, axis=1) / np.linalg.norm(polygon - centroid, axis=1).max()
    short = 1 - t_mesh.arc_size / t_mesh.arc_size.max()
    levels = np.round(LEVELS * (0.75 * short + 0.25 * away)) / LEVELS
    ranks = np.arange(len(levels)) / (4 * LEVELS * len(levels))
    return np.asarray(1 + PREFERENCE * (levels + ranks))


def _halfway(points: FloatArray) -> FloatArray:
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    return np.array([np.interp(along[-1] / 2, along, points[:, i]) for i in (0, 1)])


def shear_tangents(t_mesh: TMesh) -> FloatArray:
    """Tangent of the angle (a,) by which collapsing an arc turns the line between critical points.

    The lines that cross the arc's ends become one. On either, the nearest critical points to both sides are looked
    for; the two that come nearest to each other have the steepest line between them. Zero where there are none, and
    between two critical points, which the rules of merging judge.
    """
    walks = Walks(t_mesh)
    out = np.zeros(len(t_mesh.arc_nodes))
    for arc, length in enumerate(walks.length):
        ends = (2 * arc, 2 * arc + 1)
        if length == 0 or all(walks.critical[walks.origin[half]] for half in ends):
            continue
        # Left of the arc is right of the same arc backwards.
        near, far = (_criticals_across(walks, half) for half in ends)
        apart = min((abs(a + b) for a in near for b in far), default=np.inf)
        out[arc] = min(length / apart, LARGEST_TANGENT) if apart > 0 else LARGEST_TANGENT
    return out


def _criticals_across(walks: Walks, half: int) -> list[float]:
    """Signed distances of the nearest critical points on the line that crosses a half-arc at its origin."""
    if walks.critical[walks.origin[half]]:
        return [0.0]
    found = []
    for left in (True, False):
        along, distance = walks.beside(half, left), 0.0
        # A line passes an arc once in either sense.
        for _ in range(len(walks.origin)):
            if along is None:
                break
            distance += walks.length[along // 2]
            if walks.critical[walks.target(along)]:
                found.append(distance if left else -distance)
                break
            along = walks.straight(along)
    return found
