"""Patches and curves of G+Smo XML."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from ...errors import InputError, InputWarning
from ...geometry.basis import weights_agree
from ...geometry.curve import BSplineCurve
from ...geometry.patch import Patch
from ...limits import (
    MAX_ALONG,
    MAX_BOUNDARY_POINTS,
    MAX_CONTROL_POINTS,
    MAX_CURVES,
    MAX_DEGREE,
    MAX_PATCHES,
    at_most,
)
from ...numeric.arrays import FloatArray
from ..loops import clamp
from .numbers import attribute, counted, integer, numbers

__all__ = ["CURVE_TYPES", "geometry_name", "read_curves", "read_patches"]

PATCH_TYPES = {"TensorBSpline2": False, "TensorNurbs2": True}
CURVE_TYPES = {"BSpline": False, "Nurbs": True, "TensorBSpline1": False, "TensorNurbs1": True}
"""Geometry types that are read, and whether they are rational."""


def _knots(basis: Element, where: str) -> tuple[FloatArray, int]:
    element = basis if basis.tag == "KnotVector" else basis.find("KnotVector")
    if element is None:
        raise InputError(f"{where}: a basis without <KnotVector>; the file is incomplete")
    degree = integer(attribute(element, "degree", where), where)
    if degree < 1:
        raise InputError(f"{where}: degree {degree} is not supported; it must be at least 1")
    at_most(degree, MAX_DEGREE, f"as degree of {where}", "lower it")
    if element.get("mode", "").strip() == "uniform":
        count = integer(attribute(element, "csize", where), where)
        at_most(count, MAX_BOUNDARY_POINTS, f"as csize of {where}", "coarsen it")
        if not degree < count:
            raise InputError(f"{where}: csize {count} does not fit degree {degree}; correct it")
        inner = np.linspace(0.0, 1.0, count - degree + 1)
        return np.concatenate([np.zeros(degree), inner, np.ones(degree)]), degree
    knots = numbers(element, where)
    if len(knots) < 2 * degree + 2:
        raise InputError(f"{where}: {len(knots)} knots are too few for degree {degree}; {2 * degree + 2} are needed")
    if (np.diff(knots) < 0).any():
        raise InputError(f"{where}: the knots decrease at number {int(np.argmax(np.diff(knots) < 0)) + 2}; sort them")
    return knots, degree


def geometry_name(geometry: Element, position: int) -> str:
    """How messages call a geometry, by its id or its position in the file."""
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
    dimension = 2 if coefs is None else integer(attribute(coefs, "geoDim", where), where)
    if dimension not in (2, 3):
        raise InputError(f"{where}: geoDim {dimension} is not planar; only models in the plane are supported")
    if coefs is not None and coefs.get("order", "").strip() == "coordinates":
        points = np.moveaxis(counted(coefs, "coefs", [dimension, *counts], where), 0, -1)
    else:
        points = counted(coefs, "coefs", [*counts, dimension], where)
    if dimension == 3 and (points[..., 2] != 0).any():
        raise InputError(f"{where}: lies in space (z is not 0); only models in the plane are supported")
    axes = tuple(range(directions))[::-1]
    points = points[..., :2].transpose(*axes, directions)
    weights = None
    if rational:
        weights = counted(basis.find("weights"), "weights", counts, where).transpose(axes)
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


def _patch(geometry: Element, position: int, levelled: list[str]) -> Patch:
    """A patch; polynomial if its weights are equal, and if they are so but for rounding its name is added to a list."""
    where, kind = geometry_name(geometry, position), geometry.get("type", "")
    if kind not in PATCH_TYPES:
        raise InputError(f"{where}: {_refusal(kind)}")
    knots, degrees, points, weights = _tensor(geometry, where, 2, PATCH_TYPES[kind])
    if weights is not None and weights_agree(weights):
        if np.ptp(weights) > 0:
            levelled.append(where)
        weights = None
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


def read_patches(chosen: list[tuple[int, Element]]) -> list[Patch]:
    """Patches of geometries and their positions in the file."""
    at_most(len(chosen), MAX_PATCHES, "patches", "split the model")
    patches, total, levelled = [], 0, list[str]()
    for k, geometry in chosen:
        patches.append(_patch(geometry, k, levelled))
        total += patches[-1].control_points.size // 2
        at_most(total, MAX_CONTROL_POINTS, "control points", "coarsen the model or split it")
    if levelled:
        more = f" and of {len(levelled) - 1} more" if len(levelled) > 1 else ""
        doubt = f"the weights of {levelled[0]}{more} are equal but for rounding; read as polynomial"
        warnings.warn(doubt, InputWarning, stacklevel=2)
    return patches


def read_curves(names: Sequence[str], geometries: Sequence[Element]) -> list[BSplineCurve]:
    """Curves of geometries, which messages call by these names."""
    at_most(len(geometries), MAX_CURVES, "curves", "join them to fewer")
    curves, total = [], 0
    for name, geometry in zip(names, geometries, strict=True):
        curves.append(_curve(geometry, name))
        total += len(curves[-1].control_points)
        at_most(total, MAX_BOUNDARY_POINTS, "control points of the boundary", "coarsen it")
    return curves
