"""DXF: what is drawn in model space with lines, arcs and splines is the outline.

Entities are taken over exactly (arcs and ellipses as rational quadratics) with the extrusion of their coordinate
system, polylines side by side with their bulges. Block references are expanded with the transforms of all blocks around
them; what stands on layer 0 of a block is on the layer of the reference, as in CAD programs. External references are
not fetched. Entities that draw no outline (text, dimensions, hatches ...) are left out with a note that counts them.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from io import StringIO
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..libraries import library
from ..limits import MAX_CURVES, MAX_DXF_LINES, at_most
from ..numeric.arrays import FloatArray
from .damage import damaged
from .options import DEFAULT, BoundaryOptions
from .pieces import Piece, arc, boundary_of, bulge, full_turn, line, spline

__all__ = ["looks_like_dxf", "read_boundary"]

BINARY = b"AutoCAD Binary DXF\r\n\x1a\x00"
#: Blocks within blocks: programs nest a few, and each level is a level of Python's own stack.
MAX_DEPTH = 50
#: Kinds and layers that a note names; the others are counted together.
NAMED = 8
#: Points that a spline without control points passes through: a system of equations of their number is solved.
MAX_FIT_POINTS = 2_000
#: A vertex of a polyline that only controls a curve and is not drawn.
CONTROL_VERTEX = 16


def looks_like_dxf(data: bytes) -> bool:
    """Whether a section starts where DXF has its first one, after comments (code 999)."""
    if data.startswith(BINARY):
        return True
    lines = [entry.strip() for entry in data[:4096].removeprefix(b"\xef\xbb\xbf").splitlines()]
    while lines[:1] == [b"999"]:
        lines = lines[2:]
    return lines[:2] == [b"0", b"SECTION"]


@dataclass
class _Drawing:
    """Pieces of a drawing as they are found, and what was left out."""

    layers: frozenset[str] | None
    hidden: frozenset[str]
    frozen: frozenset[str]
    pieces: list[tuple[str, Piece]] = field(default_factory=list)
    other: Counter[str] = field(default_factory=Counter)
    unseen: Counter[str] = field(default_factory=Counter)
    unchosen: Counter[str] = field(default_factory=Counter)
    seen: set[str] = field(default_factory=set)
    references: int = 0

    def wants(self, entity: Any, layer: str, frozen_around: bool) -> bool:
        """Whether an entity is on a chosen layer, or visible if none were chosen; counted if not."""
        key = layer.casefold()
        self.seen.add(layer)
        if self.layers is not None:
            if key not in self.layers:
                self.unchosen[layer] += 1
            return key in self.layers
        if key in self.hidden or frozen_around or entity.dxf.get("invisible", 0):
            self.unseen[layer] += 1
            return False
        return True

    def collect(
        self, entities: Iterable[Any], matrix: FloatArray, around: str | None, frozen: bool, path: tuple[str, ...]
    ) -> None:
        """Add pieces of entities, those of block references included, placed by `matrix`."""
        for entity in entities:
            kind, own = entity.dxftype(), entity.dxf.get("layer", "0")
            layer = around if around is not None and own == "0" else own
            name = f"{kind} {entity.dxf.handle or 'without handle'} on layer {layer!r}"
            if kind == "INSERT":
                self._expand(entity, name, layer, matrix, frozen, path)
            elif not self.wants(entity, layer, frozen):
                continue
            elif (found := OUTLINE.get(kind)) is None or not _is_curve(entity):
                self.other[f"{kind} on layer {layer!r}"] += 1
            else:
                # What overflows is refused with the loops, by its name.
                with damaged(f"{name}: cannot read its geometry", "correct or delete it"), np.errstate(all="ignore"):
                    parts = list(found(entity))
                for k, piece in enumerate(parts, 1):
                    part = name if len(parts) == 1 else f"{name}, side {k}"
                    self.pieces.append((part, piece.placed(matrix)))
                at_most(len(self.pieces), MAX_CURVES, "pieces of outline", "keep those of the domain")

    def _expand(
        self, entity: Any, name: str, layer: str, matrix: FloatArray, frozen: bool, path: tuple[str, ...]
    ) -> None:
        block, called = entity.block(), entity.dxf.name
        if block is None:
            raise InputError(f"{name}: its block {called!r} is not in the file; insert it again")
        if called in path or len(path) >= MAX_DEPTH:
            raise InputError(f"{name}: its block {called!r} holds itself, or blocks are nested too deep; explode it")
        if block.block is not None and block.block.is_xref:
            self.other[f"reference to another file on layer {layer!r}"] += 1
            return
        # A grid of references counts before it is laid out.
        rows, columns = max(entity.dxf.row_count, 1), max(entity.dxf.column_count, 1)
        self.references += rows * columns
        at_most(self.references, MAX_CURVES, "block references", "keep those of the domain")
        if self.layers is None and (entity.dxf.get("invisible", 0) or layer.casefold() in self.frozen):
            frozen = True
        for single in entity.multi_insert() if rows * columns > 1 else [entity]:
            with damaged(f"{name}: cannot place its block", "explode it"):
                own = np.array(list(single.matrix44())).reshape(4, 4).T
            with np.errstate(over="ignore", invalid="ignore"):
                self.collect(block, matrix @ own, layer, frozen, (*path, called))

    def notes(self) -> Iterator[str]:
        """What was left out, a line each kind."""
        if self.other:
            yield f"left out, for they draw no outline: {_listed(self.other)}"
        if self.unseen:
            yield f"left out, for their layers are off or frozen or they are invisible: {_entities(self.unseen)}"
        if self.unchosen:
            yield f"left out, for their layers were not chosen: {_entities(self.unchosen)}"


def _entities(counts: Counter[str]) -> str:
    return _listed(Counter({f"on layer {layer!r}": n for layer, n in counts.items()}))


def _listed(counts: Counter[str]) -> str:
    told = [f"{n} {what}" for what, n in counts.most_common(NAMED)]
    rest = sum(counts.values()) - sum(n for _, n in counts.most_common(NAMED))
    return ", ".join(told + ([f"{rest} others"] if rest else []))


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of a drawing; see `patchtransfer.read_boundary`."""
    document = _document(data)
    with damaged("its layers cannot be read", "save it again with a CAD program"):
        layers = list(document.layers)
        hidden = frozenset(x.dxf.name.casefold() for x in layers if x.is_off() or x.is_frozen())
        frozen = frozenset(x.dxf.name.casefold() for x in layers if x.is_frozen())
    chosen = None if options.layers is None else frozenset(name.casefold() for name in options.layers)
    drawing = _Drawing(chosen, hidden, frozen)
    with damaged("its model space cannot be read", "save it again with a CAD program"):
        drawing.collect(document.modelspace(), np.eye(4), None, False, ())
    used = drawing.seen | {x.dxf.name for x in layers}
    if chosen is not None and (missing := chosen - {name.casefold() for name in used}):
        raise InputError(f"has no layer {min(missing)!r}; its layers are {', '.join(sorted(used)[: 4 * NAMED])}")
    notes = list(drawing.notes())
    if not drawing.pieces:
        told = "".join(f"; {note}" for note in notes)
        raise InputError(f"no lines, arcs or splines in model space{told}; draw the outline there")
    try:
        return boundary_of(drawing.pieces, notes, options)
    except InputError as error:
        if chosen is not None or len(drawing.seen) < 2:
            raise
        # Dimension lines and frames lie on layers of their own.
        names = ", ".join(sorted(drawing.seen)[: 4 * NAMED])
        raise InputError(f"{error}; or read the outline's layer only (--layer, layers=): {names}") from None


def _document(data: bytes) -> Any:
    """The parsed drawing."""
    ezdxf = library("ezdxf", "cad")
    # Without a handler Python prints the library's warnings on standard error.
    logging.getLogger("ezdxf").addHandler(logging.NullHandler())
    from ezdxf.document import Drawing
    from ezdxf.filemanagement import dxf_stream_info
    from ezdxf.lldxf.tagger import ascii_tags_loader, binary_tags_loader

    # In a binary file the shortest pair of a code and a value takes some 8 bytes, in a text it takes two lines.
    lines = len(data) // 4 if data.startswith(BINARY) else data.count(b"\n")
    at_most(lines, MAX_DXF_LINES, "lines", "keep what belongs to the outline")
    with damaged("damaged DXF", "save it again with a CAD program", ezdxf.DXFError):
        if data.startswith(BINARY):
            return Drawing.load(binary_tags_loader(data))
        encoding = dxf_stream_info(StringIO(data.decode("latin-1"), newline=None)).encoding
        text = data.decode(encoding, "surrogateescape").removeprefix("\ufeff")
        return Drawing.load(ascii_tags_loader(StringIO(text, newline=None)))


def _is_curve(entity: Any) -> bool:
    """Whether a polyline is one: meshes are stored as such too."""
    return entity.dxftype() != "POLYLINE" or bool(entity.is_2d_polyline or entity.is_3d_polyline)


def _axes(entity: Any) -> FloatArray:
    """Axes of an entity's own coordinate system, one a row."""
    ocs = entity.ocs()
    return np.array([ocs.ux, ocs.uy, ocs.uz] if ocs.transform else np.eye(3), dtype=np.float64)


def _line(entity: Any) -> Iterator[Piece]:
    yield line(tuple(entity.dxf.start), tuple(entity.dxf.end))


def _circle(entity: Any) -> Iterator[Piece]:
    x, y, _ = axes = _axes(entity)
    r = abs(entity.dxf.radius)
    center = np.array(tuple(entity.dxf.center)) @ axes
    yield arc(center, r * x, r * y, 0.0, 2 * math.pi)


def _arc(entity: Any) -> Iterator[Piece]:
    x, y, _ = axes = _axes(entity)
    r = abs(entity.dxf.radius)
    a, b = math.radians(entity.dxf.start_angle), math.radians(entity.dxf.end_angle)
    center = np.array(tuple(entity.dxf.center)) @ axes
    yield arc(center, r * x, r * y, a, _turn(a, b))


def _ellipse(entity: Any) -> Iterator[Piece]:
    x = np.array(tuple(entity.dxf.major_axis))
    normal = np.array(tuple(entity.dxf.extrusion))
    y = np.cross(normal / np.linalg.norm(normal), x) * entity.dxf.ratio
    a, b = entity.dxf.start_param, entity.dxf.end_param
    yield arc(tuple(entity.dxf.center), x, y, a, _turn(a, b))


def _turn(start: float, end: float) -> float:
    """Angle from start to end, counter-clockwise."""
    return 2 * math.pi if full_turn(start, end) else (end - start) % (2 * math.pi)


def _lwpolyline(entity: Any) -> Iterator[Piece]:
    rows = np.array(entity.get_points("xyb"), dtype=np.float64).reshape(-1, 3)
    height = float(entity.dxf.elevation)
    points = np.column_stack([rows[:, :2], np.full(len(rows), height)])
    yield from _sides(points, rows[:, 2], bool(entity.closed), _axes(entity))


def _polyline(entity: Any) -> Iterator[Piece]:
    vertices = [v for v in entity.vertices if not v.dxf.flags & CONTROL_VERTEX]
    points = np.array([tuple(v.dxf.location) for v in vertices], dtype=np.float64).reshape(-1, 3)
    closed = bool(entity.is_closed)
    if entity.is_3d_polyline:
        yield from _sides(points, np.zeros(len(points)), closed, np.eye(3))
        return
    points[:, 2] = entity.dxf.elevation.z
    bulges = np.array([v.dxf.get("bulge", 0.0) for v in vertices])
    yield from _sides(points, bulges, closed, _axes(entity))


def _sides(points: FloatArray, bulges: FloatArray, closed: bool, axes: FloatArray) -> Iterator[Piece]:
    matrix = np.eye(4)
    matrix[:3, :3] = axes.T
    for k in range(len(points) if closed else len(points) - 1):
        a, b = points[k], points[(k + 1) % len(points)]
        # A closed polyline may repeat its first point at the end.
        if not np.array_equal(a, b):
            yield bulge(a, b, float(bulges[k])).placed(matrix)


def _spline(entity: Any) -> Iterator[Piece]:
    points, knots, weights = (np.array(x, dtype=np.float64) for x in _spline_data(entity))
    yield spline(knots, _degree(entity), points, weights)


def _degree(entity: Any) -> int:
    # A spline that has fit points only is a cubic.
    return int(entity.dxf.degree) if entity.control_point_count() else 3


def _spline_data(entity: Any) -> tuple[Any, Any, Any]:
    if entity.control_point_count() and len(entity.knots):
        return entity.control_points, entity.knots, entity.weights
    # Without knots, or with points to pass through only.
    at_most(entity.fit_point_count(), MAX_FIT_POINTS, "points of a spline", "take every other one")
    tool = entity.construction_tool()
    return [tuple(p) for p in tool.control_points], tool.knots(), tool.weights()


OUTLINE = {
    "LINE": _line,
    "CIRCLE": _circle,
    "ARC": _arc,
    "ELLIPSE": _ellipse,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _polyline,
    "SPLINE": _spline,
}
