"""geomdl's objects, both ways."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import models
from other_programs import glued_sides
from patchtransfer import InputError, MultiPatch, Patch
from strategies import multipatches, patches

geomdl = pytest.importorskip("geomdl")
from geomdl import NURBS, BSpline, multi  # noqa: E402

quick = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@quick
@given(patches(), st.floats(0, 1), st.floats(0, 1))
def test_points_are_those_of_geomdl(patch, u, v):
    (surface,) = MultiPatch([patch], ()).to_geomdl()
    at = [float(t[0] + x * (t[-1] - t[0])) for t, x in zip(patch.knots, (u, v), strict=True)]
    at = [min(x, float(t[-1])) for t, x in zip(patch.knots, at, strict=True)]
    assert np.allclose(surface.evaluate_single(at), [*patch(*at), 0], rtol=1e-9, atol=1e-6)


@quick
@given(multipatches())
def test_models_survive(mp):
    made = mp.to_geomdl()
    assert isinstance(made, multi.SurfaceContainer)
    for back in (MultiPatch.from_geomdl(made), MultiPatch.from_geomdl(list(made))):
        for a, b in zip(back, mp, strict=True):
            if b.weights is None:
                assert a == b
            assert np.allclose(a.control_points, b.control_points, rtol=1e-15, atol=0)
            assert all(map(np.array_equal, a.knots, b.knots))
        assert glued_sides(back) == glued_sides(mp)


def surface(kind=BSpline, points=None, sizes=(2, 3), degrees=(1, 2), knots=([0, 0, 1, 1], [0, 0, 0, 1, 1, 1])):
    made = kind.Surface()
    made.degree_u, made.degree_v = degrees
    made.set_ctrlpts(points or [[i, j, 0.0] for i in range(2) for j in range(3)], *sizes)
    made.knotvector_u, made.knotvector_v = knots
    return made


def test_surfaces_made_in_geomdl():
    expected = Patch(([0, 0, 1, 1], [0, 0, 0, 1, 1, 1]), (1, 2), [[[i, j] for j in range(3)] for i in range(2)])
    assert MultiPatch.from_geomdl(surface()).patches == (expected,)
    weighted = surface(NURBS, [[w * i, w * j, 0.0, w] for i, w in ((0, 1.0), (1, 2.0)) for j in range(3)])
    (patch,) = MultiPatch.from_geomdl([weighted])
    assert np.array_equal(patch.control_points, expected.control_points)
    assert patch.weights.tolist() == [[1] * 3, [2] * 3]


def test_what_is_no_model():
    with pytest.raises(InputError, match="z is not 0"):
        MultiPatch.from_geomdl(surface(points=[[i, j, i * j] for i in range(2) for j in range(3)]))
    with pytest.raises(InputError, match="surface 0: not a surface of geomdl"):
        MultiPatch.from_geomdl([3])
    trimmed = surface()
    line = BSpline.Curve()
    line.degree, line.ctrlpts, line.knotvector = 1, [[0, 0], [1, 1]], [0, 0, 1, 1]
    trimmed.trims = [line]
    with pytest.raises(InputError, match="1 trimming curves"):
        MultiPatch.from_geomdl(trimmed)


def test_geomdl_writes_what_it_is_given(tmp_path):
    exchange = pytest.importorskip("geomdl.exchange")
    exchange.export_obj(models.grid(2, 1).to_geomdl(), str(tmp_path / "a.obj"))
    assert (tmp_path / "a.obj").stat().st_size > 1000
