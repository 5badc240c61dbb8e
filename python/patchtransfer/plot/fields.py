"""Figures of fields on multi-patches: a solution and its error side by side (Fig. 11 of the paper)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..geometry.basis import knot_spans
from ..geometry.multipatch import MultiPatch
from ..iga import PoissonResult
from ..numeric.arrays import FloatArray
from .drawing import INK, draw_lines, finish, panels, side_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

__all__ = ["draw_field", "even_grid", "solution"]

#: Values of the other sign that are rounding, relative to the largest.
ROUNDING = 1e-6
#: Intervals of the drawn grid per patch and direction, at least.
INTERVALS = 48


def solution(result: PoissonResult, titles: tuple[str, str] = ("solution", "absolute error")) -> Figure:
    """Draw a solution and its absolute error side by side, without a known solution the solution alone.

    Parameters
    ----------
    result : PoissonResult
    titles : pair of str, optional

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, _, _ = pt.examples.load("star")
    >>> figure = pt.plot.solution(pt.iga.poisson(source, degree=4, points=8))
    >>> [ax.get_title() for ax in figure.axes[:2]]
    ['solution', 'absolute error']
    """
    mp = result.multipatch
    grids = [even_grid(mp, k) for k in range(len(mp))]
    points = [patch.grid(u, v) for patch, (u, v) in zip(mp.patches, grids, strict=True)]
    values = [result.field.grid(k, u, v) for k, (u, v) in enumerate(grids)]
    low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
    both = low < -ROUNDING * high and high > -ROUNDING * low
    layers = [(titles[0], "RdBu_r" if both else "viridis", values)]
    if result.exact is not None:
        errors = [np.abs(result.exact(p[..., 0], p[..., 1]) - u) for p, u in zip(points, values, strict=True)]
        layers.append((titles[1], "magma_r", errors))
    figure, axes = panels([np.concatenate(side_lines(mp))] * len(layers), 1.6 * len(layers))
    for ax, (title, colors, layer) in zip(axes, layers, strict=True):
        mappable = draw_field(ax, points, layer, colors)
        draw_lines(ax, side_lines(mp), width=0.9)
        finish(ax, title)
        bar = figure.colorbar(mappable, ax=ax, shrink=0.8, aspect=28, pad=0.02)
        bar.ax.ticklabel_format(scilimits=(-3, 4))
        bar.outline.set_visible(False)
        bar.ax.tick_params(length=0, labelsize=9, colors=INK)
    return figure


def even_grid(mp: MultiPatch, k: int) -> tuple[FloatArray, FloatArray]:
    """Even parameters that contain the knots."""
    u, v = (
        np.unique(np.linspace(b[:-1], b[1:], -(-INTERVALS // (len(b) - 1)) + 1))
        for b in (knot_spans(knots) for knots in mp.patches[k].knots)
    )
    return u, v


def draw_field(ax: Axes, points: list[FloatArray], values: list[FloatArray], colors: str) -> ScalarMappable:
    """Shaded patches on one scale, symmetric about zero where the values have both signs."""
    from matplotlib.colors import Normalize

    low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
    if colors == "RdBu_r":
        low, high = -max(-low, high), max(-low, high)
    norm = Normalize(low, high)
    for p, v in zip(points, values, strict=True):
        # Rasterised: a vector picture of this many cells would be tens of megabytes.
        mesh = ax.pcolormesh(p[..., 0], p[..., 1], v, cmap=colors, norm=norm, shading="gouraud", rasterized=True)
    return mesh
