"""Figures: multi-patches by quality (as Fig. 9 of the paper), boundaries, transfers, registrations.

Every function returns a figure made without pyplot: no backend is chosen and figures can be drawn from several
threads. Notebooks show what is returned, `.show()` opens a window, :func:`savefig` writes it.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..files import write_atomic
from ..geometry.areas import polygon_area
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..numeric.arrays import FloatArray
from .continuity import slope_difference
from .drawing import (
    GREY,
    INK,
    closed_loops,
    color_bar,
    covered_by,
    draw_boundary,
    draw_multipatch,
    extraordinary_legend,
    figure_of,
    finish,
    legend,
    new_axes,
    panels,
    side_lines,
)
from .labels import number_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["boundary", "multipatch", "png", "registration", "savefig", "slope_difference", "transfer"]

#: What pictures are written as.
SUFFIXES = (".png", ".svg", ".pdf")
#: Joints that get a number at most; of more, every second, third, ... does.
MAX_NUMBERS = 40


def multipatch(
    mp: MultiPatch,
    ax: Axes | None = None,
    iso_lines: int | None = None,
    colorbar: bool = True,
    title: str | None = None,
    *,
    color: str | None = "scaled_jacobian",
    source: MultiPatch | None = None,
    ids: bool = False,
    control_net: bool = False,
) -> Figure:
    """Draw the iso-parametric lines of a multi-patch, coloured by quality.

    Interfaces are drawn thicker, the boundary black, extraordinary vertices as white discs; where the map folds the
    lines are magenta.

    Parameters
    ----------
    mp : MultiPatch
    ax : matplotlib Axes, optional
        Where to draw; by default a new figure is made.
    iso_lines : int, optional
        Intervals between iso-lines per knot span; by default as many as make about eight a patch.
    colorbar : bool, default True
        Whether to add the colour bar, if lines have colours.
    title : str, optional
    color : {"scaled_jacobian", "condition", "stretch", "dilatation", "patch"} or None, default "scaled_jacobian"
        Of the lines: det J / (|B_u| |B_v|), 1 at best; ‖J‖_F ‖J⁻¹‖_F, 2 at best; of the map from `source`, the square
        root of the ratio of areas over that of the whole shapes, and the ratio of the largest to the smallest stretch
        (1 where it is conformal). "patch" tints patches, neighbours differently, and leaves the lines grey, as None
        does.
    source : MultiPatch, optional
        For "stretch" and "dilatation": a model of the same layout, such as the source of a transfer.
    ids : bool, default False
        Whether to write the patches' numbers.
    control_net : bool, default False
        Whether to draw the control nets.

    Returns
    -------
    matplotlib.figure.Figure
        The figure of `ax`.

    Raises
    ------
    InputError
        When `iso_lines` is below 1, `color` is unknown, or the source that it needs is missing or of another layout.

    Examples
    --------
    >>> from patchtransfer import examples
    >>> source, _, _ = examples.load("star")
    >>> figure = multipatch(source, color="condition", ids=True)
    >>> [text.get_text() for text in figure.axes[0].texts]
    ['0', '1', '2', '3', '4', '5']
    """
    ax = new_axes(np.concatenate(side_lines(mp))) if ax is None else ax
    mappable = draw_multipatch(ax, mp, iso_lines, color=color, source=source, ids=ids, control_net=control_net)
    finish(ax, title)
    if colorbar and mappable is not None:
        assert color is not None
        color_bar(ax.figure, mappable, [ax], color)
    legend(ax, extraordinary_legend(mp), covered_by(mp))
    return figure_of(ax)


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

    Examples
    --------
    >>> import patchtransfer as pt
    >>> _, target, _ = pt.examples.load("star")
    >>> figure = pt.plot.boundary(target, title="target")
    >>> figure.axes[0].get_title()
    'target'
    """
    ax = new_axes(np.concatenate(closed_loops(boundary))) if ax is None else ax
    draw_boundary(ax, boundary)
    finish(ax, title)
    return figure_of(ax)


def transfer(
    source: MultiPatch,
    target: Boundary,
    result: MultiPatch,
    titles: Sequence[str] = ("source", "target", "result"),
    caption: str | None = None,
    *,
    color: str | None = "scaled_jacobian",
    ids: bool = False,
    control_net: bool = False,
) -> Figure:
    """Draw a transfer: source, target boundary and result side by side, with one colour bar.

    Parameters
    ----------
    source, result : MultiPatch
    target : Boundary
    titles : sequence of three str, optional
    caption : str, optional
        A line under the panels, such as the quality reached.
    color, ids, control_net
        As of `multipatch`; "stretch" and "dilatation" are those of the map from the source to the result.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> result = pt.transfer(source, target, landmarks)
    >>> figure = pt.plot.transfer(source, target, result.multipatch)
    >>> [ax.get_title() for ax in figure.axes[:3]]
    ['source', 'target', 'result']
    """
    outlines = [np.concatenate(lines) for lines in (side_lines(source), closed_loops(target), side_lines(result))]
    figure, axes = panels(outlines, 1.2)
    for ax, mp in ((axes[0], source), (axes[2], result)):
        mappable = draw_multipatch(ax, mp, color=color, source=source, ids=ids, control_net=control_net)
    draw_boundary(axes[1], target)
    for ax, title in zip(axes, titles, strict=True):
        finish(ax, title)
    if mappable is not None:
        assert color is not None
        color_bar(figure, mappable, axes, color)
    handles = extraordinary_legend(source, result)
    if handles:
        figure.legend(handles=handles, loc="outside lower left", frameon=False, fontsize=9)
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

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> result = pt.transfer(source, target, landmarks)
    >>> joints = [[*a, *b] for a, b in result.registration.joints]
    >>> figure = pt.plot.registration(source.boundary(), result.multipatch.boundary(), joints, target)
    >>> [ax.get_title() for ax in figure.axes]
    ['source', 'target']
    """
    pairs, dots = (np.asarray(x, dtype=np.float64) for x in (joints, np.empty((0, 4)) if matched is None else matched))
    for name, rows in (("joints", pairs), ("matched", dots)):
        if rows.ndim != 2 or rows.shape[1] != 4:
            raise InputError(f"{name} must have shape (r, 4), a row xs, ys, xt, yt each, got {rows.shape}")
    if confidence is not None:
        titles = (titles[0], f"{titles[1]} (confidence {confidence:.2f})")
    figure, axes = panels([np.concatenate(closed_loops(b)) for b in (source, fitted)], 0.4)
    from matplotlib import colormaps
    from matplotlib.lines import Line2D

    if target is not None:
        draw_boundary(axes[1], target, color="#b5b5b5", width=3.5, dots=False)
        handles = [
            Line2D([], [], color="#b5b5b5", lw=3.5, label="target"),
            Line2D([], [], color=INK, label="fit"),
        ]
        figure.legend(handles=handles, loc="outside lower right", ncols=2, frameon=False, fontsize=9)
    # Going once round the hue circle tells neighbours, and where a loop starts, apart.
    colors, hues = (
        colormaps["hsv"](np.arange(len(x)) / max(len(x), 1)) * [0.86, 0.82, 0.86, 1.0] for x in (pairs, dots)
    )
    numbered = slice(None, None, -(-len(pairs) // MAX_NUMBERS) or 1)
    for ax, loops, points, small in (
        (axes[0], source, pairs[:, :2], dots[:, :2]),
        (axes[1], fitted, pairs[:, 2:], dots[:, 2:]),
    ):
        draw_boundary(ax, loops, width=1.3, dots=False)
        ax.scatter(points[:, 0], points[:, 1], s=34, c=colors, edgecolors="white", linewidths=0.8, zorder=5)
        ax.scatter(small[:, 0], small[:, 1], s=7, c=hues, linewidths=0, zorder=4)
    for ax, title in zip(axes, titles, strict=True):
        finish(ax, title)
    for ax, loops, points in ((axes[0], source, pairs[:, :2]), (axes[1], fitted, pairs[:, 2:])):
        _number(ax, points, colors, loops, numbered)
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

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, _, _ = pt.examples.load("star")
    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> pt.plot.savefig(pt.plot.multipatch(source), folder / "star.svg")
    >>> (folder / "star.svg").exists()
    True
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{target}: unknown figure format {target.suffix!r}; use {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
        )
    from .picture import rendered

    write_atomic(target, rendered(figure, target.suffix.lower().removeprefix("."), dpi))


def png(shown: MultiPatch | Patch | Boundary, dpi: int = 110) -> bytes:
    """PNG image of `plot.multipatch` or `plot.boundary`, for notebooks.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, _, _ = pt.examples.load("star")
    >>> pt.plot.png(source)[1:4]
    b'PNG'
    """
    figure = picture_of(shown)
    from .picture import rendered

    return rendered(figure, "png", dpi)


def picture_of(shown: MultiPatch | Patch | Boundary) -> Figure:
    """What shows a model, a patch or a boundary."""
    if isinstance(shown, Boundary):
        return boundary(shown)
    # A patch alone may fold anywhere; it is drawn as it is, glued to nothing.
    return multipatch(MultiPatch([shown], []) if isinstance(shown, Patch) else shown)


def _number(ax: Axes, points: FloatArray, colors: FloatArray, loops: Boundary, which: slice) -> None:
    """Write the numbers, from 1, of some of the joints beside them, outside their loops where there is room."""
    polylines = closed_loops(loops)
    outwards = np.zeros_like(points)
    for k, point in enumerate(points):
        line = min(polylines, key=lambda line: float(np.hypot(*(line - point).T).min()))
        at = int(np.argmin(np.hypot(*(line - point).T)))
        steps = np.array([line[at] - line[at - 2], line[(at + 2) % len(line)] - line[at]])
        tangent = (steps / np.maximum(np.hypot(*steps.T), 1e-300)[:, None]).sum(axis=0)
        outwards[k] = np.array([tangent[1], -tangent[0]]) * (1.0 if polygon_area(line) > 0 else -1.0)
    numbers = range(1, len(points) + 1)[which]
    number_points(ax, numbers, points[which], outwards[which], colors[which], points, np.concatenate(polylines))
