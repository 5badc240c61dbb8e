"""Models of one layout beside each other where their iso-lines bend most across interfaces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Interface, Side
from ..measure.continuity import check_continuity
from ..numeric.arrays import FloatArray
from .drawing import FAINT, INK, draw_lines, new_figure, side_lines
from .palette import LIGHT
from .quantities import area_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Bend", "bends", "kinks"]

BEND = LIGHT.anchors[3]
#: Places on an interface that are compared. At its ends nothing is held straight: vertices may be extraordinary.
SAMPLES, ENDS = 31, 0.2
#: Half a window, of the length that a patch has in the mean.
WINDOW = 0.4
#: Windows are at least so many half windows apart.
APART = 1.5
#: Iso-lines of a patch and direction in a window, and points a line.
LINES, POINTS = 16, 97
#: Parts of half a window: a drawn tangent, and the angle's arc.
TANGENT, ARC = 0.72, 0.5


class Bend(NamedTuple):
    """How iso-lines cross an interface at a place: point, unit vectors into both patches, angle in degrees."""

    point: FloatArray
    into_a: FloatArray
    into_b: FloatArray
    angle: float


def bends(mp: MultiPatch, f: Interface, t: FloatArray) -> list[Bend]:
    """Bends at parameters `t`, 0 to 1 along side a of an interface; the angle is NaN where a derivative vanishes."""
    point, into_a = _across(mp, f.patch_a, f.side_a, t)
    _, into_b = _across(mp, f.patch_b, f.side_b, 1 - t if f.reversed else t)
    dot = -(into_a * into_b).sum(axis=1)
    cross = into_a[:, 0] * into_b[:, 1] - into_a[:, 1] * into_b[:, 0]
    angle = np.degrees(np.abs(np.arctan2(cross, dot)))
    return [Bend(*row) for row in zip(point, into_a, into_b, angle.tolist(), strict=True)]


def _across(mp: MultiPatch, patch: int, side: Side, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points of a side and unit vectors of the derivative into the patch."""
    shape = mp.patches[patch]
    along, across = shape.knots[side.axis], shape.knots[1 - side.axis]
    parameters = [along[0] + t * (along[-1] - along[0]), np.full_like(t, across[-1 if side.at_end else 0])]
    u, v = parameters[:: 1 if side.axis == 0 else -1]
    derivative = shape.jacobian(u, v)[..., 1 - side.axis] * (-1 if side.at_end else 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return shape(u, v), derivative / np.hypot(derivative[:, 0], derivative[:, 1])[:, None]


def kinks(models: Mapping[str, MultiPatch], places: int = 2) -> Figure:
    """Draw models of one layout beside each other, enlarged where iso-lines bend most across interfaces.

    Parameters
    ----------
    models : mapping of str to MultiPatch
        By title, such as the results of "c0", "c1" and "g1"; of the same patches and interfaces.
    places : int, default 2
        Rows of windows: where the first model bends most inside interfaces, at one interface each; fewer where these
        are close together.

    Returns
    -------
    matplotlib.figure.Figure
        At the left where the windows are; in each window the tangents of the iso-line on both sides of the interface,
        and the angle between them at this place in degrees. Titles have the mean and the largest kink of all
        interfaces.

    Raises
    ------
    InputError
        When there are no models, no interfaces, or the models' interfaces differ.

    Examples
    --------
    >>> from patchtransfer import examples
    >>> source, _, _ = examples.load("star")
    >>> figure = kinks({"as it is": source}, places=1)
    """
    shapes = list(models.values())
    if not shapes or not shapes[0].interfaces or any(mp.interfaces != shapes[0].interfaces for mp in shapes):
        raise InputError("kinks are compared of models with the same interfaces, and at least one of each")
    if places < 1:
        raise InputError(f"places = {places}: at least one is needed")
    half = WINDOW * float(np.sqrt(area_of(shapes[0]) / len(shapes[0])))
    chosen = _places(shapes, places, APART * half)
    size = 2.5
    figure = new_figure((size * (len(shapes) + 1.25) + 0.2, size * len(chosen) + 0.6))
    grid = figure.add_gridspec(len(chosen), len(shapes) + 1, width_ratios=[1.25] + [1.0] * len(shapes))
    overview = figure.add_subplot(grid[:, 0])
    _draw_overview(overview, shapes[0], [found[0].point for found in chosen], half)
    for row, found in enumerate(chosen):
        for column, (title, mp, bend) in enumerate(zip(models, shapes, found, strict=True)):
            ax = figure.add_subplot(grid[row, column + 1])
            _draw_window(ax, mp, bend, half)
            if row == 0:
                kink = check_continuity(mp).kink_deg
                ax.set_title(f"{title}: mean {kink.mean:.1f}°, most {kink.max:.1f}°", fontsize=9.5, color=INK)
            if column == 0:
                ax.set_ylabel(_letter(row), rotation=0, fontsize=11, fontweight="bold", color=INK, labelpad=10)
    return figure


def _places(shapes: list[MultiPatch], most: int, apart: float) -> list[list[Bend]]:
    """The bends of all models where the first one bends most, an interface each."""
    t = np.linspace(ENDS, 1 - ENDS, SAMPLES)
    found = []
    for f in shapes[0].interfaces:
        rows = list(zip(*(bends(mp, f, t) for mp in shapes), strict=True))
        angles = np.nan_to_num([row[0].angle for row in rows], nan=-1.0)
        at = int(angles.argmax())
        found.append((float(angles[at]), list(rows[at])))
    chosen: list[list[Bend]] = []
    for _, row in sorted(found, key=lambda pair: -pair[0]):
        if len(chosen) < most and all(np.hypot(*(row[0].point - other[0].point)) > apart for other in chosen):
            chosen.append(row)
    return chosen


def _letter(row: int) -> str:
    return chr(ord("A") + row)


def _draw_overview(ax: Axes, mp: MultiPatch, points: list[FloatArray], half: float) -> None:
    """Patches, and the windows with their letters."""
    from matplotlib.patches import Rectangle

    sides = [mp.topology.directed_side(f.patch_a, f.side_a).curve(mp.patches) for f in mp.interfaces]
    draw_lines(ax, [curve(np.linspace(*curve.domain, 40)) for curve in sides], FAINT, 0.8, 1)
    draw_lines(ax, side_lines(mp), INK, 1.2)
    for row, (x, y) in enumerate(points):
        ax.add_patch(Rectangle((x - half, y - half), 2 * half, 2 * half, fill=False, edgecolor=BEND, lw=1.3, zorder=5))
        ax.annotate(
            _letter(row),
            (x + half, y + half),
            (2, 1),
            textcoords="offset points",
            fontweight="bold",
            color=BEND,
            zorder=6,
        )
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.set_axis_off()


def _draw_window(ax: Axes, mp: MultiPatch, bend: Bend, half: float) -> None:
    """Iso-lines near a place, the tangents there and the angle between them."""
    from matplotlib.patches import Wedge

    low, high = bend.point - half, bend.point + half
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_aspect("equal")
    for patch in mp.patches:
        on = [(k[0] + np.linspace(0, 1, n) * (k[-1] - k[0])) for k in patch.knots for n in (LINES + 1, POINTS)]
        lines = [*patch.grid(on[0], on[3]), *patch.grid(on[1], on[2]).swapaxes(0, 1)]
        near = [bool(((line > low - half) & (line < high + half)).all(axis=1).any()) for line in lines]
        ends = {0, LINES, LINES + 1, 2 * LINES + 1}
        draw_lines(ax, [line for k, line in enumerate(lines) if near[k] and k not in ends], FAINT, 0.6, 1)
        draw_lines(ax, [line for k, line in enumerate(lines) if near[k] and k in ends], INK, 1.3, 2)
    if np.isfinite(bend.angle):
        reach, straight = TANGENT * half, -bend.into_a
        ax.plot(*np.array([bend.point + reach * bend.into_a, bend.point]).T, color=BEND, lw=2, zorder=4)
        ax.plot(*np.array([bend.point, bend.point + reach * bend.into_b]).T, color=BEND, lw=2, zorder=4)
        ax.plot(*np.array([bend.point, bend.point + reach * straight]).T, color=BEND, lw=1, ls=(0, (3, 3)), zorder=4)
        first, second = (float(np.degrees(np.arctan2(d[1], d[0]))) for d in (straight, bend.into_b))
        turn = (second - first + 180) % 360 - 180
        wedge = sorted((first, first + turn))
        ax.add_patch(Wedge(tuple(bend.point), ARC * half, *wedge, facecolor=BEND, alpha=0.3, lw=0, zorder=3))
    ax.text(
        0.03,
        0.03,
        f"{bend.angle:.1f}°" if np.isfinite(bend.angle) else "degenerate",
        transform=ax.transAxes,
        fontsize=11,
        fontweight="bold",
        color=BEND,
        zorder=6,
        bbox={"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": "none", "alpha": 0.85},
    )
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_color(FAINT)
