"""Splinepy's JSON: to the bit, read by splinepy and read from it, what is not geometry kept."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
from other_programs import glued_sides
from patchtransfer import InputError, MultiPatch, Patch
from patchtransfer.geometry.blocks import Block
from patchtransfer.io import splinepy_json
from shapes import circle
from strategies import multipatches, patches

quick = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
files = settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
SQUARE = MultiPatch([Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])])


def read(text: str) -> MultiPatch:
    return splinepy_json.read_multipatch(text.encode())


@quick
@given(multipatches())
def test_a_model_survives_to_the_bit(mp):
    back = read(splinepy_json.format_multipatch(mp))
    assert back.patches == mp.patches
    assert glued_sides(back) == glued_sides(mp)


@quick
@given(patches())
def test_any_patch_survives_to_the_bit(patch):
    mp = MultiPatch([patch], ())
    assert read(splinepy_json.format_multipatch(mp)).patches == mp.patches


@files
@given(mp=multipatches(), as_base64=st.booleans())
def test_splinepy_reads_what_we_write_and_we_what_it_writes(tmp_path, mp, as_base64):
    splinepy = pytest.importorskip("splinepy")
    ours, theirs = tmp_path / "ours.json", tmp_path / "theirs.json"
    ours.write_text(splinepy_json.format_multipatch(mp))
    loaded = splinepy.io.json.load(str(ours))
    for spline, patch in zip(loaded, mp, strict=True):
        t = np.array([[patch.knots[0][0], patch.knots[1][0]], [patch.knots[0][-1], patch.knots[1][-1]], [0.3, 0.7]])
        assert np.allclose(spline.evaluate(t), [patch(*uv) for uv in t], rtol=0, atol=1e-14)
    splinepy.io.json.export(str(theirs), loaded, base64encoding=as_base64)
    back = pt.read(theirs)
    for a, b in zip(back, mp, strict=True):
        assert all(map(np.array_equal, a.knots, b.knots))
        if b.weights is None:
            assert a == b
        else:
            # splinepy keeps products with the weights.
            assert np.allclose(a.control_points, b.control_points, rtol=1e-15, atol=0)
            assert np.array_equal(a.weights, b.weights)


@files
@given(degrees=st.tuples(st.integers(1, 3), st.integers(1, 3)), rational=st.booleans(), as_base64=st.booleans())
def test_bezier_patches_of_splinepy(tmp_path, degrees, rational, as_base64):
    splinepy = pytest.importorskip("splinepy")
    n = (degrees[0] + 1) * (degrees[1] + 1)
    points = np.random.default_rng(n).random((n, 2))
    more = {"weights": np.linspace(1, 2, n)} if rational else {}
    made = (splinepy.RationalBezier if rational else splinepy.Bezier)(degrees, control_points=points, **more)
    splinepy.io.json.export(str(tmp_path / "a.json"), [made], base64encoding=as_base64)
    (patch,) = pt.read(tmp_path / "a.json")
    assert patch.degrees == degrees
    assert np.allclose(patch(0.3, 0.7), made.evaluate([[0.3, 0.7]])[0], rtol=0, atol=1e-15)


def test_names_and_options_are_kept(tmp_path):
    document = json.loads(splinepy_json.format_multipatch(models.grid(2, 1)))
    document["Name"] = "beam"
    document["SplineList"][1]["show_options"] = {"c": "red", "resolutions": [10, 20]}
    mp = read(json.dumps(document))
    (block,) = mp.blocks
    assert (block.format, block.kind) == (splinepy_json.FORMAT, "fields")
    again = json.loads(splinepy_json.format_multipatch(mp.elevate()))
    assert again["Name"] == "beam"
    assert [s["show_options"] for s in again["SplineList"]] == [{}, document["SplineList"][1]["show_options"]]
    assert again["SplineList"][0]["degrees"] == [3, 3]
    assert read(json.dumps(again)).blocks == mp.blocks
    assert SQUARE.blocks == read(splinepy_json.format_multipatch(SQUARE)).blocks == ()


def with_fields(text: str) -> MultiPatch:
    return MultiPatch(SQUARE.patches, blocks=[Block(splinepy_json.FORMAT, "fields", text)])


def test_fields_that_would_be_geometry_change_none():
    hostile = {"SplineList": [{"degrees": [9, 9]}], "Base64Encoding": True, "NumberOfSplines": 7}
    for text in (json.dumps(hostile), '{"SplineList": 3}', '{"SplineList": [3]}', '{"SplineList": []}'):
        assert read(splinepy_json.format_multipatch(with_fields(text))).patches == SQUARE.patches


@pytest.mark.parametrize(
    ("text", "message"),
    [("", "no object in JSON"), ("[1]", "no object in JSON"), ("[" * 100_000, "no object"), ('{"x": NaN}', "infinite")],
)
def test_blocks_that_are_no_fields_are_refused(text, message):
    with pytest.raises(InputError, match=message):
        splinepy_json.format_multipatch(with_fields(text))


def test_curves_are_a_boundary():
    c = circle(2)
    spline = {
        "SplineType": "NURBS",
        "degrees": [2],
        "knot_vectors": [c.knots.tolist()],
        "control_points": c.control_points.tolist(),
        "weights": c.weights.tolist(),
    }
    data = json.dumps({"SplineList": [spline]}).encode()
    assert splinepy_json.read_boundary(data) == pt.Boundary([[c]])
    with pytest.raises(InputError, match="holds only curves; use read_boundary"):
        splinepy_json.read_multipatch(data)
    model = splinepy_json.format_multipatch(models.grid(2, 1)).encode()
    assert splinepy_json.read_boundary(model).loops == models.grid(2, 1).boundary().loops


def changed(**fields) -> str:
    document = json.loads(splinepy_json.format_multipatch(SQUARE))
    spline = document["SplineList"][0]
    for name, value in fields.items():
        (document if name in document else spline)[name] = value
    return json.dumps(document)


FOUR = [[0, 0], [1, 0], [0, 1], [1, 1]]
FAULTS = {
    "no list": ('{"SplineList": 3}', "not a list of splines"),
    "empty list": ('{"SplineList": []}', "not a list of splines"),
    "no object": ('{"SplineList": [3]}', "spline 0 is not an object"),
    "malformed": ('{"SplineList": [', "malformed JSON"),
    "nested": ('{"SplineList":' + "[" * 100_000, "nested thousands deep"),
    "digits": (changed(control_points=[[0, 10**30], *FOUR[1:]]), "31 digits"),
    "NaN": (changed(control_points=[[0, float("nan")], *FOUR[1:]]), "NaN is not a number"),
    "infinite": (changed(control_points=FOUR).replace("[1, 0]", "[1e999, 0]"), "inf is NaN, infinite or above"),
    "truth": (changed(control_points=[[True, False]] * 4), "not an array of numbers"),
    "ragged": (changed(control_points=[[0], *FOUR[1:]]), "not an array of numbers"),
    "texts": (changed(control_points=[["0", "0"]] * 4), "not an array of numbers"),
    "few points": (changed(control_points=FOUR[:3]), "3 control points, its knots and degrees need 4"),
    "space": (changed(control_points=[[x, y, 1] for x, y in FOUR]), "z is not 0"),
    "four coordinates": (changed(control_points=[[x, y, 0, 0] for x, y in FOUR]), "not planar"),
    "volume": (changed(degrees=[1, 1, 1]), "3 parameters; only planar patches"),
    "degree": (changed(degrees=[1, 1.5]), "degree 1.5 is not supported"),
    "high degree": (changed(degrees=[1, 99]), "99 as degree of spline 0, at most 19"),
    "type": (changed(SplineType="THB"), "type THB is not supported; BSpline, NURBS"),
    "type of type": (changed(SplineType=[]), r"type \[\] is not supported"),
    "no weights": (changed(SplineType="NURBS"), 'a NURBS without "weights"'),
    "weights": (changed(SplineType="NURBS", weights=[1, 1, 0, 1]), "weight 0 is not positive"),
    "few weights": (changed(SplineType="NURBS", weights=[1, 1]), "2 weights for 4"),
    "no knots": (changed(knot_vectors=None), 'without "knot_vectors"'),
    "one knot vector": (changed(knot_vectors=[[0, 0, 1, 1]]), "1 knot vectors; 2 are needed"),
    "few knots": (changed(knot_vectors=[[0, 1]] * 2), "2 knots are too few"),
    "decreasing": (changed(knot_vectors=[[0, 0, 1, 0.5]] * 2), "decrease at number 4"),
    "no span": (changed(knot_vectors=[[1, 1, 1, 1]] * 2), "span nothing"),
    "base64": (changed(Base64Encoding=True), "control points: not valid base64"),
    "base64 of bytes": (changed(Base64Encoding=True, control_points="AAAA"), "not valid base64 of numbers in 2"),
    "base64 in space": (changed(Base64Encoding=True, dim=7), '"dim" is 7'),
    "Bezier": (changed(SplineType="Bezier", degrees=[1, 10**9]), "1000000000 as degree of spline 0"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_are_named(case):
    text, message = FAULTS[case]
    with pytest.raises(InputError, match=message):
        read(text)


def test_the_number_of_lists_is_bounded(monkeypatch):
    monkeypatch.setattr(splinepy_json, "MAX_JSON_LISTS", 5)
    with pytest.raises(InputError, match="lists and objects, at most 5"):
        read(splinepy_json.format_multipatch(SQUARE))


def test_coordinates_in_space_with_z_0_and_unclamped_knots():
    flat = read(changed(control_points=[[*x, 0] for x in FOUR]))
    assert flat.patches == SQUARE.patches
    unclamped = read(changed(knot_vectors=[[-1, 0, 1, 2], [0, 0, 1, 1]]))
    assert unclamped.patches == SQUARE.patches
    weighted = read(changed(SplineType="NURBS", weights=[1, 2, 1, 2], knot_vectors=[[-1, 0, 1, 2], [0, 0, 1, 1]]))
    assert np.allclose(weighted[0](0.5, 0), [2 / 3, 0])
