"""SVG: every closed subpath is a boundary loop.

Lines and Bézier segments are taken over exactly. An elliptical arc becomes one C¹ cubic with double inner
knots whose pieces turn by at most 0.28 rad: the radial error of the usual cubic with tangent length (4/3)
tan(θ/4) is about (2/27) (θ/4)⁶ of the radius, below 1e-8. The y axis is flipped, so that pictures are
upright. Transforms of elements and of all groups around them are applied to the control points.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..limits import MAX_CURVES, MAX_LOOPS, at_most
from ..numeric.arrays import FloatArray
from .loops import TOLERANCE, close_loop
from .options import DEFAULT, BoundaryOptions
from .safe_xml import local_name, parse_xml

__all__ = ["read_boundary"]

ARC_STEP = 0.28
#: Segments shorter than this (relative to the diameter) are rounding left-overs of closing commands.
NEGLIGIBLE = 1e-9

#: What can make a segment of a path: a number, or a closing command.
ENTRIES = re.compile(r"[0-9]+|[zZ]")
#: Most of a path: a segment has up to seven numbers, with digits before and after the point.
MAX_ENTRIES = 14 * MAX_CURVES

CONTAINERS = ("g", "a", "switch")
REFUSED = {"use": "replace it by the shape it refers to", "svg": "move its shapes into the outer one"}

Segment = tuple[FloatArray, int, FloatArray]
"""Knots, degree and control points of a path segment."""


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of an SVG picture; see `patchtransfer.read_boundary`."""
    root = parse_xml(data)
    if local_name(root) != "svg":
        raise InputError(f"the root element is <{local_name(root)}>, not <svg>; save the picture as plain SVG")
    subpaths: list[tuple[str, list[Segment]]] = []
    count = 0
    for number, (shape, matrix) in enumerate(_shapes(root), 1):
        name = f"<{local_name(shape)}> {shape.get('id') or 'number ' + str(number)}"
        for k, segments in enumerate(_segments(shape, name)):
            placed = [(knots, p, _place(c, matrix)) for knots, p, c in segments]
            # Squares must not overflow; the comparison also refuses NaN.
            if not all((np.abs(c) <= 1e150).all() for _, _, c in placed):
                raise InputError(f"{name}: NaN, infinity or a number above 1e150; correct it")
            subpaths.append((name if k == 0 else f"{name}, subpath {k + 1}", placed))
            count += len(placed)
            at_most(count, MAX_CURVES, "path segments", "simplify the paths")
            at_most(len(subpaths), MAX_LOOPS, "subpaths and shapes", "keep those of the domain")
    points = [c for _, segments in subpaths for _, _, c in segments]
    if not points:
        raise InputError("holds no closed path; draw the outline as <path> or a shape (text and images are ignored)")
    size = float(np.linalg.norm(np.ptp(np.concatenate(points), axis=0)))
    return Boundary([_loop(name, segments, size) for name, segments in subpaths])


def _shapes(root: Element) -> Iterator[tuple[Element, FloatArray]]:
    """Visible shapes in document order with the transforms of all their groups."""
    # Imported here: it is slow to load, and only pictures need it.
    from svgpathtools.document import CONVERSIONS
    from svgpathtools.parser import parse_transform

    # Not by recursion: programs nest groups, and files may do so thousands deep.
    stack = [(iter(root), np.eye(3))]
    while stack:
        children, matrix = stack[-1]
        child = next(children, None)
        if child is None:
            stack.pop()
            continue
        kind = local_name(child)
        if kind not in CONVERSIONS and kind not in CONTAINERS and kind not in REFUSED:
            continue
        name = f"<{kind}> {child.get('id') or ''}".rstrip()
        if kind in REFUSED:
            raise InputError(f"{name}: nested or referenced content is not supported; {REFUSED[kind]}")
        if "transform" in child.get("style", ""):
            raise InputError(f"{name}: a transform in a style is not supported; use the attribute transform")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                own = np.asarray(parse_transform(child.get("transform")))
            except (ValueError, TypeError, IndexError, Warning) as error:
                raise InputError(f"{name}: cannot read its transform ({error}); correct it") from None
        with np.errstate(over="ignore", invalid="ignore"):
            placed = matrix @ own
        if kind in CONTAINERS:
            stack.append((iter(child), placed))
        else:
            yield child, placed


def _segments(shape: Element, name: str) -> list[list[Segment]]:
    """Subpaths of a shape in its own coordinates; none for an empty one."""
    from svgpathtools.document import CONVERSIONS
    from svgpathtools.parser import parse_path

    try:
        with warnings.catch_warnings(), np.errstate(divide="raise", over="raise", invalid="raise"):
            # An arc without a radius is a line, by the standard; the library says so on standard error.
            warnings.simplefilter("ignore")
            text = CONVERSIONS[local_name(shape)](shape)
            # Before they are parsed, which takes thousands of bytes for each.
            at_most(sum(1 for _ in ENTRIES.finditer(text)), MAX_ENTRIES, f"numbers in {name}", "simplify it")
            path = parse_path(text)
            runs = path.continuous_subpaths() if len(path) else []
            return [[_segment(s) for s in run if s.start != s.end or len(s.bpoints()) > 2] for run in runs]
    except (ValueError, TypeError, LookupError, ArithmeticError, AssertionError, AttributeError) as error:
        what = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"{name}: cannot read its geometry ({what}); correct it") from None


def _segment(segment: Any) -> Segment:
    from svgpathtools import Arc

    if isinstance(segment, Arc):
        return _arc(segment)
    points = np.array([[z.real, z.imag] for z in segment.bpoints()])
    p = len(points) - 1
    return np.repeat([0.0, 1.0], p + 1), p, points


def _arc(arc: Any) -> Segment:
    delta, first = math.radians(arc.delta), math.radians(arc.theta)
    n = max(1, math.ceil(abs(delta) / ARC_STEP))
    phi = np.exp(1j * (first + delta * np.arange(n + 1) / n))
    k = 4 / 3 * math.tan(delta / n / 4)
    inner = np.column_stack([phi[:-1] * (1 + 1j * k), phi[1:] * (1 - 1j * k)]).ravel()
    unit = np.concatenate([phi[:1], inner, phi[-1:]])
    z = (arc.radius.real * unit.real + 1j * arc.radius.imag * unit.imag) * np.exp(1j * math.radians(arc.rotation))
    z += arc.center
    z[0], z[-1] = arc.start, arc.end
    knots = np.concatenate([np.zeros(4), np.repeat(np.arange(1, n) / n, 2), np.ones(4)])
    return knots, 3, np.column_stack([z.real, z.imag])


def _place(points: FloatArray, matrix: FloatArray) -> FloatArray:
    with np.errstate(over="ignore", invalid="ignore"):
        moved = points[:, :1] * matrix[:2, 0] + points[:, 1:] * matrix[:2, 1] + matrix[:2, 2]
    # Not -y, which would write zeros as -0.0.
    return np.column_stack([moved[:, 0], 0.0 - moved[:, 1]])


def _loop(name: str, segments: list[Segment], size: float) -> list[BSplineCurve]:
    try:
        curves = [
            BSplineCurve(knots, p, c)
            for knots, p, c in segments
            if not np.linalg.norm(np.ptp(c, axis=0)) <= NEGLIGIBLE * size
        ]
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    if not curves:
        raise InputError(f"{name} has no length; delete it")
    gap = float(np.linalg.norm(curves[-1].end - curves[0].start))
    if gap > TOLERANCE * size:
        raise InputError(f"{name} is open, its ends are {gap:.3g} apart; close the path")
    return close_loop(curves)
