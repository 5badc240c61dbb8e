"""Pictures of `patchtransfer.reproduce`: Figures 8, 9, 11 and 12 of the paper, all samples on a sheet."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..files import write_atomic
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..iga import PoissonResult
from ..numeric.arrays import FloatArray
from ..plot.drawing import (
    INK,
    color_bar,
    draw_boundary,
    draw_lines,
    draw_multipatch,
    finish,
    new_figure,
    side_lines,
)
from ..plot.fields import draw_field, even_grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["colour_maps", "decompositions", "save", "solutions", "steps"]

#: Inches of a panel, and dots per inch: a sheet stays below 150 kB.
PANEL, DPI = (2.6, 2.6), 84
#: Colours of a sheet; fewer than 256 tell in the colour maps.
COLOURS = 256
#: Intervals between plain iso-lines, per patch and direction.
ISO_LINES = 6


def save(figure: Figure, path: Path) -> None:
    """Write a PNG with a palette, half the size of the full one."""
    from PIL import Image

    from ..plot.picture import rendered

    with Image.open(BytesIO(rendered(figure, "png", DPI))) as picture:
        small = picture.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    buffer = BytesIO()
    small.save(buffer, format="PNG", optimize=True)
    write_atomic(path, buffer.getvalue())


def _sheet(
    rows: int, columns: int, extra: float = 0.0, panel: tuple[float, float] = PANEL
) -> tuple[Figure, NDArray[np.object_]]:
    figure = new_figure((panel[0] * columns + extra, panel[1] * rows + 0.3))
    return figure, figure.subplots(rows, columns, squeeze=False)


def decompositions(models: Sequence[tuple[MultiPatch, Boundary, MultiPatch]], names: Sequence[str]) -> Figure:
    """Fig. 8: a row a sample, with source, target, result and the result's iso-parametric lines."""
    figure, axes = _sheet(len(models), 4)
    for row, name, (source, target, result) in zip(axes, names, models, strict=True):
        _draw_patches(row[0], source)
        draw_boundary(row[1], target, width=1.0, dots=False)
        _draw_patches(row[2], result)
        _draw_iso_lines(row[3], result)
        for ax, title in zip(row, ("source", "target", "result", "iso-lines"), strict=True):
            finish(ax, f"{name}: {title}")
    return figure


def _draw_patches(ax: Axes, mp: MultiPatch) -> None:
    """Every patch in a colour of its own."""
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection

    outlines = [
        np.concatenate([g[:-1, 0], g[-1, :-1], g[:0:-1, -1], g[0, :0:-1]])
        for g in (p.grid(*even_grid(mp, k)) for k, p in enumerate(mp.patches))
    ]
    colors = colormaps["tab20"](np.arange(len(mp)) % 20)
    ax.add_collection(PolyCollection(outlines, facecolors=colors, edgecolors=INK, linewidths=0.6))


def _draw_iso_lines(ax: Axes, mp: MultiPatch) -> None:
    lines: list[FloatArray] = []
    for k, patch in enumerate(mp.patches):
        u, v = even_grid(mp, k)
        at_u, at_v = (np.linspace(t[0], t[-1], ISO_LINES + 1) for t in (u, v))
        lines += [*patch.grid(at_u, v), *patch.grid(u, at_v).swapaxes(0, 1)]
    draw_lines(ax, lines, color="#5f6b7a", width=0.4)
    draw_lines(ax, side_lines(mp), width=1.0)


def colour_maps(pairs: Sequence[tuple[MultiPatch, MultiPatch]], names: Sequence[str]) -> Figure:
    """Fig. 9: source and result by scaled Jacobian, two samples a row."""
    figure, axes = _sheet(-(-len(pairs) // 2), 4, extra=1.0)
    titles = [f"{name}: {shape}" for name in names for shape in ("source", "result")]
    _coloured(figure, axes.ravel(), [mp for pair in pairs for mp in pair], titles)
    return figure


def steps(models: Sequence[MultiPatch], titles: Sequence[str]) -> Figure:
    """Fig. 12: upright models by scaled Jacobian in a row."""
    figure, axes = _sheet(1, len(models), extra=1.0, panel=(1.7, 4.0))
    _coloured(figure, axes.ravel(), models, titles)
    return figure


def _coloured(figure: Figure, axes: NDArray[np.object_], models: Sequence[MultiPatch], titles: Sequence[str]) -> None:
    for k, ax in enumerate(axes):
        if k < len(models):
            shown = draw_multipatch(ax, models[k], iso_lines=2)
        finish(ax, titles[k] if k < len(models) else None)
    assert shown is not None
    color_bar(figure, shown, axes.tolist())


def solutions(results: Sequence[PoissonResult], names: Sequence[str]) -> Figure:
    """Fig. 11: the exact solution above, the absolute error below."""
    figure, axes = _sheet(2, len(results), extra=0.6 * len(results))
    for column, (name, result) in enumerate(zip(names, results, strict=True)):
        mp = result.multipatch
        grids = [even_grid(mp, k) for k in range(len(mp))]
        points = [patch.grid(u, v) for patch, (u, v) in zip(mp.patches, grids, strict=True)]
        assert result.exact is not None
        exact = [result.exact(p[..., 0], p[..., 1]) for p in points]
        errors = [
            np.abs(e - result.field.grid(k, u, v)) for k, (e, (u, v)) in enumerate(zip(exact, grids, strict=True))
        ]
        signed = min(float(e.min()) for e in exact) < 0 < max(float(e.max()) for e in exact)
        for row, (values, colors) in enumerate(((exact, "RdBu_r" if signed else "viridis"), (errors, "magma_r"))):
            ax = axes[row, column]
            mappable = draw_field(ax, points, values, colors)
            draw_lines(ax, side_lines(mp), width=0.6)
            space = result.field.space
            kind = (
                f"degree {space.degree}, {space.shape[0]} × {space.shape[1]} points" if row == 0 else "absolute error"
            )
            title = f"{name}: {kind}"
            # A field's edges would be the panel's, and cut the outline.
            ax.use_sticky_edges = False
            finish(ax, title)
            ax.title.set_fontsize(8)
            bar = figure.colorbar(mappable, ax=ax, shrink=0.8, aspect=24, pad=0.02)
            bar.ax.ticklabel_format(scilimits=(-3, 4))
            bar.outline.set_visible(False)
            bar.ax.tick_params(length=0, labelsize=7, colors=INK)
            bar.ax.yaxis.get_offset_text().set_fontsize(7)
    return figure
