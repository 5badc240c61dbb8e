"""Contact sheets: every direction's source and result side by side, patches in the same colours, the status above."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from pair_judgement import CLEAN, Direction
from PIL import Image

import patchtransfer as pt

#: Columns and rows of a page: what can still be seen at 2400 pixels of width.
COLUMNS, ROWS = 6, 6
#: Lines that cut a patch in each direction, and points of each.
LINES, POINTS = 4, 33
GOOD, POOR, BAD, GREY = "#1a6b2d", "#b06000", "#c0141a", "#8a8a8a"
#: A direction with its source, the map and the target.
Drawn = tuple[Direction, pt.MultiPatch | None, pt.MultiPatch | None, pt.Boundary]


def draw(drawn: Sequence[Drawn], path: Path, rows: int = ROWS, dpi: int = 100) -> list[Path]:
    """Write the pages: `path` itself, or with -1, -2, ... in its name where there are several."""
    size = COLUMNS * rows
    pages = [drawn[k : k + size] for k in range(0, len(drawn), size)]
    written = []
    for k, page in enumerate(pages):
        lines = -(-len(page) // COLUMNS)
        figure = Figure(figsize=(4 * COLUMNS, 2.5 * lines))
        axes = figure.subplots(lines, 2 * COLUMNS, squeeze=False).reshape(-1, 2)
        figure.subplots_adjust(0.005, 0.01, 0.995, 1 - 0.5 / (2.5 * lines), 0.08, 0.35)
        for (left, right), one in zip(axes, page, strict=False):
            _draw_direction(left, right, one)
        for ax in axes[len(page) :].ravel():
            ax.set_axis_off()
        name = path if len(pages) == 1 else path.with_stem(f"{path.stem}-{k + 1}")
        name.parent.mkdir(parents=True, exist_ok=True)
        picture = io.BytesIO()
        figure.savefig(picture, dpi=dpi)
        # In 256 colours to keep the file small.
        Image.open(picture).convert("RGB").quantize(256).save(name, optimize=True)
        written.append(name)
    return written


def _draw_direction(left: Axes, right: Axes, drawn: Drawn) -> None:
    o, source, result, target = drawn
    colours = colormaps["gist_rainbow"](np.linspace(0, 1, len(source or "."))) * [0.9, 0.9, 0.9, 1]
    if source is not None:
        _draw_patches(left, source, colours)
    for loop in target.loops:
        points = np.concatenate([c(np.linspace(*c.domain, POINTS)) for c in loop])
        right.plot(*points.T, color="black" if result is None else GREY, lw=0.6, zorder=3)
    if result is not None:
        # Patches that come of one have its colour.
        _draw_patches(right, result, colours[o.origins or range(len(result))])
    right.plot(*np.reshape(o.lost, (-1, 2)).T, "o", mfc="none", mec=BAD, ms=5, mew=1, zorder=5)
    right.plot(*np.reshape(o.smoothed, (-1, 2)).T, "s", mfc="none", mec=POOR, ms=5, mew=1, zorder=5)
    colour = GOOD if o.clean else POOR if o.success else BAD
    left.set_title(o.source, fontsize=8, color="black")
    right.set_title(f"{o.target}\n{_caption(o)}", fontsize=8, color=colour)
    for ax in (left, right):
        ax.set_aspect("equal")
        ax.margins(0.03)
        ax.set_axis_off()


def _caption(o: Direction) -> str:
    parts = [o.status]
    if o.boundary_error is not None:
        parts.append(f"e {o.boundary_error:.0e}" + "!" * (o.boundary_error > CLEAN))
    if o.lost:
        parts.append(f"{len(o.lost)} of {o.corners} corners lost")
    if o.jacobian is not None:
        own = f" (own {o.own_jacobian[1]:.2f})" if o.own_jacobian else ""
        parts.append(f"SJ {o.jacobian[0]:.2f}/{o.jacobian[1]:.2f}{own}")
    return f"{', '.join(parts[:2])}\n{', '.join(parts[2:])}"


def _draw_patches(ax: Axes, mp: pt.MultiPatch, colours: np.ndarray) -> None:
    """Filled patches, iso-lines and sides."""
    t = np.linspace(0, 1, POINTS)
    thin, thick = [], []
    for patch, colour in zip(mp.patches, colours, strict=True):
        (a, b), (c, d) = patch.domain
        lines = np.linspace(0, 1, LINES + 1)
        along = [patch.grid(a + lines * (b - a), c + t * (d - c)), patch.grid(a + t * (b - a), c + lines * (d - c))]
        along[1] = along[1].swapaxes(0, 1)
        ring = np.concatenate([along[1][0], along[0][-1], along[1][-1][::-1], along[0][0][::-1]])
        ax.fill(*ring.T, color=0.45 * colour + 0.55, lw=0, zorder=1)
        thin += [line for family in along for line in family[1:-1]]
        thick += [line for family in along for line in family[[0, -1]]]
    ax.add_collection(LineCollection(thin, colors="#00000066", linewidths=0.3, zorder=2))
    ax.add_collection(LineCollection(thick, colors="#000000", linewidths=0.8, zorder=4))
    ax.autoscale_view()
