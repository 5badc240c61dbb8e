"""nutils integrates over what `to_nutils` gives: area, circumference, labels, Poisson's equation."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import models
import real
from patchtransfer import InputWarning, MultiPatch, Patch, iga
from shapes import turned
from strategies import multipatches

function = pytest.importorskip("nutils.function")
quick = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def gauss(mp: MultiPatch, points: int = 8) -> tuple[float, float]:
    """Area and circumference, by our own evaluation."""
    x, w = np.polynomial.legendre.leggauss(points)
    area = length = 0.0
    for patch in mp:
        (u, wu), (v, wv) = (_nodes(knots, x, w) for knots in patch.knots)
        du, dv = patch.grid(u, v, 1, 0), patch.grid(u, v, 0, 1)
        area += np.abs(du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]) @ wv @ wu
    for k, side in mp.boundaries:
        t, wt = _nodes(mp[k].knots[side.axis], x, w)
        end = [mp[k].knots[1 - side.axis][-1 if side.at_end else 0]]
        slope = mp[k].grid(t, end, 1, 0)[:, 0] if side.axis == 0 else mp[k].grid(end, t, 0, 1)[0]
        length += np.hypot(*slope.T) @ wt
    return float(area), float(length)


def _nodes(knots, x, w):
    a, b = np.unique(knots)[:-1, None], np.unique(knots)[1:, None]
    return ((a + b) / 2 + (b - a) / 2 * x).ravel(), ((b - a) / 2 * w).ravel()


def integrals(domain, geom, boundary=None) -> tuple[float, float, float]:
    """Area, by the divergence theorem too, and circumference."""
    boundary = domain.boundary if boundary is None else boundary
    flux = (geom * function.normal(geom)).sum(-1) / 2
    return (
        float(domain.integral(function.J(geom), degree=15).eval()),
        float(boundary.integral(flux * function.J(geom), degree=15).eval()),
        float(boundary.integral(function.J(geom), degree=15).eval()),
    )


@quick
@given(multipatches())
def test_area_and_circumference_are_the_same(mp):
    area, length = gauss(mp)
    found = integrals(*mp.to_nutils())
    # No Gauss rule integrates rational functions exactly.
    assert found == pytest.approx((area, area, length), rel=1e-6 if mp.is_rational else 1e-11)


@pytest.mark.parametrize("name", models.ALL)
def test_models_are_coupled_whatever_their_sides(name):
    mp = models.ALL[name]()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        domain, geom = mp.to_nutils()
    area, length = gauss(mp)
    assert integrals(domain, geom) == pytest.approx((area, area, length), rel=1e-11)
    # Splines that are continuous across patches, as many as there are control points: the knots are uniform.
    assert len(domain.basis("spline", degree=mp[0].degrees[0])) == mp.topology.n_points
    jump = domain.interfaces.integral((function.jump(geom) ** 2).sum(-1) * function.J(geom), degree=8)
    assert float(jump.eval()) < 1e-28


def test_degrees_knots_and_weights_may_differ_between_patches():
    arc = np.array([[1, 0], [1, 1], [0, 1]], float)
    ring = Patch(
        ([0, 0, 0, 1, 1, 1], [0, 0, 1, 1]), (2, 1), np.stack([arc, 2 * arc], 1), [[1, 1], [0.5**0.5] * 2, [1, 1]]
    )
    fine = ring.insert_knots(0, [0.1, 0.7]).insert_knots(1, [0.5, 0.5 + 1e-3])
    below = Patch(
        ([0, 0, 1, 1], [0, 0, 0.5, 0.501, 1, 1]),
        (1, 1),
        [[[x, y] for x in fine.control_points[0, :, 0]] for y in (-3, 0)],
    )
    mp = MultiPatch([turned(fine, True, False, True), below])
    assert len(mp.interfaces) == 1
    domain, geom = mp.to_nutils()
    assert len(domain) == 3 * 3 + 3
    assert integrals(domain, geom)[0] == pytest.approx(0.75 * np.pi + 3, rel=1e-11)
    assert integrals(domain, geom)[2] == pytest.approx(1.5 * np.pi + 8, rel=1e-8)


def test_labels_are_names_of_the_boundary():
    mp = models.plate_with_hole(2, 2)
    hole = [(side.patch, side.side) for side in mp.loops[1]]
    outside = [(side.patch, side.side) for side in mp.loops[0]]
    mp = mp.with_labels({"hole": hole, "out, side": outside, "none": []})
    with pytest.warns(InputWarning, match="label 'out, side' is 'out  side' in nutils"):
        domain, geom = mp.to_nutils()
    lengths = [domain.boundary[name].integral(function.J(geom), degree=12).eval() for name in ("hole", "out  side")]
    assert lengths == pytest.approx([0.8 * np.pi, 8], rel=1e-3)
    assert sum(lengths) == pytest.approx(gauss(mp)[1], rel=1e-10)
    assert float(domain.refined.boundary["hole"].integral(function.J(geom), degree=12).eval()) == pytest.approx(
        lengths[0]
    )


def test_labels_inside_are_named():
    mp = models.grid(2, 1)
    (f,) = mp.interfaces
    with pytest.warns(InputWarning, match=f"label 'a'.*left out: patch {f.patch_a} {f.side_a.name.lower()}"):
        mp.with_labels({"a": [(f.patch_a, f.side_a)]}).to_nutils()


@pytest.mark.parametrize("count", [1, 2])
def test_rings_of_one_or_two_patches_are_left_apart_with_a_warning(count):
    """Both boundaries of a patch run between the same two corners."""
    mp = models.annulus(count, 3, 4)
    if count == 1:
        # The sides of its one patch have one corner each: nutils tells them.
        domain, geom = mp.to_nutils()
        boundary = domain.boundary
    else:
        with pytest.warns(InputWarning, match=r"patches are left apart.*domain\.boundary\['outline'\]"):
            domain, geom = mp.to_nutils()
        boundary = domain.boundary["outline"]
    area, length = gauss(mp)
    assert integrals(domain, geom, boundary) == pytest.approx((area, area, length), rel=1e-11)


def test_a_slit_to_the_boundary_is_not_glued():
    mp = models.grid(2, 2)
    slit = MultiPatch(mp.patches, mp.interfaces[1:])
    area, length = gauss(slit)
    assert integrals(*slit.to_nutils()) == pytest.approx((area, area, length), rel=1e-11)


def test_a_slit_inside_is_not_glued():
    """Both ends of the slit are corners of both patches: they are left apart."""
    mp = models.o_grid(3, 2)
    slit = MultiPatch(mp.patches, [f for f in mp.interfaces if (f.patch_a, f.patch_b) != (0, 1)])
    assert len(slit.interfaces) == len(mp.interfaces) - 1
    with pytest.warns(InputWarning, match="left apart"):
        domain, geom = slit.to_nutils()
    area, length = gauss(slit)
    assert integrals(domain, geom, domain.boundary["outline"]) == pytest.approx((area, area, length), rel=1e-11)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_solution_in_continuous_splines_is_ours(seed):
    """Poisson's equation, assembled and solved by nutils, however the patches are turned."""
    solver = pytest.importorskip("nutils.solver")
    mp = models.grid(2, 1, 2, 3, seed=seed)
    domain, geom = mp.to_nutils()
    u = function.dotarg("u", domain.basis("spline", degree=2))
    energy = domain.integral((0.5 * (function.grad(u, geom) ** 2).sum(-1) - u) * function.J(geom), degree=14)
    fixed = solver.optimize("u,", domain.boundary.integral(u**2 * function.J(geom), degree=6), droptol=1e-12)
    solved = solver.optimize("u,", energy, constrain=fixed)
    total = float(domain.integral(u * function.J(geom), degree=14).eval(arguments=solved))
    ours = iga.PoissonSolver(mp, degree=2, points=5, knots="uniform").solve(
        mp, lambda x, y: 1 + 0 * x, lambda x, y: 0 * x
    )
    assert total == pytest.approx(_integral(ours.field, mp), rel=1e-6)


def _integral(field, mp: MultiPatch) -> float:
    x, w = np.polynomial.legendre.leggauss(6)
    total = 0.0
    for k, patch in enumerate(mp):
        (u, wu), (v, wv) = (_nodes(knots, x, w) for knots in patch.knots)
        du, dv = patch.grid(u, v, 1, 0), patch.grid(u, v, 0, 1)
        total += np.abs(du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]) * field.grid(k, u, v) @ wv @ wu
    return float(total)


@real.needed
@pytest.mark.parametrize("name", ["yeti", "turtle", "disc"])
def test_real_models(name):
    mp = real.model(name)
    area, length = gauss(mp)
    assert integrals(*mp.to_nutils()) == pytest.approx((area, area, length), rel=1e-10)
