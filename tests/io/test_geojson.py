"""GeoJSON and Shapely: one polygon with holes; several are named and one can be chosen."""

from __future__ import annotations

import json

import numpy as np
import pytest

import patchtransfer as pt
from patchtransfer import InputError
from patchtransfer.geometry.outline import Outline
from patchtransfer.io import geojson
from patchtransfer.io.options import BoundaryOptions

OUTER = [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]
HOLE = [[1, 1], [1, 2], [2, 2], [2, 1], [1, 1]]
POLYGON = {"type": "Polygon", "coordinates": [OUTER, HOLE]}
MOVED = {"type": "Polygon", "coordinates": [[[x + 10, y] for x, y in OUTER]]}


def feature(geometry, **more):
    return {"type": "Feature", "properties": None, "geometry": geometry} | more


def collection(*features):
    return {"type": "FeatureCollection", "features": list(features)}


def read(content, **options):
    return geojson.read_boundary(json.dumps(content).encode(), BoundaryOptions(**options))


@pytest.mark.parametrize(
    "content",
    [
        POLYGON,
        {"type": "MultiPolygon", "coordinates": [POLYGON["coordinates"]]},
        feature(POLYGON),
        collection(feature(POLYGON)),
        {"type": "GeometryCollection", "geometries": [POLYGON]},
        {"coordinates": POLYGON["coordinates"], "type": "Polygon"},
    ],
)
def test_a_polygon_however_it_is_wrapped(content, tmp_path):
    boundary = read(content, smooth=False)
    assert [len(loop) for loop in boundary.loops] == [4, 4]
    assert [abs(Outline(loop).area) for loop in boundary.loops] == [12, 1]
    for name in ("a.json", "a.geojson", "a.txt"):
        (tmp_path / name).write_text(json.dumps(content))
        assert pt.read_boundary(tmp_path / name, smooth=False) == boundary


def test_several_polygons_are_named_and_one_is_chosen():
    content = collection(feature(POLYGON, id="plate"), feature(MOVED, properties={"name": "other"}, id=7))
    with pytest.raises(InputError, match=r"holds 2 polygons; choose one .*--layer 1.*1, 'plate'; 2, '7', 'other'"):
        read(content)
    for name, start in (("plate", 0), ("1", 0), ("other", 10), ("7", 10), ("2", 10)):
        assert read(content, layers=(name,)).loops[0][0].start[0] == start
    with pytest.raises(InputError, match=r"no polygon 'x'; its polygons are 1, 'plate'"):
        read(content, layers=("x",))
    parts = {"type": "MultiPolygon", "coordinates": [POLYGON["coordinates"], MOVED["coordinates"]]}
    with pytest.raises(InputError, match="holds 2 polygons"):
        read(parts)


def test_what_is_left_out_is_told():
    point = {"type": "Point", "coordinates": [1, 1]}
    lifted = {"type": "Polygon", "coordinates": [[[x, y, 5] for x, y in OUTER]]}
    content = collection(feature(point), feature(lifted), feature(None)) | {"crs": {"type": "name"}}
    notes = read(content).notes
    assert notes[0] == "left out, for they bound no area: 1 Point, 1 feature without geometry"
    assert "crs" in notes[1]
    assert notes[2] == "heights (third coordinates) left out"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1', "malformed JSON at line 1"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, NaN], [1, 1]]]}', "NaN is not a number"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, 1e999], [1, 1]]]}', "NaN, infinity"),
        (
            b'{"type": "Polygon", "coordinates": [[[0, 0], [1, %s], [1, 1]]]}' % (b"9" * 5000),
            "cannot be read|not a list",
        ),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, "a"], [1, 1]]]}', "ring 0 is not a list of positions"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1], [1, 1]]]}', "ring 0 is not a list of positions"),
        (b'{"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [0, 0]]]}', "outer ring has fewer than 3"),
        (b'{"type": "Polygon", "coordinates": 3}', "is not a list"),
        (b'{"type": "Polygon", "coordinates": []}', "no rings"),
        (b'{"type": "Sphere"}', "'Sphere' is no type of GeoJSON"),
        (b'{"type": "LineString", "coordinates": [[0, 0], [1, 1]]}', r"no polygon \(1 LineString\)"),
        (b'{"type": "Polygon", "coordinates": ' + b"[" * 100_000 + b"]" * 100_000 + b"}", "nested too deep"),
        (b'{"type": "Polygon", "coordinates": [' + b"[]," * 3_000_000 + b"[]]}", "values, at most"),
        (b'{"type": "Polygon\xff"}', "not UTF-8"),
    ],
)
def test_bad_files_are_one_line(data, message):
    with pytest.raises(InputError, match=message) as caught:
        geojson.read_boundary(data)
    assert "\n" not in str(caught.value)


def test_shapely_polygons_with_holes_and_curves():
    shapely = pytest.importorskip("shapely")
    plate = shapely.box(0, 0, 4, 3) - shapely.Point(2, 1.5).buffer(1, quad_segs=32)
    boundary = pt.Boundary.from_shapely(plate)
    rectangle, circle = boundary.loops
    assert [c.degree for c in rectangle] == [1] * 4
    assert len(circle) == 1
    assert np.abs(np.linalg.norm(Outline(circle).polygon(500) - [2, 1.5], axis=1) - 1).max() < 1e-6
    # The same through a file.
    assert geojson.read_boundary(shapely.to_geojson(plate).encode()) == boundary
    assert pt.Boundary.from_shapely(shapely.MultiPolygon([plate])) == boundary


def test_shapely_objects_that_are_no_polygon():
    shapely = pytest.importorskip("shapely")
    two = shapely.union(shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 2))
    for given, message in (
        (two, r"2 parts, of areas 1, 2; pass one"),
        (shapely.Point(0, 0), "must be a Shapely Polygon, got Point"),
        (shapely.Polygon(), "empty"),
        (shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), r"not valid \(Self-intersection.*make_valid"),
        ([[0, 0], [1, 0]], "must be a Shapely Polygon, got list"),
    ):
        with pytest.raises(InputError, match=message):
            pt.Boundary.from_shapely(given)
