"""GeoJSON and Shapely: one polygon with its holes, rings of points in a plane.

Coordinates are taken as plane x and y as they stand. A file that holds several polygons is refused, with their names,
unless one is chosen by name: the ``id`` of its feature, the ``name`` in the feature's properties, or its number in the
file, counted from 1.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..limits import MAX_CURVES, MAX_LOOPS, TOO_LARGE, at_most, first_unusable
from ..numeric.arrays import FloatArray
from .options import DEFAULT, BoundaryOptions
from .point_loops import PointLoop, boundary_of_points

__all__ = ["boundary_of_shapely", "looks_like_geojson", "read_boundary"]

KINDS = "Point MultiPoint LineString MultiLineString Polygon MultiPolygon GeometryCollection Feature FeatureCollection"
TYPE = re.compile(rb'"type"\s*:\s*"(?:' + KINDS.replace(" ", "|").encode() + rb')"')
#: Brackets, braces and commas of a file: each can begin a value, which takes some 100 bytes when parsed.
MAX_MARKS = 40 * MAX_CURVES
#: Names that a message lists.
NAMED = 12


@dataclass(frozen=True)
class _Polygon:
    """Rings as the file has them, the outer one first, and what the polygon may be called."""

    rings: Any
    names: tuple[str, ...]


def looks_like_geojson(data: bytes) -> bool:
    """Whether this is a JSON object with a GeoJSON type."""
    # The type may stand behind long lists of coordinates.
    return data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and TYPE.search(data) is not None


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of the polygon of a file; see `patchtransfer.read_boundary`."""
    at_most(sum(data.count(mark) for mark in (b"[", b"{", b",")), MAX_MARKS, "values", "keep the polygon of the domain")
    try:
        content = json.loads(data.decode("utf-8-sig"), parse_constant=_refuse)
    except UnicodeDecodeError as error:
        raise InputError(f"is not UTF-8 text (byte {error.start}); save it as UTF-8") from None
    except json.JSONDecodeError as error:
        raise InputError(f"malformed JSON at line {error.lineno} ({error.msg}); mend it") from None
    except RecursionError:
        raise InputError("lists are nested too deep; save it as plain GeoJSON") from None
    except ValueError as error:
        raise InputError(f"a number cannot be read ({str(error)[:60]}); correct it") from None
    other: Counter[str] = Counter()
    polygons = list(_polygons(content, (), other))
    if options.layers is not None:
        polygons = _chosen(polygons, options.layers)
    if len(polygons) != 1:
        raise InputError(_not_one(polygons, other))
    notes = []
    if other:
        told = ", ".join(f"{n} {kind}" for kind, n in other.most_common())
        notes.append(f"left out, for they bound no area: {told}")
    if isinstance(content, dict) and "crs" in content:
        notes.append("its coordinate system (crs) is not read: coordinates are taken as plane x and y")
    return _boundary(_rings(polygons[0], notes), notes, options)


def _refuse(name: str) -> float:
    raise InputError(f"{name} is not a number; give finite numbers")


def _polygons(content: Any, names: tuple[str, ...], other: Counter[str]) -> Iterator[_Polygon]:
    """All polygons of an object; the kinds of other geometries are counted."""
    stack = [(content, names)]
    while stack:
        value, called = stack.pop()
        if value is None:
            other["feature without geometry"] += 1
            continue
        kind = value.get("type") if isinstance(value, dict) else None
        if kind == "FeatureCollection":
            stack.extend((feature, ()) for feature in reversed(_list(value, "features")))
        elif kind == "Feature":
            properties = value.get("properties")
            told = [value.get("id"), properties.get("name") if isinstance(properties, dict) else None]
            stack.append((value.get("geometry"), tuple(str(x) for x in told if isinstance(x, (str, int)))))
        elif kind == "GeometryCollection":
            stack.extend((geometry, called) for geometry in reversed(_list(value, "geometries")))
        elif kind == "Polygon":
            yield _Polygon(_list(value, "coordinates"), called)
        elif kind == "MultiPolygon":
            for rings in _list(value, "coordinates"):
                yield _Polygon(rings, called)
        elif kind in KINDS.split():
            other[kind] += 1
        else:
            raise InputError(f"{str(kind)[:40]!r} is no type of GeoJSON; save it as GeoJSON")


def _list(value: dict[str, Any], key: str) -> list[Any]:
    found = value.get(key)
    if not isinstance(found, list):
        raise InputError(f"{value['type']}: {key!r} is not a list; save it as GeoJSON")
    return found


def _chosen(polygons: Sequence[_Polygon], wanted: Sequence[str]) -> list[_Polygon]:
    found = [p for k, p in enumerate(polygons, 1) if {*p.names, str(k)} & set(wanted)]
    if not found:
        raise InputError(f"has no polygon {wanted[0]!r}; its polygons are {_names(polygons)}")
    return found


def _names(polygons: Sequence[_Polygon]) -> str:
    told = [", ".join((str(k), *map(repr, p.names))) for k, p in enumerate(polygons[:NAMED], 1)]
    return "; ".join(told) + ("; ..." if len(polygons) > NAMED else "")


def _not_one(polygons: Sequence[_Polygon], other: Counter[str]) -> str:
    if not polygons:
        told = ", ".join(f"{n} {kind}" for kind, n in other.most_common())
        return f"holds no polygon{f' ({told})' if told else ''}; save the outline as Polygon"
    return (
        f"holds {len(polygons)} polygons; choose one by its number or name, layers=['1'] (--layer 1): "
        f"{_names(polygons)}"
    )


def _rings(polygon: _Polygon, notes: list[str]) -> list[FloatArray]:
    if not isinstance(polygon.rings, list) or not polygon.rings:
        raise InputError("the polygon has no rings; save it as GeoJSON")
    at_most(len(polygon.rings), MAX_LOOPS, "rings", "keep those of the domain")
    found, lifted = [], False
    for k, ring in enumerate(polygon.rings):
        try:
            points = np.array(ring, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            points = np.empty(0)
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise InputError(f"ring {k} is not a list of positions [x, y]; correct it")
        lifted |= points.shape[1] == 3 and bool(points[:, 2].any())
        found.append(points[:, :2])
    if lifted:
        notes.append("heights (third coordinates) left out")
    return found


def boundary_of_shapely(polygon: Any, smooth: bool | None = None) -> Boundary:
    """Boundary of a Shapely polygon; see `patchtransfer.Boundary.from_shapely`."""
    kind = getattr(polygon, "geom_type", type(polygon).__name__)
    if kind == "MultiPolygon":
        parts = list(polygon.geoms)
        if len(parts) != 1:
            areas = ", ".join(f"{part.area:.4g}" for part in parts[:NAMED])
            raise InputError(
                f"the multi-polygon has {len(parts)} parts, of areas {areas}; pass one, polygon.geoms[k], or their "
                "union if they overlap"
            )
        polygon, kind = parts[0], "Polygon"
    if kind != "Polygon":
        raise InputError(f"must be a Shapely Polygon, got {kind}; shapely.polygonize makes them of lines")
    if polygon.is_empty:
        raise InputError("the polygon is empty; pass one with an area")
    if not polygon.is_valid:
        from ..libraries import library

        reason = library("shapely", "geo").is_valid_reason(polygon)
        raise InputError(f"the polygon is not valid ({reason}); mend it with shapely.make_valid")
    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    notes = ["heights (third coordinates) left out"] if polygon.has_z else []
    return _boundary(rings, notes, BoundaryOptions(smooth=smooth))


def _boundary(rings: Sequence[FloatArray], notes: Sequence[str], options: BoundaryOptions) -> Boundary:
    loops = []
    for k, ring in enumerate(rings):
        name = "the outer ring" if k == 0 else f"ring {k}, a hole,"
        if first_unusable(ring) is not None:
            raise InputError(f"{name} has NaN, infinity or a number {TOO_LARGE}; give finite numbers")
        loops.append(PointLoop(name, ring))
    return boundary_of_points(loops, options, notes)
