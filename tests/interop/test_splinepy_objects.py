"""splinepy's objects, both ways."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import models
import patchtransfer as pt
from other_programs import glued_sides
from patchtransfer import InputError, InputWarning, MultiPatch, Side
from strategies import multipatches

splinepy = pytest.importorskip("splinepy")
quick = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@quick
@given(multipatches(rational=False))
def test_polynomial_models_survive_to_the_bit(mp):
    made = mp.to_splinepy()
    assert isinstance(made, splinepy.Multipatch)
    for back in (MultiPatch.from_splinepy(made), MultiPatch.from_splinepy(list(made.patches))):
        assert back.patches == mp.patches
        assert glued_sides(back) == glued_sides(mp)
        assert {f.reversed for f in back.interfaces} == {f.reversed for f in mp.interfaces}


@quick
@given(multipatches(rational=True))
def test_rational_models_survive_but_for_rounding(mp):
    back = MultiPatch.from_splinepy(mp.to_splinepy())
    for a, b in zip(back, mp, strict=True):
        assert np.array_equal(a.weights, b.weights)
        assert np.allclose(a.control_points, b.control_points, rtol=1e-15, atol=0)
        assert all(map(np.array_equal, a.knots, b.knots))
    assert glued_sides(back) == glued_sides(mp)


def test_splinepy_finds_the_same_interfaces_and_area():
    mp = models.o_grid(3, 2)
    made = mp.to_splinepy()
    stated = np.array(made.interfaces)
    made.determine_interfaces(recompute=True)
    assert np.array_equal(np.array(made.interfaces), stated)
    area = sum(abs(spline.integrate.volume()) for spline in made.patches)
    domain, geom = mp.to_nutils()
    function = pytest.importorskip("nutils.function")
    assert area == pytest.approx(float(domain.integral(function.J(geom), degree=6).eval()), rel=1e-13)


def test_one_spline_and_beziers():
    points = np.array([[0, 0], [2, 0], [0, 1], [2, 1]], float)
    bezier = splinepy.Bezier([1, 1], control_points=points)
    expected = pt.Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 1]], [[2, 0], [2, 1]]])
    assert MultiPatch.from_splinepy(bezier).patches == (expected,)
    weighted = splinepy.RationalBezier([1, 1], control_points=points, weights=[1, 2, 1, 2])
    (patch,) = MultiPatch.from_splinepy([weighted])
    assert patch.weights.tolist() == [[1, 1], [2, 2]]


def test_labels_are_numbers_of_boundaries():
    mp = models.grid(2, 1)
    labels = {"inlet": [mp.boundaries[0]], "boundary 2": [mp.boundaries[1]], "wall": list(mp.boundaries[2:4])}
    with pytest.warns(InputWarning, match="numbers boundaries: 'inlet' is 3, 'wall' is 4"):
        made = mp.with_labels(labels).to_splinepy()
    back = MultiPatch.from_splinepy(made)
    assert dict(back.sides) == {"boundary 2": (mp.boundaries[1],), "boundary 3": (mp.boundaries[0],),
                                "boundary 4": mp.boundaries[2:4]}  # fmt: skip
    # Numbers stay what they are, without a word.
    assert MultiPatch.from_splinepy(back.to_splinepy()).sides == back.sides


def test_labels_without_a_place_are_named():
    mp = models.grid(2, 1)
    (f,) = mp.interfaces
    labels = {"a": [(f.patch_a, f.side_a), mp.boundaries[0]], "b": [mp.boundaries[0]]}
    with pytest.warns(InputWarning) as told:
        mp.with_labels(labels).to_splinepy()
    inside, twice = f"'a' of patch {f.patch_a} {f.side_a.name.lower()}", f"'b' of patch {mp.boundaries[0][0]}"
    assert any(f"left out: {inside}, {twice}" in str(w.message) for w in told)


@pytest.mark.parametrize(
    ("what", "message"),
    [
        (3, "neither a spline of splinepy nor"),
        ([3], "spline 0: not a spline of splinepy"),
        ([splinepy.Bezier([1], [[0, 0], [1, 1]])], "has 1 parameters"),
        ([splinepy.Bezier([1, 1], [[0, 0, 0], [1, 1, 0], [2, 0, 1], [0, 3, 0]])], "z is not 0"),
        ([], "at least one patch"),
    ],
)
def test_what_is_no_model(what, message):
    with pytest.raises(InputError, match=message):
        MultiPatch.from_splinepy(what)


def test_a_missing_library_is_named_with_what_to_install(monkeypatch):
    mp = models.grid(1, 1)
    for name in ("splinepy", "geomdl", "nutils", "meshio", "pyvista"):
        for module in (name, "geomdl.multi", "nutils.mesh"):
            monkeypatch.setitem(__import__("sys").modules, module, None)
        with pytest.raises(InputError, match=rf"to_{name} needs {name} .*pip install 'patchtransfer\[{name}\]'"):
            getattr(mp, f"to_{name}")()
        monkeypatch.undo()


def test_gustaf_takes_the_splines():
    gustaf = pytest.importorskip("gustaf")
    faces = models.grid(2, 1).to_splinepy().patches[0].extract.faces([5, 5])
    assert isinstance(faces, gustaf.Faces)
    assert len(faces.faces) == 16


def test_sides_are_numbered_alike():
    mp = models.grid(1, 1, seed=None)
    spline = mp.to_splinepy().patches[0]
    for side in Side:
        edge = spline.extract.boundaries()[side - 1]
        ours = side.of(mp[0].control_points)
        assert np.allclose(np.sort(edge.control_points, axis=0), np.sort(ours, axis=0))
