"""NumPy's `.npz`, ours: models and boundaries to the bit, and faster than text.

A file holds one array a key, those of all patches one after another, so that a model of thousands of patches is a dozen
arrays. ``numpy.load(path)`` reads them:

==================  =============  =====================================================================
key                 type           holds
==================  =============  =====================================================================
``patchtransfer``   int            the version of the format, 1
``degrees``         (n, 2) int     degrees of the patches (u, v); (n, 1) of curves
``counts``          (n, 2) int     numbers of control points along u and v; (n, 1) of curves
``rational``        (n,) bool      whether a patch or curve has weights
``knots``           (...) float    knots of the first patch in u, in v, of the second in u, ...
``control_points``  (..., 2) float  of the first patch with v fastest, of the second, ...
``weights``         (...) float    those of the rational ones, in the same order
``ids``             (n,) int       numbers of the patches in the file they came from
``interfaces``      (m, 5) int     patch and side, patch and side, whether they run against each other
``loops``           (k,) int       of a boundary: numbers of curves of its loops
``texts``           (...) uint8    JSON: ``kind`` (multipatch or boundary), ``labels``, ``blocks``, ``notes``
==================  =============  =====================================================================
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.blocks import Block
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import Interface, Side
from ..limits import (
    LARGEST,
    MAX_ALONG,
    MAX_BOUNDARY_POINTS,
    MAX_CONTROL_POINTS,
    MAX_CURVES,
    MAX_DEGREE,
    MAX_JSON_LISTS,
    MAX_LOOPS,
    MAX_PATCHES,
    at_most,
    first_unusable,
)
from ..numeric.arrays import FloatArray, IntArray
from .loops import close_loop
from .options import DEFAULT, BoundaryOptions
from .outline_only import OutlineOnlyError
from .safe_npz import arrays_of

__all__ = ["format_boundary", "format_multipatch", "looks_like_npz", "read_boundary", "read_multipatch"]

VERSION = 1
#: Arrays of either kind, and the kinds of numbers they hold.
SHARED = {"degrees": "iu", "counts": "iu", "rational": "b", "knots": "f", "control_points": "f", "weights": "f"}
OWN = {"multipatch": {"ids": "iu", "interfaces": "iu"}, "boundary": {"loops": "iu"}}


def looks_like_npz(data: bytes) -> bool:
    """Whether it is a zip archive, as NumPy's are."""
    return data.startswith(b"PK\x03\x04")


def format_multipatch(mp: MultiPatch) -> bytes:
    """Contents of a file with everything that a multi-patch has."""
    texts = {
        "labels": {name: [[k, int(side)] for k, side in where] for name, where in mp.sides.items()},
        "blocks": [asdict(block) for block in mp.blocks],
    }
    rows = [[f.patch_a, f.side_a, f.patch_b, f.side_b, f.reversed] for f in mp.interfaces]
    return _archive(
        "multipatch",
        [(patch.knots, patch.degrees, patch.control_points, patch.weights) for patch in mp.patches],
        texts,
        ids=np.array(mp.ids, np.int64),
        interfaces=np.array(rows, np.int64).reshape(-1, 5),
    )


def format_boundary(boundary: Boundary) -> bytes:
    """Contents of a file with the curves and notes of a boundary."""
    curves = [curve for loop in boundary.loops for curve in loop]
    return _archive(
        "boundary",
        [((c.knots,), (c.degree,), c.control_points, c.weights) for c in curves],
        {"notes": list(boundary.notes)},
        loops=np.array([len(loop) for loop in boundary.loops], np.int64),
    )


def _archive(
    kind: str,
    splines: Sequence[tuple[Sequence[FloatArray], Sequence[int], FloatArray, FloatArray | None]],
    texts: dict[str, Any],
    **own: IntArray,
) -> bytes:
    stream = BytesIO()
    np.savez(
        stream,
        patchtransfer=np.int64(VERSION),
        degrees=np.array([degrees for _, degrees, _, _ in splines], np.int64),
        counts=np.array([points.shape[:-1] for _, _, points, _ in splines], np.int64),
        rational=np.array([weights is not None for *_, weights in splines]),
        knots=np.concatenate([k for knots, _, _, _ in splines for k in knots]),
        control_points=np.concatenate([points.reshape(-1, 2) for _, _, points, _ in splines]),
        weights=np.concatenate([np.empty(0), *(w.ravel() for *_, w in splines if w is not None)]),
        # Escapes keep what UTF-8 cannot: halves of letters, which names from files may hold.
        texts=np.frombuffer(json.dumps({"kind": kind} | texts).encode("ascii"), np.uint8),
        allow_pickle=False,
        **own,
    )
    return stream.getvalue()


def read_multipatch(data: bytes) -> MultiPatch:
    """Multi-patch of a file; see `patchtransfer.read`."""
    kind, arrays, texts = _contents(data)
    if kind != "multipatch":
        raise OutlineOnlyError("holds only a boundary")
    return _multipatch(arrays, texts)


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of a file, that of its patches if it has some; see `patchtransfer.read_boundary`."""
    kind, arrays, texts = _contents(data)
    if kind == "multipatch":
        return Boundary([close_loop(loop) for loop in _multipatch(arrays, texts).boundary().loops])
    at_most(len(arrays["degrees"]), MAX_CURVES, "curves", "join them to fewer")
    at_most(len(arrays["control_points"]), MAX_BOUNDARY_POINTS, "control points of the boundary", "coarsen it")
    sizes = _column(arrays, "loops", 1)
    at_most(len(sizes), MAX_LOOPS, "loops", "keep those of the domain")
    curves = [
        BSplineCurve(knots[0], degrees[0], points, weights) for knots, degrees, points, weights in _splines(arrays, 1)
    ]
    if (sizes < 1).any() or sum(sizes.tolist()) != len(curves):
        raise InputError(f"loops: numbers of curves do not add up to {len(curves)}; write the file again")
    notes = texts.get("notes", [])
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise InputError("texts: notes are not a list of texts; write the file again")
    ends = np.cumsum(sizes).tolist()
    return Boundary([curves[a:b] for a, b in zip([0, *ends[:-1]], ends, strict=True)], notes)


def _contents(data: bytes) -> tuple[str, dict[str, NDArray[Any]], dict[str, Any]]:
    """Kind of a file, its arrays by name, and its texts."""
    arrays = arrays_of(data)
    version = arrays.get("patchtransfer")
    if version is None:
        known = ", ".join(sorted(arrays))[:80] or "none"
        hint = "; of splinepy's files, load it there and use MultiPatch.from_splinepy"
        raise InputError(f"is not a file that patchtransfer wrote: its arrays are {known}{hint}")
    if version.dtype.kind not in "iu" or version.ndim or version != VERSION:
        raise InputError(f"has version {str(version)[:20]} of the format, known is {VERSION}; update patchtransfer")
    _check_arrays(arrays, {"texts": "u"})
    encoded = arrays["texts"].astype(np.uint8).tobytes()
    at_most(encoded.count(b"[") + encoded.count(b"{"), MAX_JSON_LISTS, "lists and objects", "split the model")
    try:
        texts = json.loads(encoded)
        kind = texts["kind"]
        needed = SHARED | OWN[kind]
    except (ValueError, RecursionError, KeyError, TypeError):
        raise InputError("texts: not an object in JSON with a known kind; write the file again") from None
    _check_arrays(arrays, needed)
    return kind, arrays, texts


def _check_arrays(arrays: dict[str, NDArray[Any]], kinds: dict[str, str]) -> None:
    """Raise `InputError` on arrays that are missing, or of other kinds of numbers."""
    for key, known in kinds.items():
        if key not in arrays:
            raise InputError(f"the array {key!r} is missing; write the file again")
        if arrays[key].dtype.kind not in known:
            raise InputError(f"the array {key!r} holds {arrays[key].dtype}; write the file again")


def _column(arrays: dict[str, NDArray[Any]], name: str, dimensions: int, width: int | None = None) -> IntArray:
    """An array of whole numbers of a shape."""
    array = arrays[name]
    if array.ndim != dimensions or (width is not None and array.shape[1] != width):
        raise InputError(f"the array {name!r} has shape {array.shape}; write the file again")
    if array.size and (array.max() > 2**62 or array.min() < -(2**62)):
        raise InputError(f"the array {name!r} has a number of more than 18 digits; write the file again")
    return array.astype(np.int64)


def _splines(
    arrays: dict[str, NDArray[Any]], directions: int
) -> list[tuple[list[FloatArray], list[int], FloatArray, FloatArray | None]]:
    """Knots, degrees, control points and weights of every patch or curve."""
    degrees, counts = (_column(arrays, name, 2, directions) for name in ("degrees", "counts"))
    rational, knots, points, weights = (arrays[name] for name in ("rational", "knots", "control_points", "weights"))
    n = len(degrees)
    if len(counts) != n or rational.shape != (n,) or not n:
        raise InputError("degrees, counts and rational are not of as many splines; write the file again")
    at_most(int(degrees.max()), MAX_DEGREE, "as degree", "lower it")
    along = MAX_ALONG if directions == 2 else MAX_BOUNDARY_POINTS
    at_most(int(counts.max()), along, "control points in one direction", "coarsen the model")
    if degrees.min() < 1 or counts.min() < 1:
        raise InputError("a degree or a number of control points is not positive; write the file again")
    sizes = counts.prod(axis=1)
    expected = {
        "knots": (int((counts + degrees + 1).sum()),),
        "control_points": (int(sizes.sum()), 2),
        "weights": (int(sizes[rational].sum()),),
    }
    for name, shape in expected.items():
        if arrays[name].shape != shape:
            raise InputError(f"the array {name!r} has shape {arrays[name].shape}, needed is {shape}; write it again")
        if first_unusable(arrays[name]) is not None:
            raise InputError(f"the array {name!r} holds NaN, infinity or a number above {LARGEST:g}; correct it")
    knots, points, weights = (array.astype(np.float64) for array in (knots, points, weights))
    return _cut(degrees, counts, rational, knots, points, weights)


def _cut(
    degrees: IntArray,
    counts: IntArray,
    rational: NDArray[np.bool_],
    knots: FloatArray,
    points: FloatArray,
    weights: FloatArray,
) -> list[tuple[list[FloatArray], list[int], FloatArray, FloatArray | None]]:
    """The pieces of arrays that are as long as they must be."""
    splines = []
    at_knot = at_point = at_weight = 0
    for p, shape, has_weights in zip(degrees.tolist(), counts.tolist(), rational.tolist(), strict=True):
        own = []
        for degree, count in zip(p, shape, strict=True):
            own.append(knots[at_knot : at_knot + count + degree + 1])
            at_knot += count + degree + 1
        size = int(np.prod(shape))
        net = points[at_point : at_point + size].reshape(*shape, 2)
        w = weights[at_weight : at_weight + size].reshape(shape) if has_weights else None
        at_point += size
        at_weight += size * has_weights
        splines.append((own, p, net, w))
    return splines


def _multipatch(arrays: dict[str, NDArray[Any]], texts: dict[str, Any]) -> MultiPatch:
    at_most(len(arrays["degrees"]), MAX_PATCHES, "patches", "split the model")
    at_most(len(arrays["control_points"]), MAX_CONTROL_POINTS, "control points", "coarsen the model or split it")
    patches = [Patch(knots, degrees, points, weights) for knots, degrees, points, weights in _splines(arrays, 2)]
    rows = _column(arrays, "interfaces", 2, 5)
    at_most(len(rows), 2 * len(patches), "interfaces of patches with four sides each", "write the file again")
    if not np.isin(rows[:, [1, 3]], [side.value for side in Side]).all() or not np.isin(rows[:, 4], (0, 1)).all():
        raise InputError("interfaces: a side is not 1, 2, 3 or 4, or a sense not 0 or 1; write the file again")
    interfaces = [Interface(a, Side(s), b, Side(t), bool(backwards)) for a, s, b, t, backwards in rows.tolist()]
    ids = _column(arrays, "ids", 1).tolist()
    if len(ids) != len(patches):
        raise InputError(f"{len(ids)} ids for {len(patches)} patches; write the file again")
    return MultiPatch(patches, interfaces, ids, _labels(texts), _blocks(texts))


def _labels(texts: dict[str, Any]) -> dict[str, list[tuple[int, int]]]:
    labels = texts.get("labels", {})
    try:
        pairs = {name: [(k, side) for k, side in where] for name, where in labels.items()}
        good = all(type(k) is int and type(side) is int for where in pairs.values() for k, side in where)
    except (AttributeError, TypeError, ValueError):
        good = False
    if not good:
        raise InputError("texts: labels are not lists of a patch and a side; write the file again")
    return pairs


def _blocks(texts: dict[str, Any]) -> list[Block]:
    # By the names of the fields, so that a block keeps those that it may get.
    kinds = {field.name: field.type for field in fields(Block)}
    try:
        blocks = [Block(**block) for block in texts.get("blocks", [])]
        good = all(type(getattr(block, name)).__name__ == kind for block in blocks for name, kind in kinds.items())
    except TypeError:
        good = False
    if not good:
        raise InputError("texts: blocks are not objects of texts; write the file again")
    return blocks
