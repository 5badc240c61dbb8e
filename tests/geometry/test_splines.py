"""Splines against SciPy, finite differences and the invariance of the geometry; immutability; refusals."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline, NdBSpline, PPoly

from patchtransfer import BSplineCurve, InputError, Patch
from patchtransfer.geometry.basis import collocation_matrix, knot_spans
from patchtransfer.geometry.packing import pack_curves, pack_patches, unpack_curves, unpack_patches
from shapes import circle
from strategies import boundaries, curves, multipatches, patches

quick = settings(max_examples=30, deadline=None)
LINE = ([0, 0, 1, 1], 1, [[0, 0], [2, 1]])


def inside(knots, count: int = 23) -> np.ndarray:
    """Parameters all over the domain, off the knots but for the ends."""
    breaks = knot_spans(knots)
    fraction = np.linspace(0.013, 0.987, 5)
    spans = breaks[:-1, None] + np.diff(breaks)[:, None] * fraction
    return np.concatenate([breaks[:1], spans.ravel(), breaks[-1:]])


def size(spline) -> float:
    return float(np.abs(spline.control_points).max()) + 1.0


@quick
@given(curves())
def test_curves_agree_with_scipy(curve):
    t = inside(curve.knots)
    h = BSpline(curve.knots, curve.homogeneous(), curve.degree)(t)
    np.testing.assert_allclose(curve(t), h[:, :2] / h[:, 2:], atol=1e-12 * size(curve))
    np.testing.assert_allclose(curve(curve.domain[0]), curve.start, atol=1e-14 * size(curve))
    np.testing.assert_allclose(curve(curve.domain[1]), curve.end, atol=1e-13 * size(curve))
    if curve.weights is None:
        for order in (1, 2):
            columns = [(curve.knots, c, curve.degree) for c in curve.control_points.T]
            slope = np.column_stack([PPoly.from_spline(c)(t, order) for c in columns])
            np.testing.assert_allclose(curve(t, order), slope, atol=1e-12 * (np.abs(slope).max() + size(curve)))
        assert BSplineCurve.from_scipy(curve.to_scipy()) == curve
        # Results do not depend on which of the two evaluates.
        for order in range(4):
            assert np.array_equal(curve(t, order), curve.to_scipy()(t, nu=order))


@quick
@given(curves(rational=True))
def test_derivatives_of_rational_curves_are_differences(curve):
    t, h = inside(curve.knots)[1:-1], 1e-4 * np.diff(knot_spans(curve.knots)).min()
    p, first = curve.degree, np.diff(knot_spans(curve.knots)).min()
    for order in (1, 2):
        difference = (curve(t + h, order - 1) - curve(t - h, order - 1)) / (2 * h)
        # Weights up to 100 : 1 make derivatives large; the differences lose eight digits at most.
        scale = size(curve) * (100 * p / first) ** order
        np.testing.assert_allclose(curve(t, order), difference, atol=1e-5 * scale)


@quick
@given(curves(), st.data())
def test_knots_can_be_inserted_without_changing_the_curve(curve, data):
    a, b = curve.domain
    inner = knot_spans(curve.knots)[1:-1]
    room = [x for x in inner if (curve.knots == x).sum() < curve.degree]
    fractions = data.draw(st.lists(st.floats(0.01, 0.99), max_size=3, unique=True))
    new = [a + f * (b - a) for f in fractions] + room[:1]
    new = [x for x in new if x in room or x not in inner]
    finer = curve.insert_knots(new)
    assert len(finer.control_points) == len(curve.control_points) + len(new)
    assert sorted([*curve.knots, *new]) == finer.knots.tolist()
    t = inside(curve.knots)
    np.testing.assert_allclose(finer(t), curve(t), atol=1e-11 * size(curve))


@quick
@given(curves(), st.integers(1, 3))
def test_elevation_keeps_the_curve(curve, by):
    raised = curve.elevate(by)
    assert raised.degree == curve.degree + by
    assert np.array_equal(knot_spans(raised.knots), knot_spans(curve.knots))
    t = inside(curve.knots)
    np.testing.assert_allclose(raised(t), curve(t), atol=1e-9 * size(curve))


@quick
@given(curves(), st.floats(0, 1), st.floats(0, 1))
def test_restriction_keeps_the_part(curve, x, y):
    a, b = sorted(curve.domain[0] + f * np.diff(curve.domain)[0] for f in (x, y))
    a, b = max(a, curve.domain[0]), min(b, curve.domain[1])
    if b - a < 1e-3:
        return
    part = curve.restrict(a, b)
    assert part.domain == (a, b)
    assert part.degree == curve.degree
    t = np.linspace(a, b, 31)
    np.testing.assert_allclose(part(t), curve(t), atol=1e-10 * size(curve))


@quick
@given(curves())
def test_restriction_to_single_spans_and_to_everything(curve):
    breaks, pieces = curve.bezier()
    whole = curve.restrict(*curve.domain)
    assert np.array_equal(whole.knots, curve.knots)
    np.testing.assert_allclose(whole.control_points, curve.control_points, atol=1e-14 * size(curve))
    for a, b, piece in zip(breaks[:-1], breaks[1:], pieces, strict=True):
        part = curve.restrict(a, b)
        np.testing.assert_allclose(part.homogeneous(), piece, atol=1e-10 * size(curve) * 10)


@quick
@given(curves())
def test_reversed_runs_backwards(curve):
    a, b = curve.domain
    t = inside(curve.knots)
    back = curve.reversed()
    np.testing.assert_allclose(back(a + b - t), curve(t), atol=1e-11 * size(curve))
    assert np.array_equal(back.start, curve.end)
    np.testing.assert_allclose(back.domain, curve.domain, rtol=1e-15, atol=1e-15)
    np.testing.assert_array_equal(back.reversed().control_points, curve.control_points)


@quick
@given(curves())
def test_bezier_points_are_the_curve(curve):
    breaks, pieces = curve.bezier()
    p = curve.degree
    assert pieces.shape == (len(breaks) - 1, p + 1, 3)
    s = np.linspace(0, 1, 7)
    bernstein = BSpline([0] * (p + 1) + [1] * (p + 1), np.eye(p + 1), p)(s)
    for a, b, points in zip(breaks[:-1], breaks[1:], pieces, strict=True):
        h = bernstein @ points
        np.testing.assert_allclose(h[:, :2] / h[:, 2:], curve(a + s * (b - a)), atol=1e-10 * size(curve))


def test_nurbs_circle_is_a_circle():
    c = circle(2.5)
    t = np.linspace(0, 4, 101)
    for same in (c, c.reversed(), c.insert_knots([0.3, 1.7]), c.elevate(2), c.restrict(0.2, 3.1)):
        radius = np.linalg.norm(same(np.linspace(*same.domain, 101)), axis=1)
        np.testing.assert_allclose(radius, 2.5, rtol=1e-14)
    # Radius and tangent are perpendicular, the curvature is 1 / r.
    d, dd = c(t[1:-1] + 1e-9, 1), c(t[1:-1] + 1e-9, 2)
    assert np.abs((d * c(t[1:-1] + 1e-9)).sum(axis=1)).max() < 1e-12
    curvature = (d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]) / np.linalg.norm(d, axis=1) ** 3
    np.testing.assert_allclose(curvature, 1 / 2.5, rtol=1e-10)


@quick
@given(patches())
def test_patches_agree_with_scipy(patch):
    u, v = (inside(k)[::3] for k in patch.knots)
    w = np.ones(patch.shape) if patch.weights is None else patch.weights
    h = NdBSpline(patch.knots, np.dstack([patch.control_points * w[..., None], w]), patch.degrees)
    values = h(np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1))
    np.testing.assert_allclose(patch.grid(u, v), values[..., :2] / values[..., 2:], atol=1e-12 * size(patch))
    np.testing.assert_array_equal(patch(u[1], v[2]), patch.grid([u[1]], [v[2]])[0, 0])
    if patch.weights is None:
        assert Patch.from_scipy(patch.to_scipy()) == patch


@quick
@given(patches())
def test_patch_derivatives_are_differences(patch):
    u, v = (inside(k)[1:-1:3] for k in patch.knots)
    for axis, degree in enumerate(patch.degrees):
        shortest = np.diff(knot_spans(patch.knots[axis])).min()
        h = 1e-4 * shortest
        move = (h, 0) if axis == 0 else (0, h)
        up, down = patch.grid(u + move[0], v + move[1]), patch.grid(u - move[0], v - move[1])
        slope = patch.grid(u, v, 1 - axis, axis)
        scale = size(patch) * 100 * degree / shortest
        np.testing.assert_allclose(slope, (up - down) / (2 * h), atol=1e-5 * scale)
    if patch.weights is None:
        mixed = (patch.grid(u, v + h, 1, 0) - patch.grid(u, v - h, 1, 0)) / (2 * h)
        np.testing.assert_allclose(patch.grid(u, v, 1, 1), mixed, atol=1e-5 * scale * 10 * patch.degrees[0] / 0.1)


@quick
@given(patches(), st.integers(0, 1))
def test_patches_keep_their_geometry(patch, axis):
    u, v = (inside(k)[::2] for k in patch.knots)
    expected = patch.grid(u, v)
    a, b = patch.knots[axis][[0, -1]]
    finer = patch.insert_knots(axis, [a + 0.37 * (b - a)])
    assert finer.shape[axis] == patch.shape[axis] + 1
    np.testing.assert_allclose(finer.grid(u, v), expected, atol=1e-11 * size(patch))
    raised = patch.elevate()
    assert raised.degrees == (patch.degrees[0] + 1, patch.degrees[1] + 1)
    np.testing.assert_allclose(raised.grid(u, v), expected, atol=1e-9 * size(patch))
    assert patch.with_control_points(patch.control_points) == patch


def test_collocation_partition_of_unity_and_one_sided_end():
    knots = [0, 0, 0, 1, 1, 3, 3, 3]
    t = np.linspace(0, 3, 17)
    values = collocation_matrix(knots, 2, t)
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(collocation_matrix(knots, 2, t, 1).sum(axis=1), 0, atol=1e-13)
    assert values[-1, -1] == 1


def test_values_are_immutable_copies():
    points = np.array([[0.0, 0], [1, 1]])
    curve = BSplineCurve([0, 0, 1, 1], 1, points)
    points[0] = 7
    assert curve.start.tolist() == [0, 0]
    patch = Patch(([0, 0, 1, 1],) * 2, (1, 1), np.zeros((2, 2, 2)), np.ones((2, 2)))
    for array in (curve.knots, curve.control_points, *patch.knots, patch.control_points, patch.weights):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError):
        curve.degree = 2
    with pytest.raises(AttributeError):
        patch.weights = None
    assert curve != BSplineCurve([0, 0, 1, 1], 1, [[0, 0], [1, 1.0000000001]])
    assert curve != BSplineCurve([0, 0, 1, 1], 1, curve.control_points, [1, 1])
    with pytest.raises(TypeError):
        hash(curve)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0, 0, 0, 0.6, 0.5, 1, 1, 1], 2, np.zeros((5, 2))), r"curve.*decreases at knot 4"),
        (([0, 0, 1], 1, [[0, 0], [1, 0]]), r"curve.*2 control points has 4 knots, got 3"),
        (([0, 0, 1, 1], 2, [[0, 0]]), r"curve.*degree 2.*at least 3 control points, got 1"),
        (([0, 0, 1, np.nan], 1, [[0, 0], [1, 0]]), r"curve knots.*NaN"),
        (([0, 0, 1, 1], 1, [[0, 0], [1, np.inf]]), r"curve control points.*NaN or infinity"),
        (([0, 0, 1, 1], 1, [[0, 0], [1, "x"]]), r"curve control points.*not an array of numbers"),
        (([0, 0, 1, 1], 1, [[0, 0, 0], [1, 0, 0]]), r"curve control points.*\(n, 2\).*\(2, 3\)"),
        (([0, 1], 0, [[0, 0]]), r"curve.*degree 0"),
        (([0, 0.5, 1, 1], 1, [[0, 0], [1, 0]]), r"curve.*not clamped.*repeated 2 times"),
        (([2, 2, 2, 2], 1, [[0, 0], [1, 0]]), r"curve.*spans nothing"),
        (([0, 0, 0.5, 0.5, 1, 1], 1, np.zeros((4, 2))), r"curve.*interior knot.*above the degree 1"),
        (([0, 0, 0, 1, 1], 1, np.zeros((3, 2))), r"curve.*interior knot.*above the degree 1"),
        ((*LINE, [1, 0]), r"curve.*weight 0 is not positive"),
        ((*LINE, [1, -2]), r"curve.*weight -2 is not positive"),
        ((*LINE, [1, np.nan]), r"curve: weights.*NaN"),
        ((*LINE, [1, 1, 1]), r"curve.*weights have shape \(3,\)"),
    ],
)
def test_bad_curves_are_refused_by_name(arguments, message):
    with pytest.raises(InputError, match=message) as caught:
        BSplineCurve(*arguments)
    assert "\n" not in str(caught.value)


K = [0, 0, 1, 1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((([0, 0, 0, 0.6, 0.5, 1, 1, 1], K), (2, 1), np.zeros((5, 2, 2))), "direction u.*decreases"),
        (((K, [0, 0, 1]), (1, 1), np.zeros((2, 2, 2))), "direction v.*4 knots, got 3"),
        (((K, [0, 0.5, 1, 1]), (1, 1), np.zeros((2, 2, 2))), "direction v.*clamped"),
        (((K, [0, 1]), (1, 0), np.zeros((2, 1, 2))), "direction v.*degree 0"),
        (((K, [0, 0, np.nan, 1]), (1, 1), np.zeros((2, 2, 2))), "patch knots v.*NaN"),
        (((K, K), (1, 1), np.full((2, 2, 2), np.nan)), "patch control points.*NaN"),
        (((K, K), (1, 1), np.zeros((2, 2, 3))), r"\(n_u, n_v, 2\), got \(2, 2, 3\)"),
        (((K, K), (1, 1), np.zeros((2, 3, 2))), "direction v.*3 control points has 5 knots"),
        (((K, K), (1, 1), np.zeros((2, 2, 2)), [[1, 1], [1, 0]]), "patch.*weight 0 is not positive"),
        (((K, K), (1, 1), np.zeros((2, 2, 2)), np.ones((2, 1))), r"patch.*shape \(2, 1\)"),
        (((K,), (1, 1), np.zeros((2, 2, 2))), "two knot vectors"),
    ],
)
def test_bad_patches_are_refused_by_name(arguments, message):
    with pytest.raises(InputError, match=message):
        Patch(*arguments)


def test_operations_refuse_what_they_cannot_do():
    curve = BSplineCurve(*LINE)
    with pytest.raises(InputError, match=r"knot 1.5 .* not inside the domain \(0, 1\)"):
        curve.insert_knots([1.5])
    with pytest.raises(InputError, match="multiplicity"):
        curve.insert_knots([0.5, 0.5])
    for a, b in ((0.5, 0.5), (0.7, 0.2), (-1, 0.5), (0.5, 2), (np.nan, 1)):
        with pytest.raises(InputError, match="interval"):
            curve.restrict(a, b)
    with pytest.raises(InputError, match="rational"):
        circle().to_scipy()
    with pytest.raises(InputError, match="clamped"):
        BSplineCurve.from_scipy(BSpline([0, 1, 2, 3, 4, 5], np.zeros((3, 2)), 2))


@given(st.lists(curves(), max_size=4), st.lists(patches(), max_size=3))
def test_packed_splines_come_back_to_the_bit(some_curves, some_patches):
    again = unpack_curves(pack_curves(some_curves)), unpack_patches(pack_patches(some_patches))
    for before, after in zip((some_curves, some_patches), again, strict=True):
        assert list(after) == before
        for one, other in zip(before, after, strict=True):
            assert vars(one).keys() == vars(other).keys()
            assert not other.control_points.flags.writeable


@given(multipatches(), boundaries())
def test_models_and_boundaries_are_picklable(multipatch, boundary):
    again = pickle.loads(pickle.dumps(multipatch))
    assert again == multipatch
    assert np.array_equal(again.topology.coordinates, multipatch.topology.coordinates)
    assert pickle.loads(pickle.dumps(boundary)) == boundary
