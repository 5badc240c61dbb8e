"""SVG: paths and shapes as segments, in their own coordinates.

Lines and Bézier segments are taken over exactly. An elliptical arc becomes one C¹ cubic with double inner knots whose
pieces turn by at most 0.28 rad: the radial error of the usual cubic with tangent length (4/3) tan(θ/4) is about
(2/27) (θ/4)⁶ of the radius, below 1e-8.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InputError
from ..limits import MAX_CURVES, at_most
from ..numeric.arrays import FloatArray
from .safe_xml import local_name

__all__ = ["SHAPES", "Segment", "Subpath", "length_of", "subpaths"]

ARC_STEP = 0.28
#: Distance of an arc's centre from the middle of its chord, relative to the radius, below which it is half an ellipse:
#: there the distance is the square root of rounding, 1e-8 to 3e-8.
HALF = 5e-8

#: What can make a segment of a path: a number, or a closing command.
ENTRIES = re.compile(r"[0-9]+|[zZ]")
#: Most of a path: a segment has up to seven numbers, with digits before and after the point.
MAX_ENTRIES = 14 * MAX_CURVES
#: What no path holds; the library would leave out all that follows.
FOREIGN = re.compile(r"[^MmZzLlHhVvCcSsQqTtAaEe0-9+\-.,\s]")

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
LENGTH = re.compile(rf"\s*({NUMBER})\s*([a-zA-Z%]*)\s*")
#: User units, by the standard 96 to the inch.
UNITS = {"": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 96 / 101.6, "pt": 96 / 72, "pc": 16.0}

Segment = tuple[FloatArray, int, FloatArray]
"""Knots, degree and control points of a path segment."""


@dataclass
class Subpath:
    """Consecutive segments, and whether the path says that they close."""

    segments: list[Segment] = field(default_factory=list)
    closed: bool = False


def subpaths(shape: Element, name: str) -> list[Subpath]:
    """Subpaths of a shape; those without segments are left out.

    Raises
    ------
    InputError
        With the name, on what cannot be read.
    """
    from svg.path import parse_path

    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            text = SHAPES[local_name(shape)](shape)
            # Before they are parsed, which takes thousands of bytes for each.
            at_most(sum(1 for _ in ENTRIES.finditer(text)), MAX_ENTRIES, f"numbers in {name}", "simplify it")
            if found := FOREIGN.search(text):
                raise ValueError(f"{found[0]!r} is no part of a path")
            return _runs(parse_path(text))
    except InputError:
        raise
    except (ValueError, TypeError, LookupError, ArithmeticError, AssertionError, AttributeError) as error:
        what = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"{name}: cannot read its geometry ({what}); correct it") from None


def _runs(path: Any) -> list[Subpath]:
    from svg.path import Close, Move

    if len(path) and not isinstance(path[0], Move):
        raise ValueError("it does not start with M")
    runs = [Subpath()]
    for part in path:
        if isinstance(part, Move):
            runs.append(Subpath())
            continue
        if runs[-1].closed:
            # After a closing command the next subpath starts where the last one did.
            runs.append(Subpath())
        if (segment := _segment(part)) is not None:
            runs[-1].segments.append(segment)
        runs[-1].closed = isinstance(part, Close)
    return [run for run in runs if run.segments]


def _segment(part: Any) -> Segment | None:
    """The segment; None for a line or an arc without length."""
    from svg.path import Arc, CubicBezier, QuadraticBezier

    if isinstance(part, Arc) and part.start != part.end and part.radius.real and part.radius.imag:
        return _arc(part)
    ends = [part.start, part.end]
    if isinstance(part, CubicBezier):
        ends[1:1] = [part.control1, part.control2]
    elif isinstance(part, QuadraticBezier):
        ends[1:1] = [part.control]
    elif part.start == part.end:
        return None
    p = len(ends) - 1
    return np.repeat([0.0, 1.0], p + 1), p, np.array([[z.real, z.imag] for z in ends])


def _arc(arc: Any) -> Segment:
    radius = arc.radius * arc.radius_scale
    turn = np.exp(1j * math.radians(arc.rotation))
    delta, first, center = math.radians(arc.delta), math.radians(arc.theta), arc.center
    middle = (arc.start + arc.end) / 2
    if abs(_on_circle((center - middle) / turn, radius)) <= HALF:
        out = _on_circle((arc.start - middle) / turn, radius)
        delta, first, center = math.copysign(math.pi, delta), math.atan2(out.imag, out.real), middle
    n = max(1, math.ceil(abs(delta) / ARC_STEP))
    phi = np.exp(1j * (first + delta * np.arange(n + 1) / n))
    k = 4 / 3 * math.tan(delta / n / 4)
    inner = np.column_stack([phi[:-1] * (1 + 1j * k), phi[1:] * (1 - 1j * k)]).ravel()
    unit = np.concatenate([phi[:1], inner, phi[-1:]])
    z = (radius.real * unit.real + 1j * radius.imag * unit.imag) * turn + center
    z[0], z[-1] = arc.start, arc.end
    knots = np.concatenate([np.zeros(4), np.repeat(np.arange(1, n) / n, 2), np.ones(4)])
    return knots, 3, np.column_stack([z.real, z.imag])


def _on_circle(z: complex, radius: complex) -> complex:
    """A vector in units of the half axes."""
    return complex(z.real / radius.real, z.imag / radius.imag)


def length_of(element: Element, attribute: str, default: float | None = None) -> float:
    """A length in user units; `ValueError` if it is missing without a default, relative or no number."""
    text = element.get(attribute)
    if text is None or text.strip() == "auto":
        if default is None:
            raise ValueError(f"{attribute} is missing")
        return default
    found = LENGTH.fullmatch(text)
    if found is None or found[2].lower() not in UNITS:
        raise ValueError(f"{attribute} is {text[:20]!r}, not a number with an absolute unit")
    return float(found[1]) * UNITS[found[2].lower()]


def _rect(e: Element) -> str:
    x, y, w, h = length_of(e, "x", 0.0), length_of(e, "y", 0.0), length_of(e, "width"), length_of(e, "height")
    rx = length_of(e, "rx", length_of(e, "ry", 0.0))
    rx, ry = min(rx, w / 2), min(length_of(e, "ry", rx), h / 2)
    if not rx or not ry:
        return f"M{x!r},{y!r}H{x + w!r}V{y + h!r}H{x!r}Z"
    a = f"A{rx!r},{ry!r},0,0,1,"
    return (
        f"M{x + rx!r},{y!r}H{x + w - rx!r}{a}{x + w!r},{y + ry!r}V{y + h - ry!r}{a}{x + w - rx!r},{y + h!r}"
        f"H{x + rx!r}{a}{x!r},{y + h - ry!r}V{y + ry!r}{a}{x + rx!r},{y!r}Z"
    )


def _round(e: Element, rx: float, ry: float) -> str:
    x, y = length_of(e, "cx", 0.0), length_of(e, "cy", 0.0)
    half = f"A{rx!r},{ry!r},0,0,1,"
    return f"M{x + rx!r},{y!r}{half}{x - rx!r},{y!r}{half}{x + rx!r},{y!r}Z"


def _circle(e: Element) -> str:
    radius = length_of(e, "r")
    return _round(e, radius, radius)


def _ellipse(e: Element) -> str:
    return _round(e, length_of(e, "rx"), length_of(e, "ry"))


def _line(e: Element) -> str:
    x1, y1, x2, y2 = (length_of(e, name, 0.0) for name in ("x1", "y1", "x2", "y2"))
    return f"M{x1!r},{y1!r}L{x2!r},{y2!r}"


def _points(e: Element) -> str:
    text = e.get("points", "").strip()
    return f"M{text}" if text else ""


#: Path data of each kind of shape.
SHAPES: dict[str, Callable[[Element], str]] = {
    "path": lambda e: e.get("d", ""),
    "rect": _rect,
    "circle": _circle,
    "ellipse": _ellipse,
    "line": _line,
    "polyline": _points,
    "polygon": lambda e: _points(e) + "Z" if _points(e) else "",
}
