"""Figures: multi-patches by scaled Jacobian (as Fig. 9 of the paper), boundaries, transfers, registrations.

Every function returns a `matplotlib.figure.Figure` made without pyplot: no backend is chosen, nothing is
shown, and figures can be drawn from several threads. :func:`savefig` writes them.
"""

from __future__ import annotations

import base64
import html as markup
import os
import threading
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..files import write_atomic
from ..geometry.areas import polygon_area
from ..geometry.basis import knot_spans
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..measure.quality import sample
from ..numeric.arrays import FloatArray
from .continuity import slope_difference

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

__all__ = ["boundary", "html", "multipatch", "png", "registration", "savefig", "slope_difference", "transfer"]

INK, GREY, FOLDED = "#1b1b1b", "#6b6b6b", "#e8000b"
#: What pictures are written as.
SUFFIXES = (".png", ".svg", ".pdf")
#: Joints that get a number at most; of more, every second, third, ... does.
MAX_NUMBERS = 40
_salt_lock = threading.Lock()


def multipatch(
    mp: MultiPatch,
    ax: Axes | None = None,
    iso_lines: int | None = None,
    colorbar: bool = True,
    title: str | None = None,
) -> Figure:
    """Draw the iso-parametric lines of a multi-patch, coloured by scaled Jacobian.

    Interfaces are drawn thicker, the boundary black, extraordinary vertices as white discs; where the scaled
    Jacobian is not positive the lines are red.

    Parameters
    ----------
    mp : MultiPatch
    ax : matplotlib Axes, optional
        Where to draw; by default a new figure is made.
    iso_lines : int, optional
        Intervals between iso-lines per knot span; by default as many as make about eight a patch.
    colorbar : bool, default True
        Whether to add the colour bar, 0 to 1.
    title : str, optional

    Returns
    -------
    matplotlib.figure.Figure
        The figure of `ax`.

    Raises
    ------
    InputError
        When `iso_lines` is below 1.
    """
    if iso_lines is not None and iso_lines < 1:
        raise InputError(f"iso_lines = {iso_lines}: at least 1 interval per knot span is needed")
    ax = _new_axes(np.concatenate(_sides(mp))) if ax is None else ax
    mappable = _draw_multipatch(ax, mp, iso_lines)
    _finish(ax, title)
    if colorbar:
        _colorbar(ax.figure, mappable, [ax])
    if any(vertex.extraordinary for vertex in mp.vertices):
        _legend(ax, [_extraordinary_handle()])
    return _figure(ax)


def boundary(boundary: Boundary, ax: Axes | None = None, title: str | None = None) -> Figure:
    """Draw boundary loops, the ends of their curves as dots.

    Parameters
    ----------
    boundary : Boundary
    ax : matplotlib Axes, optional
        Where to draw; by default a new figure is made.
    title : str, optional

    Returns
    -------
    matplotlib.figure.Figure
    """
    ax = _new_axes(np.concatenate(_loops(boundary))) if ax is None else ax
    _draw_boundary(ax, boundary)
    _finish(ax, title)
    return _figure(ax)


def transfer(
    source: MultiPatch,
    target: Boundary,
    result: MultiPatch,
    titles: Sequence[str] = ("source", "target", "result"),
    caption: str | None = None,
) -> Figure:
    """Draw a transfer: source, target boundary and result side by side, with one colour bar.

    Parameters
    ----------
    source, result : MultiPatch
    target : Boundary
    titles : sequence of three str, optional
    caption : str, optional
        A line under the panels, such as the quality reached.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = _panels([np.concatenate(lines) for lines in (_sides(source), _loops(target), _sides(result))], 1.2)
    mappable = _draw_multipatch(axes[0], source, None)
    _draw_boundary(axes[1], target)
    _draw_multipatch(axes[2], result, None)
    for ax, title in zip(axes, titles, strict=True):
        _finish(ax, title)
    _colorbar(figure, mappable, axes)
    if any(v.extraordinary for mp in (source, result) for v in mp.vertices):
        _legend(axes[0], [_extraordinary_handle()])
    if caption:
        figure.supxlabel(caption, fontsize=10, color=GREY)
    return figure


def registration(
    source: Boundary,
    fitted: Boundary,
    joints: ArrayLike,
    target: Boundary | None = None,
    titles: Sequence[str] = ("source", "target"),
    *,
    matched: ArrayLike | None = None,
    confidence: float | None = None,
) -> Figure:
    """Draw two boundaries with matched joints in like colours, and numbers at some of them.

    Parameters
    ----------
    source, fitted : Boundary
        The source's boundary and its image.
    joints : (r, 4) array
        Matched points, a row xs, ys, xt, yt each.
    target : Boundary, optional
        The target as given, drawn in grey under the fitted curves.
    titles : sequence of two str, optional
    matched : (n, 4) array, optional
        More matched points, drawn as small dots, each in the colour of its place along all of them.
    confidence : float, optional
        How sure the correspondence is, 0 to 1; added to the target's title.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        When `joints` or `matched` has another shape.
    """
    pairs, dots = (np.asarray(x, dtype=np.float64) for x in (joints, np.empty((0, 4)) if matched is None else matched))
    for name, rows in (("joints", pairs), ("matched", dots)):
        if rows.ndim != 2 or rows.shape[1] != 4:
            raise InputError(f"{name} must have shape (r, 4), a row xs, ys, xt, yt each, got {rows.shape}")
    if confidence is not None:
        titles = (titles[0], f"{titles[1]} (confidence {confidence:.2f})")
    from matplotlib import colormaps
    from matplotlib.lines import Line2D

    figure, axes = _panels([np.concatenate(_loops(b)) for b in (source, fitted)], 0.4)
    if target is not None:
        _draw_boundary(axes[1], target, color="#b5b5b5", width=3.5, dots=False)
        legend = [
            Line2D([], [], color="#b5b5b5", lw=3.5, label="target"),
            Line2D([], [], color=INK, label="fit"),
        ]
    # Going once round the hue circle tells neighbours, and where a loop starts, apart.
    colors, hues = (
        colormaps["hsv"](np.arange(len(x)) / max(len(x), 1)) * [0.86, 0.82, 0.86, 1.0] for x in (pairs, dots)
    )
    numbered = slice(None, None, -(-len(pairs) // MAX_NUMBERS) or 1)
    for ax, loops, points, small in (
        (axes[0], source, pairs[:, :2], dots[:, :2]),
        (axes[1], fitted, pairs[:, 2:], dots[:, 2:]),
    ):
        _draw_boundary(ax, loops, width=1.3, dots=False)
        ax.scatter(points[:, 0], points[:, 1], s=34, c=colors, edgecolors="white", linewidths=0.8, zorder=5)
        ax.scatter(small[:, 0], small[:, 1], s=7, c=hues, linewidths=0, zorder=4)
        _number(ax, points, colors, loops, numbered)
    for ax, title in zip(axes, titles, strict=True):
        _finish(ax, title)
    if target is not None:
        _legend(axes[1], legend)
    return figure


def savefig(figure: Figure, path: str | os.PathLike[str], dpi: int = 200) -> None:
    """Write a figure, all of it or nothing; the same figure always gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : path-like
        The suffix sets the format: .png, .svg or .pdf.
    dpi : int, default 200
        Dots per inch of raster images.

    Raises
    ------
    InputError
        On another suffix or a folder that cannot be written to.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{target}: unknown figure format {target.suffix!r}; use {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
        )
    write_atomic(target, _rendered(figure, target.suffix.lower().removeprefix("."), dpi))


def png(shown: MultiPatch | Patch | Boundary, dpi: int = 110) -> bytes:
    """PNG image of :func:`multipatch` or :func:`boundary`, for notebooks."""
    return _rendered(_picture(shown), "png", dpi)


def html(shown: MultiPatch | Patch | Boundary) -> str:
    """HTML table of a multi-patch, a patch or a boundary with its picture, for notebooks."""
    cells = "".join(
        f'<tr><th style="text-align:left">{markup.escape(name)}</th>'
        f'<td style="text-align:right">{markup.escape(str(value))}</td></tr>'
        for name, value in _facts(shown).items()
    )
    picture = base64.b64encode(png(shown)).decode("ascii")
    what = "curves" if isinstance(shown, Boundary) else "iso-parametric lines coloured by scaled Jacobian"
    return (
        '<div style="display:flex;align-items:center;gap:1.5em">'
        f"<table><caption>{type(shown).__name__}</caption>{cells}</table>"
        f'<img alt="{what}" style="max-width:560px" '
        f'src="data:image/png;base64,{picture}"></div>'
    )


def _picture(shown: MultiPatch | Patch | Boundary) -> Figure:
    if isinstance(shown, Boundary):
        return boundary(shown)
    # A patch alone may fold anywhere; it is drawn as it is, glued to nothing.
    return multipatch(MultiPatch([shown], []) if isinstance(shown, Patch) else shown)


def _facts(shown: MultiPatch | Patch | Boundary) -> dict[str, object]:
    """What the table in a notebook says, by name."""
    if isinstance(shown, Boundary):
        curves = [curve for loop in shown.loops for curve in loop]
        return {
            "loops": len(shown.loops),
            "curves": len(curves),
            "degrees": ", ".join(str(p) for p in sorted({curve.degree for curve in curves})),
            "control points": sum(len(curve.control_points) for curve in curves),
            "diameter": f"{shown.diameter:.4g}",
        }
    if isinstance(shown, Patch):
        return {
            "degrees": "{} × {}".format(*shown.degrees),
            "control points": "{} × {}".format(*shown.shape),
            "weights": "no" if shown.weights is None else "yes",
        }
    degrees = sorted({patch.degrees for patch in shown.patches})
    return {
        "patches": len(shown.patches),
        "degrees": ", ".join(f"{p} × {q}" for p, q in degrees),
        "control points": shown.topology.n_points,
        "interfaces": len(shown.interfaces),
        "holes": len(shown.loops) - 1,
        "extraordinary vertices": sum(vertex.extraordinary for vertex in shown.vertices),
    }


def _rendered(figure: Figure, kind: str, dpi: int) -> bytes:
    import matplotlib

    metadata: dict[str, Any] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    buffer = BytesIO()
    with _salt_lock:
        # SVG ids are random unless salted, and only through this setting.
        salt = matplotlib.rcParams["svg.hashsalt"]
        matplotlib.rcParams["svg.hashsalt"] = "patchtransfer"
        try:
            figure.savefig(buffer, format=kind, dpi=dpi, metadata=metadata, facecolor="white")
        finally:
            matplotlib.rcParams["svg.hashsalt"] = salt
    return buffer.getvalue()


def new_figure(size: tuple[float, float]) -> Figure:
    """An empty figure of this size in inches, made without pyplot."""
    from matplotlib.figure import Figure

    return Figure(figsize=size, layout="constrained")


def _new_axes(outline: FloatArray) -> Axes:
    width, height = np.ptp(outline, axis=0).tolist()
    longest = max(width, height) or 1.0
    size = (max(3.2, 6.4 * width / longest) + 1.4, max(2.8, 6.4 * height / longest) + 0.6)
    return new_figure(size).subplots()


def _panels(outlines: list[FloatArray], extra: float) -> tuple[Figure, list[Axes]]:
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


def _figure(ax: Axes) -> Figure:
    return cast("Figure", ax.figure)


def _polyline(curve: BSplineCurve, per_span: int = 24) -> FloatArray:
    breaks = knot_spans(curve.knots)
    return curve(np.unique(np.linspace(breaks[:-1], breaks[1:], per_span + 1)))


def _loops(loops: Boundary) -> list[FloatArray]:
    """Sample closed loops as polylines, the first point not repeated."""
    return [np.concatenate([_polyline(curve)[:-1] for curve in loop]) for loop in loops.loops]


def _sides(mp: MultiPatch) -> list[FloatArray]:
    """Sample boundary sides one by one: a model whose boundary does not close can be looked at too."""
    return [_polyline(mp.topology.directed_side(*side).curve(mp.patches)) for side in mp.boundaries]


def _draw_multipatch(ax: Axes, mp: MultiPatch, iso_lines: int | None) -> ScalarMappable:
    """Iso-lines, interfaces, boundary and extraordinary vertices; returns what the colour bar shows."""
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap, Normalize

    spans = max(len(knot_spans(knots)) - 1 for patch in mp.patches for knots in patch.knots)
    intervals = max(1, round(8 / spans)) if iso_lines is None else iso_lines
    between = max(2, -(-32 // (intervals * spans)))
    samples = intervals * between + 1
    thin: list[tuple[FloatArray, FloatArray]] = []
    thick: list[tuple[FloatArray, FloatArray]] = []
    for points, scaled in sample(mp, samples):
        for p, s in ((points, scaled), (points.swapaxes(0, 1), scaled.T)):
            # The line at a break was sampled from both spans: drawn once, in the worse colour.
            s = s.copy()
            s[samples - 1 : -1 : samples] = np.minimum(s[samples - 1 : -1 : samples], s[samples::samples])
            grid = np.arange(len(p)).reshape(-1, samples)[:, ::between]
            rows = np.append(grid[0, 0], grid[:, 1:])
            thin.append(_segments(p[rows[1:-1]], s[rows[1:-1]]))
            thick.append(_segments(p[rows[[0, -1]]], s[rows[[0, -1]]]))
    # Without viridis' yellow end, which is too pale on white: good is green, poor is dark.
    colormap = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.8, 256))).with_extremes(under=FOLDED)
    # The smallest positive number: zero itself counts as folded.
    norm = Normalize(np.nextafter(0.0, 1.0), 1.0)
    for lines, width, order in ((thin, 0.7, 1), (thick, 1.5, 2)):
        segments = np.concatenate([s for s, _ in lines])
        values = np.concatenate([v for _, v in lines])
        collection = LineCollection(
            list(segments),
            array=values,
            cmap=colormap,
            norm=norm,
            linewidths=width,
            capstyle="round",
            zorder=order,
        )
        ax.add_collection(collection)
    _draw_lines(ax, _sides(mp))
    special = [v.point for v in mp.vertices if v.extraordinary]
    if special:
        ax.plot(*mp.topology.coordinates[special].T, **_EXTRAORDINARY, zorder=6)
    return collection


_EXTRAORDINARY: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 5.5,
    "markerfacecolor": "white",
    "markeredgecolor": INK,
    "markeredgewidth": 1.1,
}


def _extraordinary_handle() -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], label="extraordinary vertex", **_EXTRAORDINARY)


def _segments(points: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Segments (m, 2, 2) of lines (l, n, 2) and the smaller value at their two ends."""
    segments = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 2)
    return segments, np.minimum(values[:, :-1], values[:, 1:]).ravel()


def _draw_boundary(ax: Axes, boundary: Boundary, color: str = INK, width: float = 1.6, dots: bool = True) -> None:
    _draw_lines(ax, [np.concatenate([line, line[:1]]) for line in _loops(boundary)], color, width)
    if dots:
        ends = np.array([curve.start for loop in boundary.loops for curve in loop])
        ax.plot(*ends.T, linestyle="none", marker="o", markersize=3.2, color=color, zorder=4)


def _draw_lines(ax: Axes, lines: list[FloatArray], color: str = INK, width: float = 1.6) -> None:
    from matplotlib.collections import LineCollection

    ax.add_collection(
        LineCollection(lines, colors=color, linewidths=width, capstyle="round", joinstyle="round", zorder=3)
    )


def _number(ax: Axes, points: FloatArray, colors: FloatArray, loops: Boundary, which: slice) -> None:
    """Write the numbers, from 1, of some of the joints outside their loops."""
    polylines = _loops(loops)
    for k, point, color in list(zip(range(len(points)), points, colors, strict=True))[which]:
        line = min(polylines, key=lambda line: float(np.hypot(*(line - point).T).min()))
        at = int(np.argmin(np.hypot(*(line - point).T)))
        steps = np.array([line[at] - line[at - 2], line[(at + 2) % len(line)] - line[at]])
        tangent = (steps / np.maximum(np.hypot(*steps.T), 1e-300)[:, None]).sum(axis=0)
        normal = np.array([tangent[1], -tangent[0]]) * (1.0 if polygon_area(line) > 0 else -1.0)
        x, y = (9.0 * normal / max(float(np.hypot(*normal)), 1e-300)).tolist()
        ax.annotate(
            str(k + 1),
            point,
            (x, y),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=7.5,
            color=color * [0.8, 0.8, 0.8, 1.0],
        )


def _finish(ax: Axes, title: str | None) -> None:
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.set_axis_off()
    if title:
        ax.set_title(title, fontsize=11, color=INK)


def _colorbar(figure: Any, mappable: ScalarMappable, axes: list[Axes]) -> None:
    bar = figure.colorbar(mappable, ax=axes, shrink=0.75, aspect=28, pad=0.02, extend="min", extendfrac=0.04)
    bar.set_label("scaled Jacobian", color=INK)
    bar.set_ticks([0, 0.2, 0.4, 0.6, 0.8, 1], labels=["0", "0.2", "0.4", "0.6", "0.8", "1"])
    bar.ax.text(0.5, -0.055, "folded", transform=bar.ax.transAxes, ha="center", va="top", fontsize=9, color=FOLDED)
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0, labelsize=9, colors=INK)


def _legend(ax: Axes, handles: list[Any]) -> None:
    ax.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        ncols=len(handles),
        frameon=False,
        fontsize=9,
    )
