"""The coarse mesh of a NURBS mesh: its elements, edges and boundary, and which sides of patches these are."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

from ...errors import InputError
from ...geometry.sides import Interface, Side
from ...limits import MAX_PATCHES
from ..text import Words

__all__ = ["NAME", "CoarseMesh", "Comments", "pair", "read_comments", "read_mesh"]

NAME = "MFEM NURBS mesh"
SEGMENT, SQUARE = 1, 3
#: Corners of an element at the ends of each side, in the sense of its parameter.
ENDS = {Side.WEST: (0, 3), Side.EAST: (1, 2), Side.SOUTH: (0, 1), Side.NORTH: (3, 2)}
#: Sides in the order of MFEM's edges of an element.
EDGE_ORDER = (Side.SOUTH, Side.EAST, Side.NORTH, Side.WEST)
#: Geometries of other numbers, for messages.
GEOMETRIES = {0: "a point", 1: "a segment", 2: "a triangle", 3: "a square", 4: "a tetrahedron", 5: "a cube"}
#: A label is longer than this only in a hostile file.
MAX_NAMES = 10_000
SHRINK = "split the model"

Corners = tuple[int, int, int, int]


@dataclass(frozen=True)
class CoarseMesh:
    """Elements by their vertices, rows of the boundary (attribute, ends) and of edges (knot vector, ends)."""

    attributes: tuple[int, ...]
    elements: tuple[Corners, ...]
    boundary: tuple[tuple[int, int, int], ...]
    edges: tuple[tuple[int, int, int], ...]
    vertices: int

    def ends(self, patch: int, side: Side) -> tuple[int, int]:
        """Vertices at the start and the end of a side."""
        first, last = ENDS[side]
        return self.elements[patch][first], self.elements[patch][last]

    def sides(self) -> dict[tuple[int, int], list[tuple[int, Side]]]:
        """Sides of patches by their vertices, in the order in which MFEM numbers edges that are not listed."""
        found: dict[tuple[int, int], list[tuple[int, Side]]] = {}
        for patch in range(len(self.elements)):
            for side in EDGE_ORDER:
                found.setdefault(pair(*self.ends(patch, side)), []).append((patch, side))
        return found

    def interfaces(self) -> list[Interface] | None:
        """Sides of two patches; None if no patches share a vertex, which says that the file tells nothing."""
        found = []
        for ends, sides in self.sides().items():
            if len(sides) > 2:
                raise InputError(f"elements: {len(sides)} patches share the edge of vertices {ends[0]} and {ends[1]}")
            if len(sides) == 2:
                a, b = sides
                found.append(Interface(*a, *b, self.ends(*a) != self.ends(*b)))
        shared = len({v for element in self.elements for v in element}) < 4 * len(self.elements)
        return sorted(found, key=lambda f: (f.patch_a, f.side_a)) if shared else None

    def exchanged(self, patches: Sequence[int]) -> CoarseMesh:
        """The same with u and v of some patches exchanged."""
        turned = set(patches)
        elements = ((e[0], e[3], e[2], e[1]) if k in turned else e for k, e in enumerate(self.elements))
        return CoarseMesh(self.attributes, tuple(elements), self.boundary, self.edges, self.vertices)


@dataclass(frozen=True)
class Comments:
    """What our writer says in comments: labels of boundary attributes, and patches with u and v exchanged."""

    labels: dict[int, list[str]]
    exchanged: tuple[int, ...]


def pair(a: int, b: int) -> tuple[int, int]:
    """Two vertices in order: what MFEM knows an edge by."""
    return (a, b) if a < b else (b, a)


def read_comments(comments: Sequence[str], patches: int) -> Comments:
    """Comments of our writer among those of a file; others say nothing."""
    labels: dict[int, list[str]] = {}
    turned: tuple[int, ...] = ()
    for comment in comments:
        if found := re.fullmatch(r"boundary attribute ([0-9]{1,9}): (\[.*\])", comment):
            names = _names(found[2])
            if names is not None:
                labels[int(found[1])] = names
        elif found := re.fullmatch(r"u and v exchanged in patches((?: [0-9]{1,9})+)", comment):
            turned = tuple(k for k in map(int, found[1].split()) if k < patches)
    return Comments(labels, turned)


def _names(text: str) -> list[str] | None:
    if len(text) > MAX_NAMES:
        return None
    try:
        names = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return names if all(isinstance(name, str) and name.strip() for name in names) else None


def section(words: Words, name: str) -> None:
    """Read a section's name, which must be this one."""
    word = words.next(f"the section '{name}'")
    if word != name:
        raise InputError(f"line {words.number}: section '{name}' should stand here, got {word[:30]!r}; correct it")


def read_mesh(words: Words) -> CoarseMesh:
    """The sections ``dimension`` to ``vertices``."""
    section(words, "dimension")
    dimension = words.integer("the dimension")
    if dimension != 2:
        kind = {1: "a mesh of curves", 3: "a mesh of volumes"}.get(dimension, "a mesh")
        raise InputError(f"line {words.number}: {kind} (dimension {dimension}); only planar patches are supported")
    section(words, "elements")
    count = words.count("elements", MAX_PATCHES, SHRINK)
    if not count:
        raise InputError(f"line {words.number}: no elements, so no patches; the file is incomplete")
    attributes, elements = [], []
    for k in range(count):
        attribute, *corners = _row(words, f"element {k}", SQUARE, 4)
        attributes.append(attribute)
        elements.append((corners[0], corners[1], corners[2], corners[3]))
    section(words, "boundary")
    boundary = []
    for k in range(words.count("boundary elements", 4 * MAX_PATCHES, SHRINK)):
        attribute, a, b = _row(words, f"boundary element {k}", SEGMENT, 2)
        boundary.append((attribute, a, b))
    section(words, "edges")
    edges = []
    for k in range(words.count("edges", 4 * MAX_PATCHES, SHRINK)):
        vector, a, b = (words.integer(f"edge {k}") for _ in range(3))
        # A negative number is a knot vector that runs the other way.
        edges.append((vector, a, b) if vector >= 0 else (-1 - vector, b, a))
    section(words, "vertices")
    vertices = words.count("vertices", 4 * MAX_PATCHES, SHRINK)
    mesh = CoarseMesh(tuple(attributes), tuple(elements), tuple(boundary), tuple(edges), vertices)
    _check_vertices(mesh)
    return mesh


def _row(words: Words, what: str, geometry: int, vertices: int) -> list[int]:
    """Attribute and vertices of an element."""
    attribute, kind = words.integer(what), words.integer(what)
    if kind != geometry:
        got = GEOMETRIES.get(kind, f"geometry {kind}")
        raise InputError(f"line {words.number}, {what}: {got} instead of {GEOMETRIES[geometry]}; correct it")
    return [attribute, *(words.integer(what) for _ in range(vertices))]


def _check_vertices(mesh: CoarseMesh) -> None:
    """Refuse vertices that do not exist, elements that name one twice, and edges of no element."""
    for k, element in enumerate(mesh.elements):
        _check_range(element, mesh.vertices, f"element {k}")
        if len(set(element)) < 4:
            raise InputError(
                f"element {k}: names a vertex twice (periodic or collapsed); give each corner a vertex of its own"
            )
    known = mesh.sides()
    for name, rows in (("boundary element", mesh.boundary), ("edge", mesh.edges)):
        for k, (_, a, b) in enumerate(rows):
            _check_range((a, b), mesh.vertices, f"{name} {k}")
            if pair(a, b) not in known:
                raise InputError(f"{name} {k}: no element has an edge of vertices {a} and {b}; correct the row")
    listed = {pair(a, b) for _, a, b in mesh.edges}
    if mesh.edges and (len(listed) < len(mesh.edges) or len(listed) < len(known)):
        missing = next((ends for ends in known if ends not in listed), None)
        what = (
            "one is listed twice" if missing is None else f"that of vertices {missing[0]} and {missing[1]} is missing"
        )
        raise InputError(f"edges: {what}; list each edge once, or none")


def _check_range(vertices: Sequence[int], count: int, what: str) -> None:
    for v in vertices:
        if not 0 <= v < count:
            raise InputError(f"{what}: there is no vertex {v}, the vertices are 0 to {count - 1}; correct the row")
