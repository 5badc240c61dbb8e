"""What the pictures of the stages are put together from: axes in a row, models, meshes, outlines, small shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

import patchtransfer as pt
from patchtransfer.plot.palette import LIGHT

INK, GREY = "#1b1b1b", "#9aa1a6"
BLUE, RED = LIGHT.anchors[7], LIGHT.folded


def row(count: int, size: tuple[float, float], **options: object) -> tuple[Figure, list[Axes]]:
    """Axes side by side, without frames."""
    figure = Figure(figsize=size, layout="constrained")
    axes = list(figure.subplots(1, count, squeeze=False, **options)[0])
    for ax in axes:
        ax.set_aspect("equal")
        ax.set_axis_off()
    return figure, axes


def named(ax: Axes, title: str) -> None:
    """A title, no legend."""
    ax.set_title(title, fontsize=9.5, color=INK, pad=4)
    if legend := ax.get_legend():
        legend.remove()


def model(ax: Axes, mp: pt.MultiPatch, title: str, **options: object) -> None:
    """Iso-lines coloured by scaled Jacobian, if nothing else is said."""
    pt.plot.multipatch(mp, ax, colorbar=False, **options)
    named(ax, title)


def outline(ax: Axes, target: pt.Boundary, title: str) -> None:
    """Curves, joints as dots."""
    pt.plot.boundary(target, ax)
    named(ax, title)


def mesh(ax: Axes, points: np.ndarray, triangles: np.ndarray, title: str) -> None:
    """Triangles, flipped ones filled."""
    ax.triplot(*points.T, triangles, color=BLUE, lw=0.35)
    corners = points[triangles]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    flipped = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] <= 0
    ax.add_collection(PolyCollection(corners[flipped], fc=RED, ec=RED, lw=0.5, zorder=3))
    named(ax, title)


def zoom(ax: Axes, centre: Sequence[float], half: float) -> None:
    """Show a square only, in a thin frame."""
    ax.set(xlim=(centre[0] - half, centre[0] + half), ylim=(centre[1] - half, centre[1] + half))
    ax.set_axis_on()
    ax.set(xticks=[], yticks=[])
    for spine in ax.spines.values():
        spine.set(color=GREY, lw=0.8, visible=True)


def polygon(*points: tuple[float, float]) -> pt.Boundary:
    """An outline with corners."""
    return pt.Boundary.from_points(points)


def quad(a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float) -> pt.MultiPatch:
    """A bilinear patch by its corners, counter-clockwise."""
    knots = [0, 0, 1, 1]
    return pt.MultiPatch([pt.Patch((knots, knots), (1, 1), [[[a, b], [g, h]], [[c, d], [e, f]]])], [])


def bent(points: np.ndarray, degrees: float) -> np.ndarray:
    """A shape that stands upright, bent to an arc."""
    middle, size = points.mean(axis=0), np.ptp(points[:, 1])
    radius = size / np.radians(degrees)
    angle = (points[:, 1] - middle[1]) / radius
    distance = radius + points[:, 0] - middle[0]
    return np.column_stack([distance * np.cos(angle), distance * np.sin(angle)])
