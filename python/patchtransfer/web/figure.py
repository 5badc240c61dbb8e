"""Pictures of a page: a model or a boundary with its layers, ready for the template."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from ..plot.palette import colours_of_patches
from .joint_labels import beside
from .picture import (
    Frame,
    Sampled,
    by_class,
    control_net,
    curve_lines,
    dots,
    frame,
    interface_lines,
    iso_lines,
    loops,
    model_loops,
    patch_outlines,
    sampled,
)

__all__ = ["Figure", "Mark", "Place", "boundary_figure", "layers", "model_figure", "worst_places"]

#: Places named as the worst of a picture.
WORST = 5
#: Bernstein polynomials of degree 3 at places along a piece, its end left to the next one.
_ALONG = np.array([[(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3] for t in np.arange(8) / 8])


class Mark(NamedTuple):
    """A point with a name; those of one `key` belong together across pictures."""

    key: str
    x: int
    y: int
    text: str
    hue: int = 0


class Place(NamedTuple):
    """A place of poor quality."""

    patch: int
    u: float
    v: float
    value: float
    point: tuple[float, float]


@dataclass(frozen=True)
class Figure:
    """A picture: path data by layer, in units of the view box."""

    name: str
    title: str
    alt: str
    view_box: str
    outline: str
    patches: list[tuple[int, str]] = field(default_factory=list)
    iso: list[tuple[int, str]] = field(default_factory=list)
    interfaces: list[tuple[int, str]] = field(default_factory=list)
    net: str = ""
    points: str = ""
    special: str = ""
    numbers: list[Mark] = field(default_factory=list)
    joints: list[Mark] = field(default_factory=list)
    matches: list[Mark] = field(default_factory=list)
    worst: list[Mark] = field(default_factory=list)


def model_figure(
    mp: MultiPatch,
    name: str,
    title: str,
    *,
    joints: FloatArray | None = None,
    matches: FloatArray | None = None,
    worst: bool = False,
    detail: bool = True,
    extras: bool = True,
) -> tuple[Figure, list[Place]]:
    """The picture of a multi-patch, and its worst places if asked for.

    Parameters
    ----------
    mp : MultiPatch
    name : str
        Of the picture in its page.
    title : str
    joints, matches : (n, 2) arrays, optional
        Points of the boundary that get a number, and that get a colour.
    worst : bool, default False
        Whether to mark the worst places.
    detail : bool, default True
        With iso-lines; without for small pictures.
    extras : bool, default True
        With control net and numbers, too, which a page shows on demand.
    """
    drawn, extras = sampled(mp), detail and extras
    in_frame = frame(np.concatenate([points.reshape(-1, 2) for points, _ in drawn.grids]))
    places = worst_places(drawn) if worst else []
    middles = [points[len(points) // 2, points.shape[1] // 2] for points, _ in drawn.grids]
    figure = Figure(
        name,
        title,
        f"{title}: {len(mp)} patches",
        in_frame.view_box,
        **layers(drawn, in_frame),
        iso=by_class(iso_lines(drawn), in_frame) if detail else [],
        net=control_net(mp, in_frame) if extras else "",
        points=dots(mp.topology.coordinates, in_frame) if extras else "",
        numbers=_marks(np.array(middles), in_frame, "patch") if extras else [],
        joints=_joints(joints, matches, mp.boundary, in_frame),
        matches=_matches(matches, in_frame),
        worst=[
            Mark(f"worst-{k + 1}", *_at(in_frame, place.point), f"scaled Jacobian {place.value:.3g}")
            for k, place in enumerate(places)
        ],
    )
    return figure, places


def layers(drawn: Sampled, in_frame: Frame) -> dict[str, Any]:
    """Path data of a multi-patch: its loops, patches with their colours, interfaces and extraordinary vertices."""
    mp = drawn.multipatch
    special = [v.point for v in mp.vertices if v.extraordinary]
    tints = colours_of_patches(len(mp), [(f.patch_a, f.patch_b) for f in mp.interfaces])
    return {
        "outline": model_loops(drawn, in_frame),
        "patches": list(zip(tints, patch_outlines(drawn, in_frame), strict=True)),
        "interfaces": by_class(interface_lines(drawn), in_frame),
        "special": dots(mp.topology.coordinates[special], in_frame),
    }


def boundary_figure(
    boundary: Boundary, name: str, title: str, joints: FloatArray | None = None, matches: FloatArray | None = None
) -> Figure:
    """The picture of a boundary; parameters as of `model_figure`."""
    pieces = np.concatenate([curve_lines(loop).pieces.reshape(-1, 2) for loop in boundary.loops])
    in_frame = frame(pieces)
    curves = sum(len(loop) for loop in boundary.loops)
    many = f"{len(boundary.loops)} loops, " if len(boundary.loops) > 1 else ""
    return Figure(
        name,
        title,
        f"{title}: {many}{curves} curves",
        in_frame.view_box,
        loops(boundary, in_frame),
        joints=_joints(joints, matches, lambda: boundary, in_frame),
        matches=_matches(matches, in_frame),
    )


def worst_places(drawn: Sampled, most: int = WORST) -> list[Place]:
    """Where the scaled Jacobian is smallest, a place a patch at most, the worst first."""
    found = []
    for k, (points, scaled) in enumerate(drawn.grids):
        i, j = np.unravel_index(int(np.argmin(scaled)), scaled.shape)
        u, v = (_parameter(knots, n, index) for knots, n, index in _axes(drawn, k, (int(i), int(j))))
        x, y = points[i, j].tolist()
        found.append(Place(k, u, v, float(scaled[i, j]), (x, y)))
    return sorted(found, key=lambda place: place.value)[:most]


def _axes(drawn: Sampled, k: int, index: tuple[int, int]) -> list[tuple[FloatArray, int, int]]:
    return [(knots, 3 * drawn.pieces + 1, i) for knots, i in zip(drawn.multipatch.patches[k].knots, index, strict=True)]


def _parameter(knots: FloatArray, samples: int, index: int) -> float:
    """Of a sample that was taken span by span."""
    breaks = np.unique(knots)
    span, within = divmod(index, samples)
    return float(breaks[span] + (breaks[span + 1] - breaks[span]) * within / (samples - 1))


def _at(in_frame: Frame, point: tuple[float, float] | FloatArray) -> tuple[int, int]:
    x, y = in_frame(np.asarray(point, float)).tolist()
    return x, y


def _marks(points: FloatArray, in_frame: Frame, kind: str) -> list[Mark]:
    return [Mark(f"{kind}-{k}", *_at(in_frame, point), str(k)) for k, point in enumerate(points)]


def _joints(
    points: FloatArray | None, matches: FloatArray | None, boundary: Callable[[], Boundary], in_frame: Frame
) -> list[Mark]:
    """The joints' numbers where there is room for them."""
    if points is None or not len(points):
        return []
    outlines = [curve_lines(loop).pieces for loop in boundary().loops]
    # Points of the Bézier pieces, not of their control polygons.
    sampled_loops = [np.einsum("kb,nbd->nkd", _ALONG, pieces).reshape(-1, 2) for pieces in outlines]
    marks = np.empty((0, 2)) if matches is None else matches
    middles = beside(points, sampled_loops, marks, in_frame).astype(int).tolist()
    return [Mark(f"joint-{k}", x, y, str(k)) for k, (x, y) in enumerate(middles)]


def _matches(points: FloatArray | None, in_frame: Frame) -> list[Mark]:
    """Points of one colour in both pictures: its hue goes around once."""
    if points is None:
        return []
    n = len(points)
    return [Mark(f"match-{k}", *_at(in_frame, p), f"point {k}", round(360 * k / n)) for k, p in enumerate(points)]
