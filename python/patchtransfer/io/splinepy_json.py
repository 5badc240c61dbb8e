"""Splinepy's and gustaf's JSON: a list of splines, without interfaces.

``u`` runs fastest in ``control_points``, which are Cartesian, also those of NURBS. With ``Base64Encoding`` control
points and weights are the base64 of their bytes. Fields that are not geometry (names, options for drawing) are kept and
written again.
"""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.blocks import Block
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..limits import MAX_BOUNDARY_POINTS, MAX_CONTROL_POINTS, MAX_CURVES, MAX_JSON_LISTS, MAX_PATCHES, at_most
from .foreign import curve_of, patch_of
from .loops import TOLERANCE, chain, close_loop, diameter
from .options import DEFAULT, BoundaryOptions
from .outline_only import OutlineOnlyError

__all__ = ["FORMAT", "format_multipatch", "looks_like_splines", "read_boundary", "read_multipatch"]

FORMAT = "splinepy JSON"
#: Types, and whether they have knots and weights.
TYPES = {"BSpline": (True, False), "NURBS": (True, True), "Bezier": (False, False), "RationalBezier": (False, True)}
#: The field of a document that lists its splines.
LIST = "SplineList"
#: Fields of a document and of a spline that are geometry or follow from it.
DOCUMENT_FIELDS = {"NumberOfSplines", "Base64Encoding", LIST}
SPLINE_FIELDS = {"degrees", "control_points", "knot_vectors", "weights", "SplineType", "dim", "para_dim"}
#: What splinepy calls a list without a name.
NAME = "SplineGroup"
#: Digits of whole numbers: more do not fit into a coordinate, and thousands would take Python long.
MAX_DIGITS = 17


def looks_like_splines(data: bytes) -> bool:
    """Whether it is a JSON object with a list of splines."""
    return data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and b'"' + LIST.encode() + b'"' in data


def read_multipatch(data: bytes) -> MultiPatch:
    """Multi-patch of all surfaces of a file; interfaces are inferred."""
    document = _document(data)
    kinds = _dimensions(document)
    if kinds == {1}:
        raise OutlineOnlyError("holds only curves")
    if kinds != {2}:
        raise InputError(f"holds splines of {_listed(kinds)} parameters; only planar patches, of 2, are supported")
    at_most(len(document[LIST]), MAX_PATCHES, "patches", "split the model")
    patches: list[Patch] = []
    total = 0
    for k, spline in enumerate(document[LIST]):
        fields = _fields(spline, f"spline {k}", document)
        patches.append(patch_of(f"spline {k}", *fields, first_fastest=True))
        total += patches[-1].control_points.size // 2
        at_most(total, MAX_CONTROL_POINTS, "control points", "coarsen the model or split it")
    return MultiPatch(patches, blocks=_rest(document))


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of the curves of a file, in any order and sense, or of its patches."""
    document = _document(data)
    if _dimensions(document) != {1}:
        return Boundary([close_loop(loop) for loop in read_multipatch(data).boundary().loops])
    at_most(len(document[LIST]), MAX_CURVES, "curves", "join them to fewer")
    curves: list[BSplineCurve] = []
    total = 0
    for k, spline in enumerate(document[LIST]):
        degrees, knots, points, weights = _fields(spline, f"spline {k}", document)
        if len(degrees) != 1 or len(knots) != 1:
            raise InputError(f"spline {k}: a curve has one degree and one knot vector; correct it")
        curves.append(curve_of(f"spline {k}", degrees[0], knots[0], points, weights))
        total += len(curves[-1].control_points)
        at_most(total, MAX_BOUNDARY_POINTS, "control points of the boundary", "coarsen it")
    names = [f"spline {k}" for k in range(len(curves))]
    return Boundary(chain(names, curves, TOLERANCE * diameter(curves)))


def _document(data: bytes) -> dict[str, Any]:
    """The parsed document with a list of objects as its splines."""
    # Each takes twenty times its two letters.
    at_most(data.count(b"[") + data.count(b"{"), MAX_JSON_LISTS, "lists and objects", "split the model")
    try:
        document = json.loads(data, parse_constant=_no_number, parse_int=_whole)
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"malformed JSON: {error}") from None
    except RecursionError:
        raise InputError("lists or objects are nested thousands deep; splines need four levels") from None
    splines = document.get(LIST) if isinstance(document, dict) else None
    if not isinstance(splines, list) or not splines:
        raise InputError(f'"{LIST}" is not a list of splines; the file is incomplete')
    for k, spline in enumerate(splines):
        if not isinstance(spline, dict):
            raise InputError(f"spline {k} is not an object; correct it")
    found: dict[str, Any] = document
    return found


def _no_number(name: str) -> Any:
    raise InputError(f"{name} is not a number; give finite numbers")


def _whole(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise InputError(f"{text[:10]}... has {len(text)} digits; write large numbers as 1e20")
    return int(text)


def _dimensions(document: dict[str, Any]) -> set[int]:
    """Numbers of parameters of the splines."""
    return {len(d) if isinstance(d := spline.get("degrees"), list) else 0 for spline in document[LIST]}


def _listed(numbers: Iterable[int]) -> str:
    return " and ".join(str(n) for n in sorted(numbers))


def _fields(
    spline: dict[str, Any], where: str, document: dict[str, Any]
) -> tuple[list[Any], list[Any], ArrayLike, ArrayLike | None]:
    """Degrees, knots, control points and weights (None for a polynomial) of a spline."""
    kind = spline.get("SplineType")
    if not isinstance(kind, str) or kind not in TYPES:
        raise InputError(f"{where}: type {str(kind)[:40]} is not supported; {', '.join(TYPES)} are")
    has_knots, rational = TYPES[kind]
    needed = ["degrees", "control_points", *["knot_vectors"] * has_knots, *["weights"] * rational]
    for name in needed:
        if spline.get(name) is None:
            raise InputError(f'{where}: a {kind} without "{name}"; the file is incomplete')
    degrees = spline["degrees"]
    if has_knots:
        knots = spline["knot_vectors"]
        if not isinstance(knots, list):
            raise InputError(f'{where}: "knot_vectors" is not a list; correct it')
    else:
        knots = [[0.0] * (_count(p) + 1) + [1.0] * (_count(p) + 1) for p in degrees]
    points, weights = spline["control_points"], spline["weights"] if rational else None
    if document.get("Base64Encoding") is True:
        dimension = spline.get("dim")
        if dimension not in (2, 3):
            raise InputError(f'{where}: "dim" is {str(dimension)[:30]}; only models in the plane are supported')
        points = _decoded(points, f"{where}: control points", dimension)
        weights = None if weights is None else _decoded(weights, f"{where}: weights", 1)
    return degrees, knots, points, weights


def _count(degree: Any) -> int:
    """A degree that a list can be as long as; what is none is named later."""
    return degree if isinstance(degree, int) and 1 <= degree <= 100 else 1


def _decoded(text: Any, where: str, dimension: int) -> ArrayLike:
    try:
        values = np.frombuffer(base64.b64decode(text, validate=True), "<f8")
        return values.reshape(-1, dimension)
    except (TypeError, ValueError, binascii.Error):
        raise InputError(f"{where}: not valid base64 of numbers in {dimension} columns; write it again") from None


def _rest(document: dict[str, Any]) -> list[Block]:
    """What the file holds besides geometry, in the shape of the file."""
    rest = {
        key: value for key, value in document.items() if key not in DOCUMENT_FIELDS and (key, value) != ("Name", NAME)
    }
    splines = [
        {key: value for key, value in spline.items() if key not in SPLINE_FIELDS and value != {}}
        for spline in document[LIST]
    ]
    if any(splines):
        rest[LIST] = splines
    return [Block(FORMAT, "fields", _text(rest))] if rest else []


def _kept(mp: MultiPatch) -> dict[str, Any]:
    """The fields that `_rest` put aside."""
    rest: dict[str, Any] = {}
    for block in mp.blocks:
        if block.format == FORMAT:
            try:
                rest |= json.loads(block.text)
            except (ValueError, TypeError, RecursionError):
                raise InputError(f"the block {block.kind!r} is no object in JSON; take it out of the blocks") from None
    return rest


def _text(value: Any) -> str:
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError:
        raise InputError("a number is infinite; correct it") from None


def format_multipatch(mp: MultiPatch) -> str:
    """Splinepy's JSON of the patches, numbers in full.

    The other fields of the file that they came from are those of the patches of the same position.
    """
    rest = _kept(mp)
    given = rest.pop(LIST, [])
    fits = isinstance(given, list) and len(given) == len(mp) and all(isinstance(other, dict) for other in given)
    others = given if fits else [{}] * len(mp)
    document = {"Name": NAME} | rest | {"NumberOfSplines": len(mp), "Base64Encoding": False}
    # A line a spline: a line a number makes files of thousands of pages.
    splines = ",\n".join(
        _text({"show_options": {}} | other | _spline(patch)) for patch, other in zip(mp.patches, others, strict=True)
    )
    return f'{_text(document)[:-1]}, "{LIST}": [\n{splines}\n]}}\n'


def _spline(patch: Patch) -> dict[str, Any]:
    fields: dict[str, Any] = {
        "SplineType": "BSpline" if patch.weights is None else "NURBS",
        "dim": 2,
        "para_dim": 2,
        "degrees": list(patch.degrees),
        "knot_vectors": [knots.tolist() for knots in patch.knots],
        "control_points": patch.control_points.swapaxes(0, 1).reshape(-1, 2).tolist(),
    }
    if patch.weights is not None:
        fields["weights"] = patch.weights.T.reshape(-1, 1).tolist()
    return fields
