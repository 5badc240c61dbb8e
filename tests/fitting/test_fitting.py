"""Fits: exactness, orders of accuracy, shared end points, smooth joints."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

import models
import targets
from patchtransfer import Boundary, BSplineCurve, InputError, MultiPatch, Patch
from patchtransfer.fitting.fit import fit_boundary
from patchtransfer.geometry.outline import Outline, hausdorff
from patchtransfer.registration.register import register
from shapes import polygon


def curves(fitted):
    return [[side.curve for side in sides] for sides in fitted.loops]


def joints(fitted):
    """(curve before, curve after, smooth) at every joint."""
    for sides in fitted.loops:
        for i, side in enumerate(sides):
            yield sides[i - 1].curve, side.curve, side.smooth


def split_patch(degree: int) -> MultiPatch:
    """A bent patch cut into four at its middle knots: the joints on its sides are exactly smooth."""
    (whole,) = models.grid(1, 1, degree, 4, seed=None).patches
    for axis in (0, 1):
        whole = whole.insert_knots(axis, [0.5] * (degree - 1))
    n = whole.shape[0] // 2
    low, high = slice(0, n + 1), slice(n, None)
    knots = models.uniform_knots(degree, 2)
    parts = [whole.control_points[i, j] for i in (low, high) for j in (low, high)]
    return MultiPatch([Patch((knots, knots), (degree, degree), c) for c in parts])


@pytest.mark.parametrize("degree", [2, 3])
def test_the_source_fits_itself_to_rounding(degree):
    mp = split_patch(degree)
    boundary = mp.boundary()
    rows = np.array([[*c.start, *c.start] for loop in boundary.loops for c in loop])
    fitted = fit_boundary(register(boundary.loops, boundary, rows))
    assert sum(smooth for *_, smooth in joints(fitted)) == 4
    for loop, found in zip(boundary.loops, curves(fitted), strict=True):
        for a, b in zip(loop, found, strict=True):
            np.testing.assert_allclose(b.control_points, a.control_points, atol=1e-9 * mp.diameter)
    assert fitted.error < 1e-12
    assert fitted.warnings == ()


@pytest.mark.parametrize("parameters", ["speed", "uniform"])
@pytest.mark.parametrize("name", ["plate with hole p2", "annulus p3", "o-grid p2", "l-shape p3"])
def test_ends_are_shared_to_the_bit_and_spaces_are_the_sources(name, parameters):
    mp = models.ALL[name]()
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    registration = register(mp.boundary().loops, target, landmarks)
    fitted = fit_boundary(registration, parameters=parameters)
    for before, after, _ in joints(fitted):
        assert np.array_equal(before.end, after.start)
    for loop, found, r in zip(mp.boundary().loops, curves(fitted), registration.loops, strict=True):
        for a, b, s in zip(loop, found, r.joints[:-1], strict=True):
            assert b.degree == a.degree
            assert np.array_equal(b.knots, a.knots)
            assert np.array_equal(b.start, r.target.point(s))
        # The reported error is the Hausdorff distance, here by dense sampling.
        dense = np.concatenate([c(np.linspace(*c.domain, 400)) for c in found])
        assert r.target.nearest(dense)[1].max() <= 1.05 * fitted.error * target.diameter + 1e-12
    distances = [hausdorff(Outline(c), r.target) for c, r in zip(curves(fitted), registration.loops, strict=True)]
    box = np.linalg.norm(np.ptp(np.concatenate([r.target.polygon(4000) for r in registration.loops]), axis=0))
    assert fitted.error == pytest.approx(max(distances) / box, rel=1e-2)
    assert fitted.error < 5e-3


@pytest.mark.parametrize("name", ["annulus p3", "o-grid p2", "o-grid p3", "plate with hole p2"])
def test_smooth_joints_have_no_kink_and_corners_stay(name):
    mp = models.ALL[name]()
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    registration = register(mp.boundary().loops, target, landmarks)
    fitted = fit_boundary(registration)
    turns = np.concatenate([r.target.turn(r.joints[:-1]) for r in registration.loops])
    assert sum(smooth for *_, smooth in joints(fitted)) >= 4
    for (before, after, smooth), turn in zip(joints(fitted), turns, strict=True):
        legs = before.end - before.control_points[-2], after.control_points[1] - after.start
        cross, dot = legs[0][0] * legs[1][1] - legs[0][1] * legs[1][0], legs[0] @ legs[1]
        kink = np.degrees(np.arctan2(cross, dot))
        if smooth:
            assert abs(kink) <= 1e-9
        else:
            assert kink == pytest.approx(np.degrees(turn), abs=5)


def radius(angle):
    return 1 + 0.1 * np.cos(2 * angle) + 0.05 * np.sin(angle)


def wavy_ring(pieces: int = 3) -> Boundary:
    """A smooth closed curve, so finely interpolated that it counts as exact."""
    t = np.linspace(0, 2 * np.pi, 1201)
    r = radius(t)
    points = np.column_stack([r * np.cos(t), r * np.sin(t)])
    n = (len(t) - 1) // pieces
    return Boundary([[targets.through(points[k * n : (k + 1) * n + 1], 5) for k in range(pieces)]])


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("parameters", ["speed", "uniform"])
def test_order_of_accuracy(degree, parameters):
    """Error O(h^(p+1)) on a smooth curve: at least p + 1/2 observed over a refinement by four."""
    target = wavy_ring()
    errors = []
    for spans in (8, 16, 32):
        knots = models.uniform_knots(degree, spans)
        t = models.greville(knots, degree)
        loop = []
        for k in range(4):
            angle = np.pi / 2 * (k + t)
            loop.append(BSplineCurve(knots, degree, np.column_stack([np.cos(angle), np.sin(angle)])))
        at = np.pi / 2 * np.arange(4)
        r = radius(at)
        rows = np.column_stack([np.cos(at), np.sin(at), r * np.cos(at), r * np.sin(at)])
        fitted = fit_boundary(register([loop], target, rows), parameters=parameters, tolerance=1e-9)
        errors.append(fitted.error)
    order = np.log2(errors[0] / errors[2]) / 2
    assert order >= degree + 0.5
    assert errors[2] < errors[1] < errors[0]


@pytest.mark.parametrize("name", ["plate with hole p2", "annulus p3", "o-grid p2", "o-grid p3", "grid p2"])
def test_speed_parameters_are_at_least_as_good_as_uniform_ones(name):
    mp = models.ALL[name]()
    for f in (targets.bend(mp, 40), targets.bump(mp, (0.9, 0.6), (0.1, 0.05), 0.25)):
        target, landmarks = targets.deformed(mp, f)
        registration = register(mp.boundary().loops, target, landmarks)
        # The default stops improving well below the tolerance: uniform parameters may be luckier there.
        enough = 0.4 * 1e-3
        uniform = fit_boundary(registration, parameters="uniform").error
        assert fit_boundary(registration).error <= max(1.2 * uniform, enough)


def test_uniform_is_the_least_squares_of_the_paper():
    """Eq. 6 with `numpy.linalg.lstsq`: uniform parameters, both ends interpolated."""
    mp = models.grid(1, 1, 3, 3, seed=None)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    registration = register(mp.boundary().loops, target, landmarks)
    fitted = fit_boundary(registration, parameters="uniform")
    (r,) = registration.loops
    for i, side in enumerate(fitted.loops[0]):
        c = side.curve
        samples = 14 * 3 + 1
        t = np.linspace(*c.domain, samples)
        q = r.target.point(np.linspace(r.joints[i], r.joints[i + 1], samples))
        basis = BSpline(c.knots, np.eye(len(c.control_points)), c.degree)(t)
        known = basis[:, [0]] * q[0] + basis[:, [-1]] * q[-1]
        inner = np.linalg.lstsq(basis[:, 1:-1], q - known, rcond=None)[0]
        np.testing.assert_allclose(c.control_points[1:-1], inner, atol=1e-11)


def test_sides_that_miss_the_tolerance_are_named():
    mp = models.grid(1, 1, 2, 1)
    target, landmarks = targets.deformed(mp, targets.bump(mp, (1, 0.5), (0.2, 0), 0.1))
    registration = register(mp.boundary().loops, target, landmarks)
    fitted = fit_boundary(registration)
    missed = [i for i, side in enumerate(fitted.loops[0]) if side.error > 1e-3]
    assert 0 < len(missed) < 4
    assert len(fitted.warnings) == len(missed)
    for i, warning in zip(missed, fitted.warnings, strict=True):
        assert f"boundary loop 0, side {i}:" in warning
        assert "refine the source" in warning
    assert fit_boundary(registration, tolerance=0.5).warnings == ()


def test_straight_sides_stay_straight():
    """The target of a polygon by a polygon of the same corners is exact whatever the degree."""
    mp = models.build([models.bilinear((0, 0), (2, 0), (2, 1), (0, 1))], 3, 2, None)
    corners = [[0, 0], [3, 0.5], [2.5, 2], [-0.5, 1.5]]
    rows = np.hstack([[[0, 0], [2, 0], [2, 1], [0, 1]], corners])
    fitted = fit_boundary(register(mp.boundary().loops, Boundary([polygon(corners)]), rows))
    assert fitted.error < 1e-12
    for c in curves(fitted)[0]:
        d = c.control_points - c.start
        e = c.end - c.start
        assert np.abs(d[:, 0] * e[1] - d[:, 1] * e[0]).max() < 1e-12
        assert (np.diff(d @ e) > 0).all()


def test_options_are_checked():
    mp = models.grid(1, 1)
    registration = register(mp.boundary().loops, mp.boundary())
    with pytest.raises(InputError, match=r'"speed" or "uniform", got .chord'):
        fit_boundary(registration, parameters="chord")
