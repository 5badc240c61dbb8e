"""Figures of continuity: where interfaces are C1, and how control polygons bend across them (Fig. 10 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..continuity.interfaces import control_rows
from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.topology import BoundarySide
from ..measure.smooth_spans import c1_share, smooth_spans
from ..numeric.arrays import FloatArray
from .drawing import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["c1_spans", "slope_difference", "slope_differences"]

BEFORE, AFTER, GRID = "#c8102e", "#1f5fbf", "#d9d9d9"
#: Panels drawn when no interfaces are named.
PANELS = 6
#: Points that a knot span is drawn with.
POINTS = 17


def slope_differences(mp: MultiPatch) -> list[FloatArray]:
    """Angle in degrees between L_j - s_j and s_j - R_j for every control point s_j of every interface.

    L_j and R_j are the control points beside s_j in the patches on either side; NaN where one of them is s_j itself.
    Along an interface the order is that of side a of the interface.
    """
    points, found = mp.topology.coordinates, []
    for r, directed in zip(control_rows(mp.topology), mp.topology.directed_interfaces, strict=True):
        u, v = points[r.curve] - points[r.left], points[r.right] - points[r.curve]
        angle = np.degrees(np.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1)))
        angle[(np.hypot(*u.T) == 0) | (np.hypot(*v.T) == 0)] = np.nan
        found.append(np.abs(angle[::-1] if directed.reversed else angle))
    return found


def slope_difference(before: MultiPatch, after: MultiPatch, interfaces: Sequence[int] | None = None) -> Figure:
    """Draw how much slopes differ on the two sides of interfaces, as Fig. 10 of the paper.

    The paper takes differences of slopes; angles are drawn here, which do not blow up where a polygon is vertical.

    Parameters
    ----------
    before, after : MultiPatch
        The same patches and interfaces, without (red) and with (blue) continuity rows.
    interfaces : sequence of int, optional
        Which to draw; by default the six whose control polygons bend most in `before`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        When the models' interfaces differ, there are none, or an interface does not exist.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> before, after = (pt.transfer(source, target, landmarks, continuity=kind).multipatch for kind in ("c0", "c1"))
    >>> len(pt.plot.slope_difference(before, after, [0, 1]).axes)
    2
    """
    if before.interfaces != after.interfaces or not before.interfaces:
        raise InputError("slope differences need two multi-patches with the same interfaces, and at least one")
    red, blue = slope_differences(before), slope_differences(after)
    if interfaces is None:
        mean = np.array([np.nanmean(angles) if np.isfinite(angles).any() else 0.0 for angles in red])
        interfaces = np.sort(np.argsort(-mean, kind="stable")[:PANELS]).tolist()
    missing = [i for i in interfaces if not 0 <= i < len(red)]
    if missing or not len(interfaces):
        raise InputError(f"interface {missing[0] if missing else '(none)'} does not exist; there are {len(red)}")
    columns = min(3, len(interfaces))
    rows = -(-len(interfaces) // columns)
    figure = new_figure((3.1 * columns + 0.6, 2.3 * rows + 0.5))
    top = max(1.0, *(float(np.nanmax(side[i], initial=0.0)) for side in (red, blue) for i in interfaces))
    for k, index in enumerate(interfaces):
        ax = figure.add_subplot(rows, columns, k + 1)
        for angles, colour, marker, label in ((red, BEFORE, "o", "without rows"), (blue, AFTER, "s", "with rows")):
            j = np.arange(len(angles[index])) + 1
            ax.plot(j, angles[index], marker=marker, ms=4, lw=0.8, color=colour, label=label, clip_on=False)
        ax.set_title(before.interfaces[index].name, fontsize=8.5)
        ax.set_ylim(0, 1.05 * top)
        ax.set_xticks(np.unique(np.linspace(1, len(red[index]), min(6, len(red[index]))).astype(int)))
        ax.grid(axis="y", color=GRID, lw=0.5)
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=8, length=2)
        if k % columns == 0:
            ax.set_ylabel("slope difference (°)", fontsize=8.5)
        if k // columns == rows - 1:
            ax.set_xlabel("control point of the interface", fontsize=8.5)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure


def c1_spans(mp: MultiPatch) -> Figure:
    """Draw on which knot spans of its interfaces a multi-patch is C1 (blue) and on which not (red).

    Parameters
    ----------
    mp : MultiPatch

    Returns
    -------
    matplotlib.figure.Figure
        Titled with the share of C1; see `ContinuityReport`.

    Examples
    --------
    >>> from patchtransfer import examples
    >>> c1_spans(examples.load("star")[0]).axes[0].get_title()
    "C1 on 0.00 of the interfaces' length"
    """
    spans = smooth_spans(mp)
    figure = new_figure((6, 6))
    from matplotlib.collections import LineCollection

    ax = figure.add_subplot()
    outline = [curve(np.linspace(*curve.domain, POINTS * 4)) for loop in mp.boundary().loops for curve in loop]
    ax.add_collection(LineCollection(outline, colors="black", linewidths=0.9))
    for wanted, colour, label in ((True, AFTER, "C1"), (False, BEFORE, "not C1")):
        lines = []
        for f, found in zip(mp.interfaces, spans, strict=True):
            curve = BoundarySide(f.patch_a, f.side_a, False).curve(mp.patches)
            ends = zip(found.breaks[:-1], found.breaks[1:], found.smooth, strict=True)
            lines += [curve(np.linspace(low, high, POINTS)) for low, high, smooth in ends if smooth == wanted]
        ax.add_collection(LineCollection(lines, colors=colour, linewidths=1.8, label=label))
    ax.autoscale()
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set_title(f"C1 on {c1_share(spans):.2f} of the interfaces' length", fontsize=10)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure
