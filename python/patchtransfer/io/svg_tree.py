"""SVG: the shapes that are drawn, with their places, and notes on what is not.

Transforms of elements and of all around them, `<use>`, `<symbol>` and inner `<svg>` are followed. Coordinates stay in
the user units of the outermost element: its viewBox scales the picture as a whole.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InputError
from ..limits import MAX_CURVES, TOO_LARGE, at_most, first_unusable
from ..numeric.arrays import FloatArray
from .safe_xml import local_name
from .svg_paths import NUMBER, SHAPES, Subpath, length_of, subpaths
from .svg_style import Sheet, Style, hidden, inherited, painted

__all__ = ["Drawing", "Shape", "place"]

CONTAINERS = ("g", "a", "switch", "svg")
#: What holds shapes that are drawn only where something refers to it.
TEMPLATES = ("defs", "symbol", "clipPath", "mask", "pattern", "marker")
#: Drawn, but no outlines.
OTHER = ("text", "image", "foreignObject")
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
#: Names in a note; the rest is a number.
NAMED = 3

TRANSFORM = re.compile(r"\s*,?\s*(\w+)\s*\(([^()]*)\)")
REFERENCE = re.compile(r"url\(\s*['\"]?#([^'\")]+)['\"]?\s*\)")


@dataclass(frozen=True)
class Shape:
    """A shape that is drawn: subpaths in the coordinates of the picture, whether it is filled, and what clips it."""

    name: str
    subpaths: list[Subpath]
    filled: bool


@dataclass(frozen=True)
class _Around:
    """What holds for the children of an element."""

    matrix: FloatArray
    style: Style = field(default_factory=dict)
    unseen: str = ""
    """Why nothing in here is drawn; empty if it is."""
    chosen: bool = True
    clips: tuple[tuple[str, FloatArray | None], ...] = ()
    """Convex polygons, None if a clip is something else, with their names."""
    uses: tuple[str, ...] = ()


class Drawing:
    """Walk through a picture; `shapes()` yields what is drawn, after which `notes()` tells of the rest."""

    def __init__(self, root: Element, layers: tuple[str, ...] | None) -> None:
        self._root, self._sheet = root, Sheet(root)
        self._layers = None if layers is None else {name.casefold() for name in layers}
        self._known: dict[str, str] = {}
        self._by_id = {e.attrib["id"]: e for e in root.iter() if "id" in e.attrib}
        self._drawn: set[int] = set()
        self._left_out: dict[str, list[str]] = {}
        self._others: Counter[str] = Counter()
        self._number = 0

    def shapes(self) -> Iterator[Shape]:
        """Shapes that are drawn, in document order.

        Raises
        ------
        InputError
            Naming the element that cannot be read, a reference in a circle, or a layer that there is not.
        """
        # Not by recursion: programs nest groups, and files may do so thousands deep.
        stack = [(iter([self._root]), _Around(np.eye(3), chosen=self._layers is None))]
        repeated = 0
        while stack:
            children, around = stack[-1]
            element = next(children, None)
            if element is None:
                stack.pop()
                continue
            # Elements that repeat elements that repeat others grow without bounds.
            repeated += bool(around.uses)
            at_most(repeated, MAX_CURVES, "elements that <use> repeats", "draw the shapes once")
            kind = local_name(element)
            if kind in SHAPES:
                if (shape := self._shape(element, around)) is not None:
                    yield shape
            elif kind in CONTAINERS:
                stack.append((_children(element), self._inside(element, around)))
            elif kind == "use":
                if (used := self._used(element, around)) is not None:
                    stack.append(used)
            elif kind in OTHER and not around.unseen and around.chosen:
                self._others[kind] += 1
        self._check_layers()

    def leave_out(self, name: str, reason: str) -> None:
        """Keep in mind for the notes that a shape is left out."""
        self._left_out.setdefault(reason, []).append(name)

    def notes(self) -> list[str]:
        """What was left out, by reasons."""
        templates = (e for e in self._root.iter() if local_name(e) in TEMPLATES)
        unused = {id(e) for t in templates for e in t.iter() if local_name(e) in SHAPES} - self._drawn
        notes = [f"left out, {reason}: {_listed(names)}" for reason, names in self._left_out.items()]
        if unused:
            notes.append(
                f"left out, never drawn: {len(unused)} shapes in definitions (<defs>, <symbol>, <clipPath>, ...)"
            )
        if self._others:
            what = ", ".join(f"{count} <{kind}>" for kind, count in self._others.items())
            notes.append(f"left out, no outlines: {what}")
        if self._sheet.left_aside:
            notes.append(f"rules of the style sheet that were left aside: {_listed(self._sheet.left_aside)}")
        return notes

    def _shape(self, element: Element, around: _Around) -> Shape | None:
        self._number += 1
        self._drawn.add(id(element))
        name = f"<{local_name(element)}> {element.get('id') or f'number {self._number}'}"
        inside = self._inside(element, around, name)
        filled, drawn = painted(inside.style)
        if not inside.chosen:
            self.leave_out(name, "on other layers")
        elif inside.unseen or not (filled or drawn):
            self.leave_out(name, inside.unseen or "hidden or painted with nothing")
        else:
            placed = [_placed(run, inside.matrix, name) for run in subpaths(element, name)]
            outside = next((c for c, region in inside.clips if not _within(placed, region)), None)
            if outside is None:
                return Shape(name, placed, filled and local_name(element) != "line")
            self.leave_out(name, f"clipped by {outside}")
        return None

    def _inside(self, element: Element, around: _Around, name: str = "") -> _Around:
        name = name or f"<{local_name(element)}> {element.get('id') or ''}".rstrip()
        own = self._sheet.style(element)
        if "transform" in own:
            raise InputError(f"{name}: a transform in a style is not supported; use the attribute transform")
        matrix = _times(around.matrix, _transform(element, name))
        clips = around.clips
        for what in ("clip-path", "mask"):
            if own.get(what, "none") != "none":
                clips = (*clips, self._clip(what, own[what], matrix))
        if local_name(element) == "svg" and element is not self._root:
            matrix = _times(matrix, _viewport(element, element, name))
        names = [n for n in (element.get(LABEL), element.get("id")) if n]
        if local_name(element) == "g":
            self._known.update((n.casefold(), n) for n in names)
        named = self._layers is not None and any(n.casefold() in self._layers for n in names)
        if named:
            self._known.update((n.casefold(), n) for n in names)
        # A layer that is asked for by its name may be a hidden one.
        unseen = around.unseen or ("hidden" if hidden(own) and not named else "")
        return replace(
            around,
            matrix=matrix,
            style=inherited(around.style, own),
            unseen=unseen,
            chosen=around.chosen or named,
            clips=clips,
        )

    def _used(self, element: Element, around: _Around) -> tuple[Iterator[Element], _Around] | None:
        """What a <use> draws."""
        target = next((element.attrib[h] for h in HREFS if h in element.attrib), "")
        name = f"<use> {element.get('id') or target}".rstrip()
        found = self._by_id.get(target[1:]) if target.startswith("#") else None
        if found is None:
            self.leave_out(name, "refers to nothing in this file")
            return None
        if target in around.uses:
            raise InputError(f"{name}: refers to itself; delete it")
        inside = self._inside(element, around, name)
        try:
            shift = _translation(length_of(element, "x", 0.0), length_of(element, "y", 0.0))
        except ValueError as error:
            raise InputError(f"{name}: {error}; correct it") from None
        inside = replace(inside, matrix=_times(inside.matrix, shift), uses=(*around.uses, target))
        if local_name(found) != "symbol":
            return iter([found]), inside
        symbol = self._inside(found, inside)
        return iter(found), replace(symbol, matrix=_times(symbol.matrix, _viewport(found, element, name)))

    def _clip(self, what: str, value: str, matrix: FloatArray) -> tuple[str, FloatArray | None]:
        """The region of a clip path, if it is one convex polygon."""
        found = REFERENCE.fullmatch(value.strip())
        element = self._by_id.get(found[1]) if found else None
        name = f"{what} {found[1] if found else value[:40]}"
        if (
            what == "mask"
            or element is None
            or element.get("clipPathUnits") == "objectBoundingBox"
            or len(element) != 1
        ):
            return name, None
        (shape,) = element
        if local_name(shape) not in SHAPES or local_name(shape) == "line":
            return name, None
        self._drawn.add(id(shape))
        matrix = _times(_times(matrix, _transform(element, name)), _transform(shape, name))
        runs = [_placed(run, matrix, name) for run in subpaths(shape, name)]
        if len(runs) != 1 or any(p != 1 for _, p, _ in runs[0].segments):
            return name, None
        return name, _convex(np.array([c[0] for _, _, c in runs[0].segments] + [runs[0].segments[-1][2][-1]]))

    def _check_layers(self) -> None:
        missing = [name for name in self._layers or () if name not in self._known]
        if missing:
            there = f"there are {_listed(sorted(self._known.values()))}" if self._known else "there are no named layers"
            raise InputError(f"no layer {missing[0]!r}; {there}")


def _children(element: Element) -> Iterator[Element]:
    if local_name(element) != "switch":
        return iter(element)
    # Only the first child that a program understands is drawn.
    return iter([e for e in element if local_name(e) != "foreignObject" and not e.get("requiredExtensions")][:1])


def _listed(names: list[str]) -> str:
    unique = list(dict.fromkeys(names))
    return ", ".join(unique[:NAMED]) + (f" and {len(unique) - NAMED} more" if len(unique) > NAMED else "")


def _placed(run: Subpath, matrix: FloatArray, name: str) -> Subpath:
    segments = [(knots, p, place(points, matrix)) for knots, p, points in run.segments]
    if any(first_unusable(points) is not None for _, _, points in segments):
        raise InputError(f"{name}: NaN, infinity or a number {TOO_LARGE}; correct it")
    return Subpath(segments, run.closed)


def place(points: FloatArray, matrix: FloatArray) -> FloatArray:
    """Points under a transform, with y upwards."""
    with np.errstate(over="ignore", invalid="ignore"):
        moved = points[:, :1] * matrix[:2, 0] + points[:, 1:] * matrix[:2, 1] + matrix[:2, 2]
    # Not -y, which would write zeros as -0.0.
    return np.column_stack([moved[:, 0], 0.0 - moved[:, 1]])


def _convex(points: FloatArray) -> FloatArray | None:
    """Corners of a convex polygon, counter-clockwise; None if it is not convex."""
    points = points[np.any(points != np.roll(points, 1, axis=0), axis=1)]
    edges = np.roll(points, -1, axis=0) - points
    cross = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
    if len(points) < 3 or not ((cross >= 0).all() or (cross <= 0).all()):
        return None
    return np.asarray(points if cross.sum() > 0 else points[::-1])


def _within(runs: list[Subpath], region: FloatArray | None) -> bool:
    """Whether all control points lie in a convex region."""
    if region is None:
        return False
    edges = np.roll(region, -1, axis=0) - region
    slack = 1e-6 * float(np.ptp(region, axis=0).max())
    points = np.concatenate([c for run in runs for _, _, c in run.segments]) if runs else np.zeros((0, 2))
    for corner, edge in zip(region, edges, strict=True):
        away = (points - corner) @ np.array([edge[1], -edge[0]])
        if (away > slack * np.hypot(*edge)).any():
            return False
    return True


def _times(a: FloatArray, b: FloatArray) -> FloatArray:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(a @ b)


def _translation(x: float, y: float) -> FloatArray:
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def _viewport(content: Element, placed: Element, name: str) -> FloatArray:
    """Transform of a symbol or an inner <svg>, `placed` by itself or by a <use>."""
    try:
        own = content is placed
        shift = _translation(length_of(placed, "x", 0.0), length_of(placed, "y", 0.0)) if own else np.eye(3)
        box = [float(v) for v in re.findall(NUMBER, content.get("viewBox", ""))]
        if not box:
            return shift
        if len(box) != 4 or box[2] <= 0 or box[3] <= 0:
            raise ValueError("its viewBox is not four numbers, the last two positive")
        width, height = (length_of(placed if side in placed.attrib else content, side) for side in ("width", "height"))
    except ValueError as error:
        raise InputError(f"{name}: {error}; correct it") from None
    x, y = width / box[2], height / box[3]
    align = content.get("preserveAspectRatio", "xMidYMid meet").split() or ["xMidYMid"]
    left, top = 0.0, 0.0
    if align[0] != "none":
        x = y = max(x, y) if align[-1] == "slice" else min(x, y)
        share = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
        left = share.get(align[0][1:4], 0.5) * (width - x * box[2])
        top = share.get(align[0][5:8], 0.5) * (height - y * box[3])
    fit = np.array([[x, 0.0, left - x * box[0]], [0.0, y, top - y * box[1]], [0.0, 0.0, 1.0]])
    return _times(shift, fit)


def _transform(element: Element, name: str) -> FloatArray:
    text = element.get("transform", "").strip()
    matrix, end = np.eye(3), 0
    for found in TRANSFORM.finditer(text):
        if found.start() != end:
            break
        end = found.end()
        try:
            matrix = _times(matrix, _function(found[1], [float(v) for v in re.split(r"[\s,]+", found[2].strip())]))
        except (ValueError, TypeError) as error:
            raise InputError(f"{name}: cannot read its transform ({error}); correct it") from None
    if text[end:].strip():
        raise InputError(f"{name}: cannot read its transform ({text[end:][:40]}); correct it")
    return matrix


def _function(kind: str, values: list[float]) -> FloatArray:
    """Matrix of one transform function; `ValueError` for a wrong name or count of numbers."""
    n = len(values)
    if kind == "matrix" and n == 6:
        a, b, c, d, e, f = values
        return np.array([[a, c, e], [b, d, f], [0.0, 0.0, 1.0]])
    if kind == "translate" and n in (1, 2):
        return _translation(values[0], values[1] if n == 2 else 0.0)
    if kind == "scale" and n in (1, 2):
        scaled = np.eye(3)
        scaled[0, 0], scaled[1, 1] = values[0], values[-1]
        return scaled
    if kind == "rotate" and n in (1, 3):
        t = math.radians(values[0])
        turn = np.array([[math.cos(t), -math.sin(t), 0.0], [math.sin(t), math.cos(t), 0.0], [0.0, 0.0, 1.0]])
        x, y = values[1:] if n == 3 else (0.0, 0.0)
        return _times(_times(_translation(x, y), turn), _translation(-x, -y))
    if kind in ("skewX", "skewY") and n == 1:
        skew = np.eye(3)
        skew[(0, 1) if kind == "skewX" else (1, 0)] = math.tan(math.radians(values[0]))
        return skew
    raise ValueError(f"{kind}({', '.join(f'{v:g}' for v in values)})")
