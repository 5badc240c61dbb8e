"""nutils: a multipatch topology with a knot span an element, and the geometry on it, exact.

nutils tells sides by their two corners, glues those with the same, and wants glued sides to run in the same sense.
In the plane they can: the directions across a row of patches are turned together. But two sides with the same two
corners are one to nutils, whether they are glued or not.
"""

from __future__ import annotations

import warnings
from collections import Counter
from math import comb
from typing import Any

import numpy as np

from ..errors import InputWarning
from ..geometry.basis import knot_spans
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import CORNERS, Side
from ..geometry.strips import strips
from ..io.vtu import bezier_pieces
from ..libraries import library
from ..numeric.arrays import FloatArray, IntArray

__all__ = ["to_nutils"]

#: Names of sides at the first and the last parameter, by the direction across them.
NAMES = (("left", "right"), ("bottom", "top"))
#: Sides that no label can be taken for.
OUTLINE = "outline"


def to_nutils(mp: MultiPatch) -> tuple[Any, Any]:
    """See `MultiPatch.to_nutils`."""
    mesh = library("nutils.mesh", user="to_nutils")
    turned = _turns(mp)
    corners = np.array([_corners(mp.topology.points[k], turned[k]) for k in range(len(mp))])
    coupled = not any(strip.twisted for strip in strips(mp.topology)) and _tells_sides(mp, corners, turned)
    if not coupled:
        what = (
            "nutils would glue sides that are not glued here, since they have the same two corners; patches are left "
            f"apart: no basis is continuous across them, and the boundary is domain.boundary[{OUTLINE!r}]"
        )
        warnings.warn(what, InputWarning, stacklevel=4)
        corners = np.arange(4 * len(mp)).reshape(-1, 2, 2)
    else:
        # Numbers without gaps, as nutils wants them.
        corners = np.unique(corners, return_inverse=True)[1].reshape(-1, 2, 2)
    domain, _ = mesh.multipatch(corners, nelems=_spans(mp, corners))
    groups = {} if coupled else {OUTLINE: [(k, side) for k, side in mp.boundaries]}
    groups |= _labels(mp)
    names = {
        name: ",".join(f"patch{k}-{_name(side, turned[k])}" for k, side in sides)
        for name, sides in groups.items()
        if sides
    }
    if names:
        domain = domain.withboundary(**names)
    return domain, _geometry(domain, mp, turned)


def _turns(mp: MultiPatch) -> list[tuple[bool, bool]]:
    """Whether u and v of each patch are turned around, so that glued sides run alike."""
    against = {member: flipped for strip in strips(mp.topology) for member, flipped in strip.members.items()}
    return [(against[k, 0], against[k, 1]) for k in range(len(mp))]


def _corners(points: IntArray, turned: tuple[bool, bool]) -> IntArray:
    """Shared points (2, 2) at the ends of u and v, turned."""
    found = np.empty((2, 2), np.int64)
    for i, j in CORNERS:
        found[int((i == -1) != turned[0]), int((j == -1) != turned[1])] = points[i, j]
    return found


def _tells_sides(mp: MultiPatch, corners: IntArray, turned: list[tuple[bool, bool]]) -> bool:
    """Whether sides with the same corners are those that are glued."""
    glued = {(f.patch_a, f.side_a): i for i, f in enumerate(mp.interfaces)}
    glued |= {(f.patch_b, f.side_b): i for i, f in enumerate(mp.interfaces)}
    count: Counter[frozenset[int]] = Counter()
    owners: dict[frozenset[int], set[int]] = {}
    for k in range(len(mp)):
        for side in Side:
            across = 1 - side.axis
            ends = corners[k].take(int(side.at_end != turned[k][across]), axis=across)
            key = frozenset(ends.tolist())
            count[key] += 1
            owners.setdefault(key, set()).add(glued.get((k, side), -1))
    return all(count[key] == 1 or (count[key] == 2 and len(who) == 1 and -1 not in who) for key, who in owners.items())


def _spans(mp: MultiPatch, corners: IntArray) -> dict[tuple[int, int], int]:
    """Numbers of elements by the two corners of the sides."""
    found: dict[tuple[int, int], int] = {}
    for patch, ((a, b), (c, d)) in zip(mp, corners.tolist(), strict=True):
        m, n = (len(knot_spans(knots)) - 1 for knots in patch.knots)
        found |= {(a, c): m, (b, d): m, (a, b): n, (c, d): n}
    return found


def _name(side: Side, turned: tuple[bool, bool]) -> str:
    across = 1 - side.axis
    return NAMES[across][int(side.at_end != turned[across])]


def _labels(mp: MultiPatch) -> dict[str, list[tuple[int, Side]]]:
    """Labelled sides of the boundary by names that nutils can look up."""
    boundary = set(mp.boundaries)
    labels: dict[str, list[tuple[int, Side]]] = {}
    for name, sides in mp.sides.items():
        # A comma separates names there.
        known = name.replace(",", " ")
        while known in labels or known == OUTLINE:
            known += "'"
        if known != name:
            warnings.warn(f"label {name!r} is {known!r} in nutils", InputWarning, stacklevel=5)
        labels[known] = [where for where in sides if where in boundary]
        if len(labels[known]) < len(sides):
            inside = ", ".join(f"patch {k} {side.name.lower()}" for k, side in sides if (k, side) not in boundary)
            what = f"label {name!r}: nutils names sides of the boundary only; left out: {inside}"
            warnings.warn(what, InputWarning, stacklevel=5)
    return labels


def _geometry(domain: Any, mp: MultiPatch, turned: list[tuple[bool, bool]]) -> Any:
    """The geometry, by the Bézier control points of every element: rational of the highest degree of all."""
    degree = max(max(patch.degrees) for patch in mp)
    pieces = [_pieces(patch, turns, degree) for patch, turns in zip(mp, turned, strict=True)]
    h = np.concatenate([piece.reshape(-1, 3) for piece in pieces])
    basis = domain.basis("discont", degree=degree)
    if not mp.is_rational:
        return basis @ h[:, :2]
    return (basis @ h[:, :2]) / (basis @ h[:, 2])


def _pieces(patch: Patch, turned: tuple[bool, bool], degree: int) -> FloatArray:
    """Homogeneous Bézier points (m, n, degree + 1, degree + 1, 3) of the knot spans of a turned patch."""
    pieces = bezier_pieces(patch, patch.control_points)
    along_u, along_v = (_elevation(p, degree) for p in patch.degrees)
    raised = np.einsum("ai,bj,mnijk->mnabk", along_u, along_v, pieces)
    for axis in (0, 1):
        if turned[axis]:
            raised = np.flip(raised, (axis, axis + 2))
    return np.asarray(raised)


def _elevation(p: int, degree: int) -> FloatArray:
    """Bézier points of the higher degree (degree + 1, p + 1)."""
    return np.array(
        [
            [
                comb(p, j) * comb(degree - p, i - j) / comb(degree, i) if 0 <= i - j <= degree - p else 0.0
                for j in range(p + 1)
            ]
            for i in range(degree + 1)
        ]
    )
