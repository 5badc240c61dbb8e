"""Picture of the map between two models of one layout: its dilatation, and what becomes of small circles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..geometry.basis import knot_spans
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..measure.common_layout import common_layout
from ..numeric.arrays import FloatArray
from .drawing import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["dilatation"]

INK = "#1b1b1b"
#: Colours a span and direction, and corners of a drawn ellipse.
FINE, CORNERS = 8, 40
#: Radius of the circles, of the square root of the area that a span has in the mean.
RADIUS = 0.3


def dilatation(a: MultiPatch, b: MultiPatch, title: str | None = None) -> Figure:
    """Draw the dilatation of the map from `a` to `b` on `b`, with the ellipses that it makes of circles.

    Parameters
    ----------
    a, b : MultiPatch
        Of one layout, as for `similarity`.
    title : str, optional

    Returns
    -------
    matplotlib.figure.Figure
        Colours are log D, 0 where the map is conformal. Ellipses are of one area: the ratio of their axes is D, and the
        long one points where the map stretches most.

    Raises
    ------
    InputError
        When the models are not of one layout.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> result = pt.transfer(source, target, landmarks, continuity="c0")
    >>> figure = pt.plot.dilatation(source, result.multipatch)
    >>> figure.axes[1].get_ylabel()
    'log of the dilatation'
    """
    a, b = common_layout(a, b)
    fields = [
        _field(p, q, _between(p, 0, FINE), _between(p, 1, FINE)) for p, q in zip(a.patches, b.patches, strict=True)
    ]
    middles = [_field(p, q, _between(p, 0, 1), _between(p, 1, 1)) for p, q in zip(a.patches, b.patches, strict=True)]
    figure = new_figure((7.2, 5.6))
    from matplotlib.collections import PolyCollection

    ax = figure.add_subplot()
    top = max(float(np.nanmax(values, where=np.isfinite(values), initial=1e-6)) for _, _, values in fields)
    mesh = None
    for patch in range(len(b)):
        corners = b.patches[patch].grid(_edges(b.patches[patch], 0), _edges(b.patches[patch], 1))
        mesh = ax.pcolormesh(corners[..., 0], corners[..., 1], fields[patch][2], cmap="viridis_r", vmin=0, vmax=top)
    size = RADIUS * np.sqrt(_area(b) / sum(points.shape[0] * points.shape[1] for points, _, _ in middles))
    shapes = np.concatenate([_ellipses(points, jacobian, size) for points, jacobian, _ in middles])
    ax.add_collection(PolyCollection(list(shapes), facecolors="white", edgecolors=INK, linewidths=0.7))
    for loop in b.loops:
        for side in loop:
            curve = side.curve(b.patches)
            ax.plot(*curve(np.linspace(*curve.domain, 60)).T, color=INK, lw=1.4)
    for f in b.interfaces:
        curve = b.topology.directed_side(f.patch_a, f.side_a).curve(b.patches)
        ax.plot(*curve(np.linspace(*curve.domain, 40)).T, color=INK, lw=0.5)
    ax.set_aspect("equal")
    ax.set_axis_off()
    if title is not None:
        ax.set_title(title, fontsize=10)
    if mesh is not None:
        figure.colorbar(mesh, ax=ax, shrink=0.7, label="log of the dilatation")
    return figure


def _edges(patch: Patch, axis: int) -> FloatArray:
    breaks = knot_spans(patch.knots[axis])
    return np.unique(np.linspace(breaks[:-1], breaks[1:], FINE + 1))


def _between(patch: Patch, axis: int, parts: int) -> FloatArray:
    """Middles of equal parts of all spans."""
    breaks = knot_spans(patch.knots[axis])
    ends = np.linspace(breaks[:-1], breaks[1:], parts + 1)
    return ((ends[1:] + ends[:-1]) / 2).T.ravel()


def _field(a: Patch, b: Patch, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points of `b` (m, n, 2), Jacobian of the map there (m, n, 2, 2), and log D (m, n)."""
    (s, t), points = ((p.jacobian(u[:, None], v) for p in (a, b)), b.grid(u, v))
    det = s[..., 0, 0] * s[..., 1, 1] - s[..., 0, 1] * s[..., 1, 0]
    adjugate = np.stack(
        [np.stack([s[..., 1, 1], -s[..., 0, 1]], -1), np.stack([-s[..., 1, 0], s[..., 0, 0]], -1)], axis=-2
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        jacobian = np.einsum("...ij,...jk->...ik", t, adjugate) / det[..., None, None]
        half = (jacobian**2).sum(axis=(-2, -1)) / 2
        area = jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0]
        values = np.where(area > 0, np.arccosh(np.maximum(half / area, 1.0)), np.nan)
    return points, jacobian, values


def _ellipses(points: FloatArray, jacobian: FloatArray, size: float) -> FloatArray:
    """Images of circles (k, corners, 2), scaled to one area."""
    angle = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    area = np.abs(jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        images = size * np.einsum("...ij,jk->...ki", jacobian / np.sqrt(area)[..., None, None], circle)
    return np.asarray((points[..., None, :] + images).reshape(-1, CORNERS, 2))


def _area(mp: MultiPatch) -> float:
    total = 0.0
    for loop in mp.loops:
        points = np.concatenate([(c := side.curve(mp.patches))(np.linspace(*c.domain, 20))[:-1] for side in loop])
        x, y = points.T
        total += float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)
    return total
