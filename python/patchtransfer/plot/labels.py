"""Where labels stand: beside what they name, and on nothing else.

Each label has places to choose from, with what they cost. One after the other takes the cheapest; lines, points and
earlier labels under it cost more than being far away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Place", "around", "inside", "number_patches", "number_points", "placed", "points_per_unit"]

#: Size of a digit, of the font's size.
DIGIT = (0.64, 0.9)
#: Costs: of a label under a label, of a marked point, of a point of a line; of turning by a right angle.
LABEL, DOT, LINE, TURN = 100.0, 20.0, 3.0, 1.0
#: Distances in points and turns from the wanted direction that are tried.
DISTANCES, TURNS = (9.0, 13.0, 19.0, 27.0), np.radians([0, 25, -25, 50, -50, 80, -80, 120, -120, 180])
#: From here on a line leads to what a label names.
LEADER = 12.0
#: Parameters inside a patch, of 0 to 1, at which its number may stand.
GRID = np.linspace(0.2, 0.8, 7)


class Place(NamedTuple):
    """Places (k, 2) that a label may take, in points, and what they cost (k,)."""

    at: FloatArray
    cost: FloatArray


def placed(places: Sequence[Place], sizes: FloatArray, dots: FloatArray, lines: FloatArray) -> list[int]:
    """Which of its places each label takes.

    Parameters
    ----------
    places : sequence of Place
    sizes : (n, 2) array
        Widths and heights of the labels.
    dots, lines : (m, 2) arrays
        Marked points, and points of lines, that labels should not cover.
    """
    taken: list[tuple[FloatArray, FloatArray]] = []
    chosen = []
    for place, size in zip(places, sizes, strict=True):
        cost = place.cost.copy()
        for points, price in ((dots, DOT), (lines, LINE)):
            away = np.abs(points[None] - place.at[:, None])
            cost += price * (away <= size / 2 + 1).all(axis=2).sum(axis=1)
        for at, other in taken:
            cost += LABEL * (np.abs(place.at - at) < (size + other) / 2).all(axis=1)
        best = int(cost.argmin())
        chosen.append(best)
        taken.append((place.at[best], size))
    return chosen


def around(point: FloatArray, direction: FloatArray) -> Place:
    """Places about a point, the best in a direction."""
    angle = np.arctan2(direction[1], direction[0]) + TURNS
    rays = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    far = np.array(DISTANCES)
    at = point + far[:, None, None] * rays
    cost = (far - far[0])[:, None] / far[0] + TURN * np.abs(TURNS) / (np.pi / 2)
    return Place(at.reshape(-1, 2), cost.ravel())


def inside(mp: MultiPatch) -> list[FloatArray]:
    """Places (k, 2) inside each patch, the middle first."""
    order = np.argsort(np.hypot(*np.meshgrid(GRID - 0.5, GRID - 0.5, indexing="ij")).ravel(), kind="stable")
    found = []
    for patch in mp.patches:
        u, v = (knots[0] + GRID * (knots[-1] - knots[0]) for knots in patch.knots)
        found.append(patch.grid(u, v).reshape(-1, 2)[order])
    return found


def points_per_unit(ax: Axes) -> float:
    """Points of a picture for a unit of length, as its axes are now."""
    box = ax.get_position()
    width, height = cast("Figure", ax.figure).get_size_inches().tolist()
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    return float(72 * min(box.width * width / abs(right - left), box.height * height / abs(high - low)))


def extent(text: str, size: float) -> tuple[float, float]:
    """Width and height of a short label in points."""
    return DIGIT[0] * size * len(text), DIGIT[1] * size


def number_patches(ax: Axes, mp: MultiPatch, outlines: Sequence[FloatArray], size: float = 8.0) -> None:
    """Write the patches' numbers, from 0, inside them and beside lines of `outlines` and extraordinary vertices."""
    unit = points_per_unit(ax)
    places = [Place(at * unit, np.linspace(0, 1, len(at))) for at in inside(mp)]
    texts = [str(k) for k in range(len(mp))]
    special = mp.topology.coordinates[[v.point for v in mp.vertices if v.extraordinary]].reshape(-1, 2)
    chosen = placed(
        places, np.array([extent(text, size) for text in texts]), special * unit, np.concatenate(outlines) * unit
    )
    for text, place, k in zip(texts, places, chosen, strict=True):
        x, y = (place.at[k] / unit).tolist()
        ax.text(
            x,
            y,
            text,
            ha="center",
            va="center",
            fontsize=size,
            zorder=8,
            bbox={"boxstyle": "round,pad=0.12", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )


def number_points(
    ax: Axes,
    numbers: Sequence[int],
    points: FloatArray,
    outwards: FloatArray,
    colors: FloatArray,
    dots: FloatArray,
    lines: FloatArray,
    size: float = 7.5,
) -> None:
    """Write numbers beside points, in a direction of their own where there is room.

    Parameters
    ----------
    ax : Axes
    numbers : sequence of int
    points, outwards : (n, 2) arrays
    colors : (n, 4) array
    dots, lines : (m, 2) arrays
        What should not be covered, as in `placed`.
    size : float
        Of the font, in points.
    """
    unit = points_per_unit(ax)
    texts = [str(number) for number in numbers]
    places = [around(point * unit, direction) for point, direction in zip(points, outwards, strict=True)]
    chosen = placed(places, np.array([extent(text, size) for text in texts]), dots * unit, lines * unit)
    for text, point, place, k, color in zip(texts, points, places, chosen, colors, strict=True):
        offset = place.at[k] - point * unit
        dark = color * [0.68, 0.68, 0.68, 1.0]
        leader = {"arrowstyle": "-", "lw": 0.5, "color": dark, "shrinkA": 0.5, "shrinkB": 3}
        ax.annotate(
            text,
            point,
            offset.tolist(),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=size,
            color=dark,
            zorder=6,
            arrowprops=leader if np.hypot(*offset) > LEADER else None,
        )
