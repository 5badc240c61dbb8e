"""G+Smo XML: multi-patches, planar domains and loose curves.

Conventions of the format, checked against G+Smo's reader: ``u`` runs fastest in ``coefs``; coefficients of
NURBS are Cartesian, their ``weights`` stand in the basis; sides are 1 u=0, 2 u=1, 3 v=0, 4 v=1; an
interface is a row ``p1 s1 p2 s2 dirMap0 dirMap1 orient0 orient1``. Its patches are `id`s where the reader
is concerned, but some writers put positions. In the plane ``dirMap`` follows from the sides, and so does
``orient`` across the interface (1 for different ends in older files, 1 for equal ends in newer ones), so
only ``orient`` along it is used.
"""

from __future__ import annotations

import base64
import binascii
import re
import warnings
from collections.abc import Iterable, Sequence
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InputError, InputWarning
from ..geometry.boundary import Boundary
from ..geometry.coincidences import fitting
from ..geometry.curve import BSplineCurve
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import Interface, Side
from ..limits import (
    MAX_ALONG,
    MAX_BOUNDARY_POINTS,
    MAX_CONTROL_POINTS,
    MAX_CURVES,
    MAX_DEGREE,
    MAX_LOOPS,
    MAX_PATCHES,
    at_most,
)
from ..numeric.arrays import FloatArray
from .loops import TOLERANCE, chain, check_curves, clamp, close_loop, diameter, in_order
from .options import DEFAULT, BoundaryOptions
from .outline_only import OutlineOnlyError
from .safe_xml import parse_xml

__all__ = ["format_boundary", "format_multipatch", "read_boundary", "read_multipatch"]

PATCH_TYPES = {"TensorBSpline2": False, "TensorNurbs2": True}
CURVE_TYPES = {"BSpline": False, "Nurbs": True, "TensorBSpline1": False, "TensorNurbs1": True}
"""Geometry types that are read, and whether they are rational."""

BINARY = {
    f"b64{kind}{bits}": np.dtype(f"<{kind[0]}{bits // 8}")
    for kind, sizes in (("float", (32, 64)), ("int", (16, 32, 64)), ("uint", (16, 32, 64)))
    for bits in sizes
}


#: Digits and signs of whole numbers: longer ones name nothing and do not fit into 64 bits.
MAX_DIGITS = 18


def _attribute(element: Element, name: str, where: str) -> str:
    value = element.get(name)
    if value is None:
        raise InputError(f"{where}: <{element.tag}> has no attribute {name}; add it")
    return value.strip()


def _integer(text: str, where: str) -> int:
    try:
        value = int(text) if len(text) <= MAX_DIGITS else None
    except ValueError:
        value = None
    if value is None:
        raise InputError(f"{where}: {text[:30]!r} is not a whole number; correct it")
    return value


def _integers(element: Element | None, where: str) -> list[int]:
    return [] if element is None else [_integer(token, where) for token in "".join(element.itertext()).split()]


def _number(token: str) -> float:
    """Return the value of a decimal or of a fraction such as 2/5."""
    if "_" in token:
        raise ValueError
    above, slash, below = token.partition("/")
    return float(above) / float(below) if slash else float(above)


def _numbers(element: Element, where: str) -> FloatArray:
    """All numbers of an element, written as text or in base64."""
    text = "".join(element.itertext())
    flag = element.get("format", "ascii").strip().lower()
    if flag != "ascii":
        if flag not in BINARY:
            raise InputError(f"{where}: unknown number format {flag!r} of <{element.tag}>; write it as ASCII")
        try:
            values = np.frombuffer(base64.b64decode(text), BINARY[flag]).astype(np.float64)
        except (ValueError, binascii.Error) as error:
            raise InputError(f"{where}: <{element.tag}> is not valid base64 ({error}); write it again") from None
        return _bounded(values, element, where)
    tokens = text.split()
    for convert in (float, _number) if "_" not in text else (_number,):
        try:
            values = np.array([convert(t) for t in tokens], dtype=np.float64)
        except (ValueError, ZeroDivisionError):
            continue
        break
    else:
        bad = next(t for t in tokens if not _is_number(t))
        raise InputError(f"{where}: {bad[:30]!r} in <{element.tag}> is not a number; correct it")
    return _bounded(values, element, where)


def _bounded(values: FloatArray, element: Element, where: str) -> FloatArray:
    """Return the values if their squares do not overflow; the comparison also refuses NaN."""
    good = np.abs(values) <= 1e150
    if not good.all():
        bad = f"number {int(np.argmin(good)) + 1} ({values[np.argmin(good)]:g})"
        raise InputError(f"{where}: {bad} in <{element.tag}> is NaN, infinite or above 1e150; correct it")
    return values


def _is_number(token: str) -> bool:
    try:
        _number(token)
    except (ValueError, ZeroDivisionError):
        return False
    return True


def _counted(element: Element | None, tag: str, shape: Sequence[int], where: str) -> FloatArray:
    if element is None:
        raise InputError(f"{where}: <{tag}> is missing; the file is incomplete")
    values = _numbers(element, where)
    expected = int(np.prod(shape))
    if len(values) != expected:
        raise InputError(
            f"{where}: <{tag}> has {len(values)} numbers, its knots and degrees need {expected} "
            f"({' x '.join(map(str, shape))}); numbers are missing or surplus"
        )
    return values.reshape(shape)


def _knots(basis: Element, where: str) -> tuple[FloatArray, int]:
    element = basis if basis.tag == "KnotVector" else basis.find("KnotVector")
    if element is None:
        raise InputError(f"{where}: a basis without <KnotVector>; the file is incomplete")
    degree = _integer(_attribute(element, "degree", where), where)
    if degree < 1:
        raise InputError(f"{where}: degree {degree} is not supported; it must be at least 1")
    at_most(degree, MAX_DEGREE, f"as degree of {where}", "lower it")
    if element.get("mode", "").strip() == "uniform":
        count = _integer(_attribute(element, "csize", where), where)
        at_most(count, MAX_BOUNDARY_POINTS, f"as csize of {where}", "coarsen it")
        if not degree < count:
            raise InputError(f"{where}: csize {count} does not fit degree {degree}; correct it")
        inner = np.linspace(0.0, 1.0, count - degree + 1)
        return np.concatenate([np.zeros(degree), inner, np.ones(degree)]), degree
    knots = _numbers(element, where)
    if len(knots) < 2 * degree + 2:
        raise InputError(f"{where}: {len(knots)} knots are too few for degree {degree}; {2 * degree + 2} are needed")
    if (np.diff(knots) < 0).any():
        raise InputError(f"{where}: the knots decrease at number {int(np.argmax(np.diff(knots) < 0)) + 2}; sort them")
    return knots, degree


def _label(geometry: Element, position: int) -> str:
    kind, id_ = geometry.get("type", "without type")[:40], geometry.get("id")
    return f"Geometry {'number ' + str(position + 1) if id_ is None else 'id=' + id_.strip()[:40]} ({kind})"


def _tensor(geometry: Element, where: str, directions: int, rational: bool) -> tuple[
    list[FloatArray], list[int], FloatArray, FloatArray | None
]:  # fmt: skip
    """Knots, degrees, coefficients with one axis a direction (first runs fastest in the file), weights."""
    basis = geometry.find("Basis")
    if basis is None:
        raise InputError(f"{where}: <Basis> is missing; the file is incomplete")
    if geometry.find("transform") is not None:
        raise InputError(f"{where}: <transform> is not supported; apply it to the coefficients")
    univariate = [b for b in basis.iter("Basis") if b.find("KnotVector") is not None]
    if len(univariate) != directions:
        raise InputError(f"{where}: {len(univariate)} knot vectors instead of {directions}; it is not planar")
    knots, degrees = (list(x) for x in zip(*(_knots(b, where) for b in univariate), strict=True))
    counts = [len(k) - p - 1 for k, p in zip(knots, degrees, strict=True)][::-1]
    coefs = geometry.find("coefs")
    dimension = 2 if coefs is None else _integer(_attribute(coefs, "geoDim", where), where)
    if dimension not in (2, 3):
        raise InputError(f"{where}: geoDim {dimension} is not planar; only models in the plane are supported")
    if coefs is not None and coefs.get("order", "").strip() == "coordinates":
        points = np.moveaxis(_counted(coefs, "coefs", [dimension, *counts], where), 0, -1)
    else:
        points = _counted(coefs, "coefs", [*counts, dimension], where)
    if dimension == 3 and (points[..., 2] != 0).any():
        raise InputError(f"{where}: lies in space (z is not 0); only models in the plane are supported")
    axes = tuple(range(directions))[::-1]
    points = points[..., :2].transpose(*axes, directions)
    weights = None
    if rational:
        weights = _counted(basis.find("weights"), "weights", counts, where).transpose(axes)
        if (weights <= 0).any():
            raise InputError(f"{where}: weight {weights.min():g} is not positive; correct it")
    for axis, (k, p) in enumerate(zip(knots, degrees, strict=True)):
        if k[p] != k[0] or k[-p - 1] != k[-1]:
            if not k[p] < k[-p - 1]:
                raise InputError(f"{where}: the knots span nothing; correct them")
            h = points if weights is None else np.concatenate([points * weights[..., None], weights[..., None]], -1)
            knots[axis], h = clamp(k, p, np.moveaxis(h, axis, 0))
            h = np.moveaxis(h, 0, axis)
            points, weights = (h, None) if weights is None else (h[..., :2] / h[..., 2:], h[..., 2])
    return knots, degrees, points, weights


def _patch(geometry: Element, position: int) -> Patch:
    where, kind = _label(geometry, position), geometry.get("type", "")
    if kind not in PATCH_TYPES:
        raise InputError(f"{where}: {_refusal(kind)}")
    knots, degrees, points, weights = _tensor(geometry, where, 2, PATCH_TYPES[kind])
    at_most(max(points.shape), MAX_ALONG, f"control points in one direction of {where}", "coarsen it")
    try:
        return Patch(knots, degrees, points, weights)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _curve(geometry: Element, where: str) -> BSplineCurve:
    kind = geometry.get("type", "")
    if kind not in CURVE_TYPES:
        raise InputError(f"{where}: {_refusal(kind)}")
    knots, degrees, points, weights = _tensor(geometry, where, 1, CURVE_TYPES[kind])
    try:
        return BSplineCurve(knots[0], degrees[0], points, weights)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _refusal(kind: str) -> str:
    if re.match(r"T?HB|HTensor|Truncated", kind):
        return "hierarchical splines are not supported; convert to tensor-product patches"
    if re.search(r"[34]$", kind):
        return "volumes are not supported; only planar patches are"
    supported = ", ".join([*PATCH_TYPES, *CURVE_TYPES])
    return f"geometry type {kind[:40] or '(none)'} is not supported here; {supported} are"


def read_multipatch(data: bytes) -> MultiPatch:
    """Multi-patch of a G+Smo XML file; see `patchtransfer.read`."""
    return _multipatch(parse_xml(data))


def _multipatch(root: Element) -> MultiPatch:
    geometries = list(enumerate(root.findall("Geometry")))
    blocks = root.findall("MultiPatch")
    if not blocks:
        chosen = [(k, g) for k, g in geometries if g.get("type") not in CURVE_TYPES]
        if not chosen:
            if geometries or _domains(root):
                raise OutlineOnlyError("holds only curves")
            raise InputError("holds no Geometry")
        names = [g.get("id", "").strip() for _, g in chosen]
        usable = len(set(names)) == len(names) and all(re.fullmatch(r"-?[0-9]{1,17}", name) for name in names)
        patches = _patches(chosen)
        return MultiPatch(patches, None, [int(name) for name in names] if usable else None)
    if len(blocks) > 1:
        doubt = f"the file holds {len(blocks)} MultiPatch blocks; the first is read"
        warnings.warn(doubt, InputWarning, stacklevel=4)
    block, where = blocks[0], "MultiPatch"
    dimension = block.get("parDim", "2").strip()
    if dimension != "2":
        raise InputError(f"{where}: parDim {dimension} is not supported; only planar patches are")
    by_id: dict[int, tuple[int, Element]] = {}
    for k, g in geometries:
        if (text := g.get("id")) is not None and by_id.setdefault(_integer(text, where), (k, g)) != (k, g):
            raise InputError(f"two geometries have the id {text.strip()}; renumber one")
    ids = _patch_ids(block, len(geometries))
    for i in ids:
        if i not in by_id:
            raise InputError(f"{where}: there is no Geometry with id {i}; correct <patches>")
    return _glue(_patches([by_id[i] for i in ids]), ids, block)


def _patches(chosen: list[tuple[int, Element]]) -> list[Patch]:
    """Patches of geometries and their positions in the file."""
    at_most(len(chosen), MAX_PATCHES, "patches", "split the model")
    patches, total = [], 0
    for k, geometry in chosen:
        patches.append(_patch(geometry, k))
        total += patches[-1].control_points.size // 2
        at_most(total, MAX_CONTROL_POINTS, "control points", "coarsen the model or split it")
    return patches


def _curves(names: Sequence[str], geometries: Sequence[Element]) -> list[BSplineCurve]:
    at_most(len(geometries), MAX_CURVES, "curves", "join them to fewer")
    curves, total = [], 0
    for name, geometry in zip(names, geometries, strict=True):
        curves.append(_curve(geometry, name))
        total += len(curves[-1].control_points)
        at_most(total, MAX_BOUNDARY_POINTS, "control points of the boundary", "coarsen it")
    return curves


def _patch_ids(block: Element, available: int) -> list[int]:
    element = block.find("patches")
    if element is None:
        raise InputError("MultiPatch: <patches> is missing; the file is incomplete")
    kind, values = element.get("type", "").strip(), _integers(element, "MultiPatch patches")
    if kind == "id_index":
        ids = values
    elif kind == "id_range" and len(values) == 2:
        # A range is bounded before it is expanded.
        if not 0 <= values[1] - values[0] < available:
            raise InputError(f"MultiPatch: patches {values[0]} to {values[1]}, but there are {available} geometries")
        ids = list(range(values[0], values[1] + 1))
    else:
        raise InputError("MultiPatch: <patches> must be an id_range of two ids or an id_index; correct it")
    if len(set(ids)) != len(ids) or not ids:
        raise InputError("MultiPatch: <patches> is empty or names a patch twice; correct it")
    return ids


def _glue(patches: list[Patch], ids: list[int], block: Element) -> MultiPatch:
    """Multi-patch with the interfaces of a block, inferred ones if it says nothing about them."""
    rows = [_integers(e, "MultiPatch interfaces") for e in block.findall("interfaces")]
    values = [i for row in rows for i in row]
    if len(values) % 8:
        raise InputError(f"MultiPatch interfaces: {len(values)} numbers are not rows of 8; the file is incomplete")
    if not values:
        sides = sum(len(_integers(e, "MultiPatch boundary")) for e in block.findall("boundary")) // 2
        # All sides listed as boundary says "no interfaces"; nothing listed says nothing.
        return MultiPatch(patches, () if sides == 4 * len(patches) else None, ids)
    table = np.array(values).reshape(-1, 8)
    if not np.isin(table[:, [1, 3]], [s.value for s in Side]).all():
        raise InputError("MultiPatch interfaces: a side is not 1, 2, 3 or 4; correct it")
    named = set(table[:, [0, 2]].ravel().tolist())
    position_of_id = {i: k for k, i in enumerate(ids)}
    meanings = [m for m in (position_of_id, {k: k for k in range(len(ids))}) if named <= m.keys()]
    if not meanings:
        stray = sorted(named - position_of_id.keys())[0]
        raise InputError(f"MultiPatch interfaces: there is no patch {stray}; correct the row")
    errors, doubtful = [], []
    for position in meanings:
        interfaces = []
        for p, s, q, t, _, _, *orient in table.tolist():
            a, b, side_a, side_b = position[p], position[q], Side(s), Side(t)
            backwards = _backwards(patches[a], side_a, patches[b], side_b, not orient[side_a.axis])
            interfaces.append(Interface(a, side_a, b, side_b, backwards))
        try:
            fit, wrong = fitting(patches, interfaces)
        except InputError as error:
            errors.append(error)
            continue
        if not wrong:
            return MultiPatch(patches, fit, ids)
        doubtful.append((fit, wrong))
    if not doubtful:
        raise errors[0]
    fit, wrong = doubtful[0]
    warnings.warn(wrong, InputWarning, stacklevel=5)
    return MultiPatch(patches, fit, ids)


def _backwards(a: Patch, side_a: Side, b: Patch, side_b: Side, flag: bool) -> bool:
    """Whether two sides run in opposite directions: as their control points say, by the flag if they fit both ways.

    Programs disagree on what the orientation flags of an interface mean, but not on where the sides are.
    """
    points_a, points_b = side_a.of(a.control_points), side_b.of(b.control_points)
    if len(points_a) != len(points_b):
        return flag
    along, against = (float(np.abs(points_a - points).max()) for points in (points_b, points_b[::-1]))
    return flag if along == against else against < along


def _domains(root: Element) -> list[Element]:
    return [root] if root.tag == "PlanarDomain" else list(root.iter("PlanarDomain"))


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of a G+Smo XML file; see `patchtransfer.read_boundary`."""
    root = parse_xml(data)
    domains = _domains(root)
    if len(domains) > 1:
        raise InputError(f"holds {len(domains)} planar domains; keep one")
    if domains:
        loops = [list(loop.findall("Geometry")) for loop in domains[0].findall("CurveLoop")]
        if not loops or not all(loops):
            raise InputError("PlanarDomain: no CurveLoop, or one without curves; the file is incomplete")
        return _domain(loops)
    geometries = root.findall("Geometry")
    loose = [(_label(g, k), g) for k, g in enumerate(geometries) if g.get("type") in CURVE_TYPES]
    if not loose:
        # Patches may meet only up to the last digits.
        return Boundary([close_loop(loop) for loop in _multipatch(root).boundary().loops])
    if root.find("MultiPatch") is not None or len(loose) < len(geometries):
        raise InputError("holds both patches and loose curves; keep what is the boundary")
    names = [name for name, _ in loose]
    curves = _curves(names, [g for _, g in loose])
    return Boundary(chain(names, curves, TOLERANCE * diameter(curves)))


def _domain(elements: list[list[Element]]) -> Boundary:
    names = [[f"CurveLoop {k}, {_label(g, i)}" for i, g in enumerate(loop)] for k, loop in enumerate(elements)]
    at_most(len(elements), MAX_LOOPS, "loops", "keep those of the domain")
    flat = iter(_curves([n for loop in names for n in loop], [g for loop in elements for g in loop]))
    curves = [[next(flat) for _ in loop] for loop in elements]
    tolerance = TOLERANCE * diameter([c for loop in curves for c in loop])
    loops = []
    for k, (who, loop) in enumerate(zip(names, curves, strict=True)):
        check_curves(who, loop, tolerance)
        if in_order(loop, tolerance):
            loops.append(close_loop(loop))
            continue
        chained = chain(who, loop, tolerance)
        if len(chained) > 1:
            raise InputError(f"CurveLoop {k}: its curves form {len(chained)} loops; put each into its own CurveLoop")
        loops += chained
    return Boundary(loops)


def _row(values: Iterable[object]) -> str:
    return " ".join(map(repr, values))


def _basis(knots: Sequence[FloatArray], degrees: Sequence[int], weights: FloatArray | None) -> list[str]:
    univariate = [
        ['<Basis type="BSplineBasis"%s>' % (f' index="{i}"' if len(knots) > 1 else ""),
         f' <KnotVector degree="{p}">{_row(k.tolist())}</KnotVector>', "</Basis>"]
        for i, (k, p) in enumerate(zip(knots, degrees, strict=True))
    ]  # fmt: skip
    lines = [line for basis in univariate for line in basis]
    if len(knots) == 2:
        lines = ['<Basis type="TensorBSplineBasis2">', *(" " + line for line in lines), "</Basis>"]
    if weights is None:
        return lines
    kind = "TensorNurbsBasis2" if len(knots) == 2 else "NurbsBasis"
    return [
        f'<Basis type="{kind}">',
        *(" " + line for line in lines),
        " <weights>",
        *(repr(w) for w in weights.T.ravel().tolist()),
        " </weights>",
        "</Basis>",
    ]


def _geometry(item: Patch | BSplineCurve, attribute: str) -> list[str]:
    if isinstance(item, Patch):
        kind = "TensorBSpline2" if item.weights is None else "TensorNurbs2"
        basis = _basis(item.knots, item.degrees, item.weights)
        points = item.control_points.transpose(1, 0, 2).reshape(-1, 2)
    else:
        kind = "BSpline" if item.weights is None else "Nurbs"
        basis = _basis([item.knots], [item.degree], item.weights)
        points = item.control_points
    return [
        f'<Geometry type="{kind}" {attribute}>',
        *(" " + line for line in basis),
        ' <coefs geoDim="2">',
        *map(_row, points.tolist()),
        " </coefs>",
        "</Geometry>",
    ]


def _document(lines: Iterable[str]) -> str:
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', "<xml>", *lines, "</xml>", ""])


def format_multipatch(multipatch: MultiPatch) -> str:
    """G+Smo XML text of a multi-patch: all patches, then the block that glues them.

    An interface row's ``dirMap`` maps the direction across side 1 to the one across side 2; ``orient`` is 1
    across if the sides lie at different ends of their directions (parameters then increase through the
    interface), and along it if both sides run in the same sense. Patches are referred to by id.
    """
    ids = multipatch.ids
    lines = [line for i, p in zip(ids, multipatch.patches, strict=True) for line in _geometry(p, f'id="{i}"')]
    if list(ids) == list(range(ids[0], ids[0] + len(ids))):
        patches = f'<patches type="id_range">{ids[0]} {ids[-1]}</patches>'
    else:
        patches = f'<patches type="id_index">{" ".join(map(str, ids))}</patches>'
    lines += [f'<MultiPatch parDim="2" id="{max(-1, *ids) + 1}">', " " + patches]
    if multipatch.interfaces:
        lines += [" <interfaces>", *(_interface(f, ids) for f in multipatch.interfaces), " </interfaces>"]
    if multipatch.boundaries:
        lines += [" <boundary>", *(f"{ids[k]} {int(s)}" for k, s in multipatch.boundaries), " </boundary>"]
    return _document([*lines, "</MultiPatch>"])


def _interface(f: Interface, ids: Sequence[int]) -> str:
    along, across = f.side_a.axis, 1 - f.side_a.axis
    direction, orient = [0, 0], [0, 0]
    direction[across], direction[along] = 1 - f.side_b.axis, f.side_b.axis
    orient[across], orient[along] = int(f.side_a.at_end != f.side_b.at_end), int(not f.reversed)
    return _row([ids[f.patch_a], int(f.side_a), ids[f.patch_b], int(f.side_b), *direction, *orient])


def format_boundary(boundary: Boundary) -> str:
    """G+Smo XML text of a boundary: a ``PlanarDomain`` with one ``CurveLoop`` a loop."""
    lines = ['<PlanarDomain id="0">']
    for k, loop in enumerate(boundary.loops):
        lines += [f' <CurveLoop index="{k}">']
        lines += [" " + line for i, curve in enumerate(loop) for line in _geometry(curve, f'index="{i}"')]
        lines += [" </CurveLoop>"]
    return _document([*lines, "</PlanarDomain>"])
