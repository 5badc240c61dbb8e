"""Multi-patches and boundaries as paths of an SVG picture, iso-lines as cubic Béziers by class of quality.

A polynomial of degree 3 or less is its own Bézier curve between two knots, so that such lines are exact however far one
looks into the picture; others are interpolated at thirds of pieces that are short on the screen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..geometry.basis import knot_spans
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.multipatch import MultiPatch
from ..measure.quality import sample
from ..numeric.arrays import FloatArray, IntArray
from ..plot.palette import CLASSES

__all__ = [
    "Frame",
    "Lines",
    "Sampled",
    "by_class",
    "class_of",
    "control_net",
    "curve_lines",
    "dots",
    "frame",
    "interface_lines",
    "iso_lines",
    "loops",
    "model_loops",
    "patch_outlines",
    "path",
    "sampled",
]

#: Units across a picture: a tenth of a pixel when a picture of 500 pixels is enlarged eightfold.
UNITS = 40_000
#: White around a picture, in units.
MARGIN = UNITS // 40
#: Iso-lines inside a patch and direction are about so many, fewer where there are many patches.
INSIDE, LINES_IN_ALL = 12, 36
#: Pieces of a knot span that is no cubic: an eighth of a quarter circle is 3e-6 of the radius off.
PER_SPAN = 8
#: From four points at thirds to the Bézier points of the cubic through them.
_THROUGH = np.array([[6, 0, 0, 0], [-5, 18, -9, 2], [2, -9, 18, -5], [0, 0, 0, 6]]) / 6
#: From Bézier points of degree 1, 2 and 3 to those of degree 3.
_ELEVATE = {
    1: np.array([[3, 0], [2, 1], [1, 2], [0, 3]]) / 3,
    2: np.array([[3, 0, 0], [1, 2, 0], [0, 2, 1], [0, 0, 3]]) / 3,
    3: np.eye(4),
}


class Frame(NamedTuple):
    """How the plane becomes a picture: x to the right from `left`, y down from `top`, `scale` units a length."""

    left: float
    top: float
    scale: float
    width: int
    height: int

    def __call__(self, points: FloatArray) -> IntArray:
        """Points (..., 2) in the picture's units."""
        return np.rint((points - [self.left, self.top]) * [self.scale, -self.scale]).astype(np.int64) + MARGIN

    def inverse(self, units: FloatArray) -> FloatArray:
        """Points of the plane from units (..., 2)."""
        return np.asarray((units - MARGIN) / [self.scale, -self.scale] + [self.left, self.top])

    @property
    def view_box(self) -> str:
        """Of the SVG element."""
        return f"0 0 {self.width} {self.height}"


def frame(outline: FloatArray) -> Frame:
    """The frame of a picture that shows points (n, 2)."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    width, height = (high - low).tolist()
    scale = (UNITS - 2 * MARGIN) / (max(width, height) or 1.0)
    size = [round(scale * s) + 2 * MARGIN for s in (width, height)]
    return Frame(float(low[0]), float(high[1]), scale, size[0], size[1])


class Lines(NamedTuple):
    """Pieces of curves.

    Attributes
    ----------
    pieces : (n, 4, 2) array
        Control points of cubic Béziers.
    follows : (n,) bool array
        Whether a piece goes on from the one before.
    values : (n,) array
        The smallest scaled Jacobian on the piece.
    """

    pieces: FloatArray
    follows: np.ndarray
    values: FloatArray


def class_of(values: FloatArray) -> IntArray:
    """Which class of `CLASSES` scaled Jacobians belong to: 0 what is not positive, up to len(CLASSES)."""
    return np.asarray(np.searchsorted(CLASSES, values, side="left"))


class Sampled(NamedTuple):
    """A multi-patch with points and scaled Jacobians of every patch, `pieces` of three intervals a knot span."""

    multipatch: MultiPatch
    grids: list[tuple[FloatArray, FloatArray]]
    pieces: int


def sampled(mp: MultiPatch, lines: int = INSIDE) -> Sampled:
    """What a multi-patch is drawn from, with about so many lines inside a patch and direction at most."""
    spans = max(len(knot_spans(knots)) - 1 for patch in mp.patches for knots in patch.knots)
    inside = min(lines, max(4, round(LINES_IN_ALL / math.sqrt(len(mp.patches)))))
    pieces = max(1, round(inside / spans))
    return Sampled(mp, sample(mp, 3 * pieces + 1), pieces)


def iso_lines(drawn: Sampled) -> Lines:
    """Iso-parametric lines inside the patches."""
    found = []
    for points, scaled in drawn.grids:
        for p, s in ((points, scaled), (points.swapaxes(0, 1), scaled.T)):
            # The line at a knot is sampled from both spans: the later one is drawn.
            rows = np.arange(len(p)).reshape(-1, 3 * drawn.pieces + 1)[:, : 3 * drawn.pieces : 3].ravel()[1:]
            found.append((p[rows], s[rows]))
    return _through(found, drawn.pieces)


def interface_lines(drawn: Sampled) -> Lines:
    """Interfaces, each once, in the worse colour of both sides where they are sampled alike."""
    found = []
    for face in drawn.multipatch.interfaces:
        points, scaled = drawn.grids[face.patch_a]
        here, there = face.side_a.of(scaled), face.side_b.of(drawn.grids[face.patch_b][1])
        if len(here) == len(there):
            here = np.minimum(here, there[::-1] if face.reversed else there)
        found.append((face.side_a.of(points)[None], here[None]))
    return _through(found, drawn.pieces)


def patch_outlines(drawn: Sampled, in_frame: Frame) -> list[str]:
    """Path data of every patch's four sides, closed."""
    around = [
        np.concatenate([points[:, 0], points[-1], points[::-1, -1], points[0, ::-1]])[None] for points, _ in drawn.grids
    ]
    lines = _through([(points, np.ones(points.shape[:2])) for points in around], drawn.pieces)
    units = in_frame(lines.pieces)
    ends = np.append(np.flatnonzero(~lines.follows), len(units))
    return [f"{_data(units[i:j], lines.follows[i:j])}z" for i, j in pairwise(ends.tolist())]


def model_loops(drawn: Sampled, in_frame: Frame) -> str:
    """Path data of a multi-patch's boundary loops, closed."""
    out = []
    for loop in drawn.multipatch.topology.loops:
        sides = [side.side.of(drawn.grids[side.patch][0])[:: -1 if side.reversed else 1] for side in loop]
        points = np.concatenate(sides)[None]
        out.append(path(_through([(points, np.ones(points.shape[:2]))], drawn.pieces), in_frame, closed=True))
    return "".join(out)


def curve_lines(curves: Iterable[BSplineCurve]) -> Lines:
    """Curves that follow each other, as a loop of a boundary does."""
    found = []
    for curve in curves:
        if curve.degree <= 3 and curve.weights is None and len(curve.control_points) == curve.degree + 1:
            # A Bézier curve as it is.
            found.append(np.einsum("ij,jk->ik", _ELEVATE[curve.degree], curve.control_points)[None])
            continue
        breaks = knot_spans(curve.knots)
        per_span = 1 if curve.degree <= 3 and curve.weights is None else PER_SPAN
        # From inside every span, so that corners at knots stay sharp.
        t = np.linspace(breaks[:-1], breaks[1:], 3 * per_span + 1)
        points = curve(t.T.ravel())[None]
        found.append(_through([(points, np.ones(points.shape[:2]))], per_span).pieces)
    pieces = np.concatenate(found)
    return Lines(pieces, np.arange(len(pieces)) > 0, np.ones(len(pieces)))


def _through(lines: Sequence[tuple[FloatArray, FloatArray]], pieces: int) -> Lines:
    """Pieces of lines (l, n, 2) with values (l, n), all sampled span by span: in one go, for there are thousands."""
    if not lines:
        return Lines(np.empty((0, 4, 2)), np.empty(0, bool), np.empty(0))
    samples = 3 * pieces + 1
    points = np.concatenate([p.reshape(-1, samples, 2) for p, _ in lines])
    values = np.concatenate([v.reshape(-1, samples) for _, v in lines])
    # Numbers of lines' first spans.
    spans = np.concatenate([np.full(len(p), p.shape[1] // samples) for p, _ in lines])
    first = np.cumsum(spans) - spans
    windows = np.arange(0, 3 * pieces, 3)[:, None] + np.arange(4)
    follows = np.ones((len(points), pieces), bool)
    follows[first, 0] = False
    curves = np.einsum("ij,spjk->spik", _THROUGH, points[:, windows])
    return Lines(curves.reshape(-1, 4, 2), follows.ravel(), values[:, windows].min(axis=2).ravel())


def by_class(lines: Lines, in_frame: Frame) -> list[tuple[int, str]]:
    """Path data of lines, class by class, the best first: the worst are drawn on top."""
    units, kinds = in_frame(lines.pieces), class_of(lines.values)
    out = []
    for kind in sorted(set(kinds.tolist()), reverse=True):
        chosen = np.flatnonzero(kinds == kind)
        follows = lines.follows[chosen]
        follows[1:] &= chosen[1:] == chosen[:-1] + 1
        follows[:1] = False
        out.append((kind, _data(units[chosen], follows)))
    return out


def path(lines: Lines, in_frame: Frame, closed: bool = False) -> str:
    """Path data of lines in one colour."""
    return _data(in_frame(lines.pieces), lines.follows) + ("z" if closed else "")


def _data(units: IntArray, follows: np.ndarray) -> str:
    """Path data: relative numbers are short."""
    before = units[:, 0].copy()
    # To where the last piece ends, which is where this one begins but for rounding.
    before[1:][follows[1:]] = units[:-1, 3][follows[1:]]
    steps = (units[:, 1:] - before[:, None]).reshape(-1, 6).tolist()
    out = []
    for first, step, goes_on in zip(units[:, 0].tolist(), steps, follows.tolist(), strict=True):
        curve = f"c{' '.join(map(str, step))}"
        out.append(curve if goes_on else f"M{first[0]} {first[1]}{curve}")
    # A minus separates as well as a blank does.
    return "".join(out).replace(" -", "-")


def dots(points: FloatArray, in_frame: Frame) -> str:
    """Path data of points: lines of no length, whose round caps keep their size when one looks closer."""
    return "".join(f"M{x} {y}h0" for x, y in in_frame(np.reshape(points, (-1, 2))).tolist())


def control_net(mp: MultiPatch, in_frame: Frame) -> str:
    """Path data of the control nets' lines."""
    out = []
    for patch in mp.patches:
        net = in_frame(patch.control_points)
        for lines in (net, net.swapaxes(0, 1)):
            for line in lines.tolist():
                out.append("M" + "L".join(f"{x} {y}" for x, y in line))
    return "".join(out)


def loops(boundary: Boundary, in_frame: Frame) -> str:
    """Path data of a boundary's loops, closed."""
    return "".join(path(curve_lines(loop), in_frame, closed=True) for loop in boundary.loops)
