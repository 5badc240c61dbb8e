"""Writing MFEM NURBS meshes: the form with patches, which needs no numbering of degrees of freedom."""

from __future__ import annotations

import json
import re
import warnings
from collections import deque

import numpy as np

from ...errors import InputError, InputWarning
from ...geometry.multipatch import MultiPatch
from ...geometry.patch import Patch
from ...geometry.sides import Side
from ..tensor import exchanged
from .mesh import NAME, pair

__all__ = ["format_multipatch"]

#: Largest degree of MFEM's splines (``KnotVector::MaxOrder``).
LARGEST_DEGREE = 10
#: Labels that are attributes already.
ATTRIBUTE = re.compile(r"attribute ([1-9][0-9]{0,8})")

#: Vertices at the start and the end of a side, and its knot vector.
Edge = tuple[int, int, int]


def format_multipatch(multipatch: MultiPatch) -> str:
    """MFEM NURBS mesh v1.0 of a multi-patch.

    A label is a boundary attribute of its own ("attribute 3" has the number 3), several labels of the same side are one
    together, and the sides without any have one; comments keep the names.

    Raises
    ------
    InputError
        When a degree is above 10, or two sides that are not glued join the same two vertices, so that MFEM cannot tell
        them apart.
    """
    _check_degrees(multipatch)
    turned = [k for k, sign in enumerate(multipatch.topology.orientation) if sign < 0]
    vertices = _vertices(multipatch)
    edges = _edges(multipatch, vertices)
    attributes = _attributes(multipatch)
    numbers = _numbered(attributes)
    comments = [f"# boundary attribute {number}: {json.dumps(names)}" for names, number in numbers.items()]
    if turned:
        comments += ["# u and v exchanged in patches " + " ".join(map(str, turned))]
    lines = [f"{NAME} v1.0", "", *comments, "", "dimension", "2", "", "elements", str(len(multipatch))]
    for k, attribute in enumerate(_element_attributes(multipatch)):
        a, b, c, d = vertices[k]
        corners = (a, d, c, b) if k in turned else (a, b, c, d)
        lines.append(f"{attribute} 3 " + " ".join(map(str, corners)))
    lines += ["", "boundary", str(len(attributes))]
    for (k, side), names in attributes.items():
        a, b = _ends(vertices[k], side)
        ccw = (b, a) if multipatch.topology.directed_side(k, side).reversed else (a, b)
        lines.append(f"{numbers[names]} 1 {ccw[0]} {ccw[1]}")
    lines += ["", "edges", str(len(edges)), *(f"{vector} {a} {b}" for vector, a, b in edges)]
    lines += ["", "vertices", str(1 + max(v for corners in vertices for v in corners)), "", "patches"]
    for k, patch in enumerate(multipatch):
        lines += ["", f"# patch {k}", *_patch_lines(exchanged(patch) if k in turned else patch)]
    return "\n".join([*lines, ""])


def _check_degrees(multipatch: MultiPatch) -> None:
    for k, patch in enumerate(multipatch):
        if max(patch.degrees) > LARGEST_DEGREE:
            raise InputError(
                f"patch {k} has degree {max(patch.degrees)}; MFEM's splines have at most {LARGEST_DEGREE}, "
                "write another format"
            )


def _vertices(multipatch: MultiPatch) -> list[tuple[int, ...]]:
    """Vertices of each patch: corners (0, 0), (1, 0), (1, 1), (0, 1), those that are glued the same."""
    corners = np.array([[p[0, 0], p[-1, 0], p[-1, -1], p[0, -1]] for p in multipatch.topology.points])
    _, first, number = np.unique(corners, return_index=True, return_inverse=True)
    # In the order of the patches.
    rank = np.argsort(np.argsort(first))
    return [tuple(row) for row in rank[number.reshape(corners.shape)].tolist()]


def _ends(corners: tuple[int, ...], side: Side) -> tuple[int, int]:
    a, b, c, d = corners
    return {Side.WEST: (a, d), Side.EAST: (b, c), Side.SOUTH: (a, b), Side.NORTH: (d, c)}[side]


def _edges(multipatch: MultiPatch, vertices: list[tuple[int, ...]]) -> list[Edge]:
    """Knot vector and ends of each edge, in the sense of the knots of the first patch in the strip."""
    _check_edges(multipatch, vertices)
    across = {(f.patch_a, f.side_a): (f.patch_b, f.side_b, f.reversed) for f in multipatch.interfaces}
    across |= {(f.patch_b, f.side_b): (f.patch_a, f.side_a, f.reversed) for f in multipatch.interfaces}
    sense: dict[tuple[int, int], tuple[int, bool]] = {}
    strips = 0
    for start in ((k, axis) for k in range(len(multipatch)) for axis in (0, 1)):
        if start in sense:
            continue
        sense[start], queue = (strips, True), deque([start])
        while queue:
            k, axis = queue.popleft()
            for side in (s for s in Side if s.axis == axis and (k, s) in across):
                other, far, backwards = across[k, side]
                if (other, far.axis) not in sense:
                    sense[other, far.axis] = strips, sense[k, axis][1] != backwards
                    queue.append((other, far.axis))
        strips += 1
    edges: dict[tuple[int, int], Edge] = {}
    for k in range(len(multipatch)):
        for side in Side:
            vector, forwards = sense[k, side.axis]
            a, b = _ends(vertices[k], side)
            edges.setdefault(pair(a, b), (vector, a, b) if forwards else (vector, b, a))
    return sorted(edges.values(), key=lambda edge: edge[0])


def _check_edges(multipatch: MultiPatch, vertices: list[tuple[int, ...]]) -> None:
    """Refuse what MFEM cannot tell apart, for it knows edges by their vertices."""
    glued = {frozenset([(f.patch_a, f.side_a), (f.patch_b, f.side_b)]) for f in multipatch.interfaces}
    seen: dict[tuple[int, int], tuple[int, Side]] = {}
    for k, corners in enumerate(vertices):
        for side in Side:
            a, b = _ends(corners, side)
            other, first = seen.setdefault(pair(a, b), (k, side))
            same = (other, first) == (k, side) or frozenset([(other, first), (k, side)]) in glued
            if a == b or len(set(corners)) < 4 or not same:
                rest = "" if (other, first) == (k, side) else f" and {first.name.lower()} of patch {other}"
                raise InputError(
                    f"{side.name.lower()} of patch {k}{rest}: a closed ring of fewer than 3 patches, or a patch glued "
                    "to itself, cannot be an MFEM mesh, which knows edges by their vertices; split the patches"
                )


def _attributes(multipatch: MultiPatch) -> dict[tuple[int, Side], tuple[str, ...]]:
    """Labels of the sides that are boundary to MFEM: in the order of the labels, then those without.

    A side inside the model may be one of them; it stands for both patches, as the first one's.
    """
    first = {}
    for f in multipatch.interfaces:
        a, b = sorted([(f.patch_a, f.side_a), (f.patch_b, f.side_b)])
        first[b] = a
    inside = {*first, *first.values()}
    labels: dict[tuple[int, Side], list[str]] = {}
    for name, sides in multipatch.sides.items():
        what = None if sides else "names no side; left out"
        if inside.intersection(sides) and not ATTRIBUTE.fullmatch(name):
            what = "names sides inside the model, which MFEM holds for boundary"
        if what:
            warnings.warn(f"label {name!r} {what}", InputWarning, stacklevel=4)
        for side in dict.fromkeys(first.get(side, side) for side in sides):
            labels.setdefault(side, []).append(name)
    for side in multipatch.boundaries:
        labels.setdefault(side, [])
    return {side: tuple(names) for side, names in labels.items()}


def _numbered(attributes: dict[tuple[int, Side], tuple[str, ...]]) -> dict[tuple[str, ...], int]:
    """Numbers of boundary attributes, from 1, by the labels that they stand for."""
    groups = list(dict.fromkeys(attributes.values()))
    numbers: dict[tuple[str, ...], int] = {}
    for names in groups:
        found = ATTRIBUTE.fullmatch(names[0]) if len(names) == 1 else None
        if found:
            numbers[names] = int(found[1])
    free = (n for n in range(1, len(groups) + len(numbers) + 1) if n not in set(numbers.values()))
    return numbers | {names: next(free) for names in groups if names not in numbers}


def _element_attributes(multipatch: MultiPatch) -> list[str]:
    kept = [b.text.split() for b in multipatch.blocks if (b.format, b.kind) == (NAME, "element attributes")]
    if kept and len(kept[0]) == len(multipatch):
        return kept[0]
    if kept:
        lost = f"attributes of {len(kept[0])} elements in the file read do not fit {len(multipatch)} patches; left out"
        warnings.warn(lost, InputWarning, stacklevel=4)
    return ["1"] * len(multipatch)


def _patch_lines(patch: Patch) -> list[str]:
    weights = np.ones(patch.shape) if patch.weights is None else patch.weights
    rows = np.concatenate([patch.control_points, weights[..., None]], axis=2).transpose(1, 0, 2).reshape(-1, 3)
    knots = [
        f"{p} {n} " + " ".join(map(repr, t.tolist()))
        for t, p, n in zip(patch.knots, patch.degrees, patch.shape, strict=True)
    ]
    points = [" ".join(map(repr, row)) for row in rows.tolist()]
    return ["knotvectors", "2", *knots, "dimension", "2", "controlpoints_cartesian", *points]
