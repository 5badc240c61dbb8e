"""Points found in a model: there and back again, outside by winding numbers, on interfaces, in bad company."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
from patchtransfer import InputError, MultiPatch, Patch, certify, examples
from patchtransfer._core import set_threads
from shapes import turned
from strategies import multipatches

quick = settings(max_examples=25, deadline=None)

RESIDUAL = 1e-12


def random_points(mp: MultiPatch, seed: int, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Patches, parameters and points (n, 2) at random, mixed; a tenth on sides, some at corners."""
    rng = np.random.default_rng(seed)
    patch = rng.integers(0, len(mp.patches), n)
    u, v, x = np.empty(n), np.empty(n), np.empty((n, 2))
    for k, p in enumerate(mp.patches):
        own = patch == k
        for t, limits in ((u, p.domain[0]), (v, p.domain[1])):
            t[own] = rng.uniform(*limits, own.sum())
            t[own & (rng.random(n) < 0.05)] = limits[rng.integers(0, 2)]
        x[own] = p(u[own], v[own])
    return patch, u, v, x


def residual(mp: MultiPatch, found, x: np.ndarray) -> np.ndarray:
    """Distances of the found points, relative to the diameter; NaN where nothing is found."""
    patch, u, v = found
    out = np.full(len(x), np.nan)
    for k, p in enumerate(mp.patches):
        own = patch == k
        out[own] = np.linalg.norm(p(u[own], v[own]) - x[own], axis=1) / mp.diameter
    return out


def winding_number(polygon: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Of a closed polygon (m, 2) about the points (n, 2): the angles under which its edges are seen."""
    a = polygon - x[:, None]
    b = np.roll(a, -1, axis=1)
    angle = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=-1))
    return np.rint(angle.sum(axis=1) / (2 * np.pi))


@quick
@given(multipatches(), st.integers(0, 99))
def test_there_and_back_again(mp, seed):
    patch, u, v, x = random_points(mp, seed, 200)
    found = mp.locate(x)
    assert residual(mp, found, x).max() <= RESIDUAL
    assert (found[0] <= patch).all()
    # Inside a patch there is one place only.
    same = found[0] == patch
    for t, again, axis in ((u, found[1], 0), (v, found[2], 1)):
        for k, p in enumerate(mp.patches):
            own = same & (patch == k)
            a, b = p.domain[axis]
            assert np.abs(t[own] - again[own]).max(initial=0.0) <= 1e-8 * (b - a)


@pytest.mark.parametrize("name", models.ALL)
def test_sample_models_hold_their_points_and_no_others(name):
    mp = models.jiggled(models.ALL[name](), 3, 0.004)
    assert certify(mp).injective
    x = random_points(mp, 1, 2000)[3]
    assert residual(mp, mp.locate(x), x).max() <= RESIDUAL
    low, high = (f(np.concatenate([p.control_points.reshape(-1, 2) for p in mp.patches]), 0) for f in (np.min, np.max))
    x = np.random.default_rng(2).uniform(low - 0.1 * mp.diameter, high + 0.1 * mp.diameter, (2000, 2))
    patch, u, v = mp.locate(x)
    loops = [np.concatenate([c(np.linspace(*c.domain, 201)[:-1]) for c in loop]) for loop in mp.boundary().loops]
    inside = sum(winding_number(loop, x) for loop in loops)
    # A polygon of so many sides is nearer than that to its curve.
    distance = np.array([min(np.linalg.norm(loop - y, axis=1).min() for loop in loops) for y in x])
    clear = distance > 0.01 * mp.diameter
    assert clear.sum() > 1000
    assert np.array_equal(patch[clear] >= 0, inside[clear] == 1)
    assert np.isnan(u[patch < 0]).all()
    assert np.isnan(v[patch < 0]).all()


def test_points_on_interfaces_belong_to_the_lowest_patch():
    mp = models.o_grid()
    for f in mp.interfaces:
        for k, side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b)):
            p = mp.patches[k]
            t = np.linspace(*p.domain[side.axis], 33)
            end = p.domain[1 - side.axis][int(side.at_end)]
            x = p(end, t) if side.axis == 1 else p(t, end)
            patch, _, _ = mp.locate(x)
            assert (patch[1:-1] == min(f.patch_a, f.patch_b)).all()
            # The ends are vertices, with more patches around them.
            assert (patch[[0, -1]] <= min(f.patch_a, f.patch_b)).all()


def test_every_vertex_belongs_to_its_lowest_patch():
    mp = models.star(6)
    x = mp.topology.coordinates[[vertex.point for vertex in mp.vertices]]
    lowest = [min(k for k, _ in vertex.corners) for vertex in mp.vertices]
    assert mp.locate(x)[0].tolist() == lowest


@quick
@given(multipatches(), st.floats(1e-9, 0.2))
def test_points_outside_go_to_the_nearest_point_of_the_boundary_within_the_tolerance(mp, share):
    # Outwards by the normal from points of the sides; the nearest point may be another one, but is no farther.
    for k, side in mp.boundaries[:3]:
        curve = mp.topology.directed_side(k, side).curve(mp.patches)
        t = np.linspace(*curve.domain, 9)[1:-1]
        tangent = curve.derivative(t)
        normal = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / np.linalg.norm(tangent, axis=1)[:, None]
        distance = share * mp.diameter
        x = curve(t) + distance * normal
        outside = mp.locate(x)[0] < 0
        found = mp.locate(x, tolerance=1.001 * share)
        assert (found[0] >= 0).all()
        nearest = residual(mp, found, x)
        assert nearest.max() <= 1.00001 * share + 1e-15
        loops = mp.boundary().loops
        sampled = np.concatenate([c(np.linspace(*c.domain, 400)) for loop in loops for c in loop])
        for y, d in zip(x[outside], nearest[outside] * mp.diameter, strict=True):
            assert d <= np.linalg.norm(sampled - y, axis=1).min() * (1 + 2e-6)


def test_a_rational_ring_far_from_the_origin_and_turned():
    half = np.sqrt(0.5)
    ring = [[[r, 0], [r, r], [0, r]] for r in (1.0, 3.0)]
    weights = [[1, half, 1]] * 2
    for shift, allowed in ((0.0, RESIDUAL), (1e6, 1e-9)):
        for turn in ((False, False, False), (True, False, True), (False, True, True)):
            points = np.array(ring) + shift
            patch = Patch(([0, 0, 1, 1], [5, 5, 5, 6, 6, 6]), (1, 2), points, weights)
            mp = MultiPatch([turned(patch, *turn)])
            x = random_points(mp, 7, 500)[3]
            assert residual(mp, mp.locate(x), x).max() <= allowed
            # The circle's centre is no part of it; at 1 from every point of the inner side.
            assert mp.locate([shift, shift])[0] == -1
            assert mp.locate([shift, shift], tolerance=1.01 / mp.diameter)[0] == 0


def test_extreme_weights_and_high_degrees():
    rng = np.random.default_rng(5)
    patch = models.interpolated(lambda u, v: models.wave(np.stack([u, v], -1)), 2, 1).elevate(7)
    weights = np.exp(rng.uniform(-3, 3, patch.shape[0]))[:, None] * np.exp(rng.uniform(-3, 3, patch.shape[1]))
    for mp in (MultiPatch([patch]), MultiPatch([Patch(patch.knots, patch.degrees, patch.control_points, weights)])):
        assert certify(mp).injective
        x = random_points(mp, 5, 500)[3]
        assert residual(mp, mp.locate(x), x).max() <= RESIDUAL


def test_thin_and_sheared_patches():
    shear = np.array([[1.0, 50.0], [0.0, 1e-3]])
    for name in ("o-grid p3", "annulus p3"):
        mp = models.ALL[name]()
        thin = mp.with_control_points([p.control_points @ shear.T for p in mp.patches])
        x = random_points(thin, 11, 500)[3]
        assert residual(thin, thin.locate(x), x).max() <= RESIDUAL


def test_results_are_the_same_to_the_bit_for_any_number_of_threads_and_order_of_points():
    mp = models.plate_with_hole()
    x = np.random.default_rng(4).uniform(-1.1, 1.1, (20_000, 2))
    try:
        results = []
        for threads in (1, 2, 5):
            set_threads(threads)
            results.append(copy.copy(mp).locate(x, tolerance=0.05))
    finally:
        set_threads(0)
    for other in results[1:]:
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(results[0], other, strict=True))
    order = np.random.default_rng(5).permutation(len(x))
    mixed = mp.locate(x[order], tolerance=0.05)
    assert all(np.array_equal(a[order], b, equal_nan=True) for a, b in zip(results[0], mixed, strict=True))


def test_shapes_follow_the_points_and_models_may_be_pickled():
    mp = models.l_shape()
    x = mp.patches[1]([[0.2], [0.4]], [0.1, 0.5, 0.9])
    found = mp.locate(x)
    assert [a.shape for a in found] == [(2, 3)] * 3
    assert found[0].dtype == np.int64
    again = pickle.loads(pickle.dumps(mp)).locate(x)
    assert all(np.array_equal(a, b) for a, b in zip(found, again, strict=True))
    assert [a.shape for a in mp.locate(x[0, 0])] == [()] * 3
    assert [a.shape for a in mp.locate(np.empty((0, 2)))] == [(0,)] * 3
    # The plane to the left of everything, and the whole of it.
    assert mp.locate([-1e300, 0.0])[0] == -1
    assert mp.locate([-1e3, 0.0], tolerance=np.inf)[0] >= 0


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (np.zeros((3, 3)), {}, r"must have shape \(..., 2\), got \(3, 3\)"),
        (1.0, {}, r"must have shape \(..., 2\), got \(\)"),
        ([[0, 0], [np.nan, 1]], {}, r"point 1 is \(nan, 1.0\); leave it out"),
        (["here"], {}, "not an array of numbers"),
        ([0, 0], {"tolerance": -1e-3}, "tolerance = -0.001: a number from 0 on"),
        ([0, 0], {"tolerance": np.nan}, "tolerance = nan"),
    ],
)
def test_what_is_no_point_is_refused(points, options, message):
    with pytest.raises(InputError, match=message):
        models.grid().locate(points, **options)


@pytest.mark.parametrize("name", ["wrench", "human"])
def test_bundled_models(name):
    mp = examples.load(name)[0]
    patch, _, _, x = random_points(mp, 0, 3000)
    found = mp.locate(x)
    assert residual(mp, found, x).max() <= RESIDUAL
    assert (found[0] <= patch).all()
