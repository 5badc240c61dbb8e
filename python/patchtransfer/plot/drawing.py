"""What pictures are made of: multi-patches by layers, boundaries, colour bars and legends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..errors import InputError
from ..geometry.basis import knot_spans
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.multipatch import MultiPatch
from ..libraries import library
from ..numeric.arrays import FloatArray
from .labels import number_patches, points_per_unit
from .palette import LIGHT, colours_of_patches
from .quantities import QUANTITIES, Quantity, check_color, values_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable

    from .picture import Picture

__all__ = [
    "FAINT",
    "GREY",
    "INK",
    "boundary_lines",
    "closed_loops",
    "color_bar",
    "covered_by",
    "draw_boundary",
    "draw_lines",
    "draw_multipatch",
    "extraordinary_legend",
    "figure_of",
    "finish",
    "legend",
    "need_matplotlib",
    "new_axes",
    "new_figure",
    "panels",
    "side_lines",
]

INK, GREY, FAINT, NET = "#1b1b1b", "#6b6b6b", "#9aa2ad", "#7a3b0c"
#: Iso-lines about a patch and direction, and points a line at least.
LINES, POINTS = 8, 32
#: Widths of iso-lines, of interfaces in colour and in ink, in points.
THIN, THICK, INNER = 0.7, 1.5, 1.0
#: Of a legend's row in points: height, and width beside the text and a letter's.
ROW, HANDLE, LETTER = 15.0, 36.0, 5.4
_EXTRAORDINARY: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 5.5,
    "markerfacecolor": "white",
    "markeredgecolor": INK,
    "markeredgewidth": 1.1,
}


def need_matplotlib(user: str) -> None:
    """Raise `InputError` with what to install where `user` cannot draw."""
    library("matplotlib", "plot", user)


def new_figure(size: tuple[float, float]) -> Picture:
    """An empty figure of this size in inches, made without pyplot; all drawing begins with one.

    Raises
    ------
    InputError
        Without matplotlib.
    """
    need_matplotlib("drawing")
    from .picture import Picture

    return Picture(figsize=size, layout="constrained")


def new_axes(outline: FloatArray) -> Axes:
    """Axes of a new figure, of the shape of an outline."""
    width, height = np.ptp(outline, axis=0).tolist()
    longest = max(width, height) or 1.0
    size = (max(3.2, 6.4 * width / longest) + 1.4, max(2.8, 6.4 * height / longest) + 0.6)
    return new_figure(size).subplots()


def panels(outlines: list[FloatArray], extra: float) -> tuple[Picture, list[Axes]]:
    """Make a row of equal panels, each framing its outline, all drawn about equally large."""
    sizes = [np.ptp(outline, axis=0) for outline in outlines]
    diagonals = [float(np.hypot(*size)) or 1.0 for size in sizes]
    # One window for all in units of the diagonals: panels of one shape, titles at one height.
    window = 1.06 * np.max([size / d for size, d in zip(sizes, diagonals, strict=True)], axis=0)
    width, height = min(4.3 / window[0], 5.6 / window[1]) * window
    figure = new_figure((float(width) * len(outlines) + extra, float(height) + 0.9))
    axes = list(figure.subplots(1, len(outlines), squeeze=False)[0])
    for ax, outline, diagonal in zip(axes, outlines, diagonals, strict=True):
        middle, half = (outline.min(axis=0) + outline.max(axis=0)) / 2, diagonal * window / 2
        ax.set_xlim(middle[0] - half[0], middle[0] + half[0])
        ax.set_ylim(middle[1] - half[1], middle[1] + half[1])
    return figure, axes


def boundary_lines(curve: BSplineCurve, per_span: int = 24) -> FloatArray:
    """A curve sampled span by span."""
    breaks = knot_spans(curve.knots)
    return curve(np.unique(np.linspace(breaks[:-1], breaks[1:], per_span + 1)))


def closed_loops(loops: Boundary) -> list[FloatArray]:
    """Sample closed loops as polylines, the first point not repeated."""
    return [np.concatenate([boundary_lines(curve)[:-1] for curve in loop]) for loop in loops.loops]


def side_lines(mp: MultiPatch) -> list[FloatArray]:
    """Sample boundary sides one by one: a model whose boundary does not close can be looked at too."""
    return [boundary_lines(mp.topology.directed_side(*side).curve(mp.patches)) for side in mp.boundaries]


def draw_multipatch(
    ax: Axes,
    mp: MultiPatch,
    iso_lines: int | None = None,
    *,
    color: str | None = "scaled_jacobian",
    source: MultiPatch | None = None,
    ids: bool = False,
    control_net: bool = False,
) -> ScalarMappable | None:
    """Draw a multi-patch with its layers; parameters as of `plot.multipatch`.

    Returns
    -------
    ScalarMappable or None
        What a colour bar shows, if lines have colours.
    """
    check_color(color, source)
    if iso_lines is not None and iso_lines < 1:
        raise InputError(f"iso_lines = {iso_lines}: at least 1 interval per knot span is needed")
    spans = max(len(knot_spans(knots)) - 1 for patch in mp.patches for knots in patch.knots)
    intervals = max(1, round(LINES / spans)) if iso_lines is None else iso_lines
    between = max(2, -(-POINTS // (intervals * spans)))
    samples = intervals * between + 1
    quantity = QUANTITIES.get(color or "")
    grids = values_of(color if color is not None and quantity is not None else "scaled_jacobian", mp, samples, source)
    if color == "patch":
        _fill_patches(ax, mp, [points for points, _ in grids])
    worse = np.minimum if quantity is None else quantity.worse
    thin: list[tuple[FloatArray, FloatArray]] = []
    thick: list[tuple[FloatArray, FloatArray]] = []
    for points, values in grids:
        for p, s in ((points, values), (points.swapaxes(0, 1), values.T)):
            # The line at a break was sampled from both spans: drawn once, in the worse colour.
            s = s.copy()
            s[samples - 1 : -1 : samples] = _worse_of(worse, s[samples - 1 : -1 : samples], s[samples::samples])
            grid = np.arange(len(p)).reshape(-1, samples)[:, ::between]
            rows = np.append(grid[0, 0], grid[:, 1:])
            thin.append((p[rows[1:-1]], s[rows[1:-1]]))
            thick.append((p[rows[[0, -1]]], s[rows[[0, -1]]]))
    mappable = None
    if quantity is None:
        draw_lines(ax, [line for p, _ in thin for line in p], FAINT, THIN, 1)
        draw_lines(ax, [line for p, _ in thick for line in p], INK, INNER, 2)
    else:
        for lines, width, order in ((thin, THIN, 1), (thick, THICK, 2)):
            mappable = _draw_coloured(ax, quantity, lines, width, order)
    draw_lines(ax, side_lines(mp))
    if control_net:
        _draw_net(ax, mp)
    special = [v.point for v in mp.vertices if v.extraordinary]
    if special:
        ax.plot(*mp.topology.coordinates[special].T, **_EXTRAORDINARY, zorder=6)
    if ids:
        _frame(ax)
        number_patches(ax, mp, [line for p, _ in thick for line in p])
    return mappable


def _worse_of(worse: np.ufunc, a: FloatArray, b: FloatArray) -> FloatArray:
    """The worse of values; where one of them is folded, that one."""
    return np.asarray(np.where((a <= 0) | (b <= 0), np.minimum(a, b), worse(a, b)))


def _draw_coloured(
    ax: Axes, quantity: Quantity, lines: list[tuple[FloatArray, FloatArray]], width: float, order: int
) -> ScalarMappable:
    """Lines as pieces of one colour each."""
    from matplotlib.collections import LineCollection

    pieces: list[FloatArray] = []
    values: list[FloatArray] = []
    for points, at in lines:
        # Of segments, by their ends.
        worst = _worse_of(quantity.worse, at[:, :-1], at[:, 1:])
        for line, levels, value in zip(points, quantity.level_of(worst), worst, strict=True):
            starts = np.flatnonzero(np.diff(levels, prepend=levels[0] - 1))
            pieces += [line[i : j + 1] for i, j in zip(starts, [*starts[1:], len(levels)], strict=True)]
            values.append(quantity.worse.reduceat(value, starts))
    colormap, norm = quantity.scale()
    collection = LineCollection(
        pieces,
        array=np.concatenate(values),
        cmap=colormap,
        norm=norm,
        linewidths=width,
        capstyle="round",
        joinstyle="round",
        zorder=order,
    )
    ax.add_collection(collection)
    return collection


def _fill_patches(ax: Axes, mp: MultiPatch, grids: list[FloatArray]) -> None:
    from matplotlib.collections import PolyCollection

    around = [np.concatenate([g[:, 0], g[-1], g[::-1, -1], g[0, ::-1]]) for g in grids]
    numbers = colours_of_patches(len(mp), [(f.patch_a, f.patch_b) for f in mp.interfaces])
    ax.add_collection(
        PolyCollection(around, facecolors=[LIGHT.patches[k] for k in numbers], edgecolors="none", zorder=0)
    )


def _draw_net(ax: Axes, mp: MultiPatch) -> None:
    """Control polygons and points, over the lines."""
    nets = [line for patch in mp.patches for net in (patch.control_points,) for line in (*net, *net.swapaxes(0, 1))]
    draw_lines(ax, nets, NET, 0.5, 4)
    ax.plot(*mp.topology.coordinates.T, linestyle="none", marker="s", markersize=1.7, color=NET, zorder=5)
    ax.autoscale_view()


def draw_boundary(ax: Axes, boundary: Boundary, color: str = INK, width: float = 1.6, dots: bool = True) -> None:
    """Loops as lines, the ends of their curves as dots."""
    draw_lines(ax, [np.concatenate([line, line[:1]]) for line in closed_loops(boundary)], color, width)
    if dots:
        ends = np.array([curve.start for loop in boundary.loops for curve in loop])
        ax.plot(*ends.T, linestyle="none", marker="o", markersize=3.2, color=color, zorder=4)


def draw_lines(ax: Axes, lines: Sequence[FloatArray], color: str = INK, width: float = 1.6, order: int = 3) -> None:
    """Polylines of one colour."""
    from matplotlib.collections import LineCollection

    ax.add_collection(
        LineCollection(lines, colors=color, linewidths=width, capstyle="round", joinstyle="round", zorder=order)
    )


def finish(ax: Axes, title: str | None) -> None:
    """Equal scales, no frame, a title."""
    _frame(ax)
    ax.set_axis_off()
    if title:
        ax.set_title(title, fontsize=11, color=INK)


def _frame(ax: Axes) -> None:
    ax.set_aspect("equal")
    ax.autoscale_view()


def color_bar(figure: Any, mappable: ScalarMappable, axes: list[Axes], color: str = "scaled_jacobian") -> None:
    """The bar of a quantity: classes of equal height with their bounds; what is folded below, if anything is."""
    quantity = QUANTITIES[color]
    found = [c.get_array() for ax in axes for c in ax.collections]
    shown = np.concatenate([np.asarray(values) for values in found if values is not None])
    folded, beyond = bool((shown <= 0).any()), bool((shown > quantity.bounds[-1]).any())
    extend = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[
        folded, beyond
    ]
    bar = figure.colorbar(
        mappable, ax=axes, shrink=0.75, aspect=28, pad=0.02, extend=extend, extendfrac=0.04, spacing="uniform"
    )
    bar.set_label(quantity.label, color=INK)
    bar.set_ticks([quantity.levels[0], *quantity.bounds[1:]], labels=[f"{x:g}" for x in quantity.bounds])
    bar.minorticks_off()
    if folded:
        bar.ax.text(
            0.5, -0.055, "folded", transform=bar.ax.transAxes, ha="center", va="top", fontsize=9, color=LIGHT.folded
        )
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0, labelsize=9, colors=INK)


def extraordinary_legend(*models: MultiPatch) -> list[Any]:
    """A legend's handles: of extraordinary vertices, if there are any."""
    if not any(vertex.extraordinary for mp in models for vertex in mp.vertices):
        return []
    from matplotlib.lines import Line2D

    return [Line2D([], [], label="extraordinary vertex", **_EXTRAORDINARY)]


def legend(ax: Axes, handles: list[Any], covered: FloatArray) -> None:
    """A legend inside the frame: in the corner where it hides nothing of `covered` (n, 2), else in room made below."""
    if not handles:
        return
    unit = points_per_unit(ax)
    width = (HANDLE + LETTER * max(len(handle.get_label()) for handle in handles)) / unit
    height = (ROW * len(handles) + 6) / unit
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    middle = (left + right - width) / 2
    places: dict[Any, tuple[float, float]] = {
        "lower left": (left, low),
        "lower right": (right - width, low),
        "upper left": (left, high - height),
        "upper right": (right - width, high - height),
        "lower center": (middle, low),
        "upper center": (middle, high - height),
    }
    free = [
        name
        for name, corner in places.items()
        if not ((covered >= corner) & (covered <= np.add(corner, (width, height)))).all(axis=1).any()
    ]
    if not free or width > right - left:
        ax.set_ylim(low - height, high)
        if width > right - left:
            ax.set_xlim((left + right - width) / 2, (left + right + width) / 2)
    ax.legend(
        handles=handles,
        loc=free[0] if free else "lower center",
        frameon=False,
        fontsize=9,
        handletextpad=0.4,
        borderpad=0.2,
        borderaxespad=0.2,
    )


def covered_by(mp: MultiPatch) -> FloatArray:
    """Points of a model, close enough to tell where a legend would hide it."""
    t = np.linspace(0, 1, 13)
    grids = [patch.grid(*(k[0] + t * (k[-1] - k[0]) for k in patch.knots)) for patch in mp.patches]
    return np.concatenate([grid.reshape(-1, 2) for grid in grids])


def figure_of(ax: Axes) -> Picture:
    """The figure of axes."""
    return cast("Picture", ax.figure)
