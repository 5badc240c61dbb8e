"""Weights and knots of extreme ratios: refused by name beyond the bounds, and without overflow within them."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import patchtransfer as pt
from patchtransfer import BSplineCurve, InputError, Patch
from patchtransfer.io import gismo
from patchtransfer.limits import LARGEST, MAX_KNOT_RATIO, MAX_WEIGHT_RATIO, first_unusable

quick = settings(max_examples=60, deadline=None)
LINE = ([0, 0, 1, 1], 1, [[0, 0], [2, 1]])
#: What a first derivative is at most, in units of the points and the domain; a second one its square.
FASTEST = 1e48
NEAR = [1e-30, 2e-30, 1e-20, 1e-17, 0.3, np.nextafter(0.3, 1), 0.5, np.nextafter(1, 0)]


@st.composite
def extreme_curves(draw, ratio=MAX_WEIGHT_RATIO):
    """Of any degree and any unit of the weights, with near knots, in the unit square."""
    p = draw(st.integers(1, 5))
    breaks = sorted(draw(st.sets(st.sampled_from(NEAR), max_size=4)))
    inner = [x for x in breaks for _ in range(draw(st.integers(1, p)))]
    knots = [0.0] * (p + 1) + inner + [1.0] * (p + 1)
    n = len(knots) - p - 1
    seed = np.random.default_rng(draw(st.integers(0, 2**32)))
    unit = draw(st.sampled_from([1.0, 1e-134, 1e134]))
    half = np.log10(ratio) / 2
    weights = unit * 10.0 ** seed.choice([-half, 0.0, half, seed.uniform(-half, half)], n)
    return BSplineCurve(knots, p, seed.uniform(0, 1, (n, 2)), weights)


def spread(curve) -> np.ndarray:
    """Parameters at all knots and between them."""
    breaks = np.unique(curve.knots)
    return np.unique(np.concatenate([breaks, (breaks[:-1, None] + np.diff(breaks)[:, None] * [0.1, 0.5, 0.9]).ravel()]))


@quick
@given(extreme_curves())
def test_derivatives_within_the_bounds_are_finite(curve):
    t = spread(curve)
    points = curve(t)
    assert (points >= -1e-12).all()
    assert (points <= 1 + 1e-12).all()
    for order in (1, 2):
        assert np.abs(curve(t, order)).max() <= FASTEST**order


@quick
@given(extreme_curves())
def test_derivatives_of_patches_within_the_bounds_are_finite(curve):
    net = np.stack([curve.control_points, curve.control_points[::-1] + 2], axis=1)
    weights = np.stack([curve.weights, curve.weights[::-1]], axis=1)
    patch = Patch((curve.knots, [0, 0, 1, 1]), (curve.degree, 1), net, weights)
    for du, dv in ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0)):
        assert np.abs(patch.grid(spread(curve), [0.0, 0.5, 1.0], du, dv)).max() <= 3 * FASTEST ** max(du + dv, 1)


@quick
@given(extreme_curves(), st.integers(-400, 400))
def test_a_common_factor_of_weights_changes_no_bit(curve, exponent):
    weights = np.ldexp(curve.weights / curve.weights.max(), exponent)
    other = BSplineCurve(curve.knots, curve.degree, curve.control_points, weights)
    again = BSplineCurve(curve.knots, curve.degree, curve.control_points, np.ldexp(weights, 20))
    for order in (0, 1, 2):
        assert np.array_equal(other(spread(curve), order), again(spread(curve), order))


@quick
@given(extreme_curves(ratio=10.0), st.integers(1, 3))
def test_elevation_between_near_knots_keeps_the_curve(curve, by):
    higher = curve.elevate(by)
    assert higher.degree == curve.degree + by
    assert np.array_equal(np.unique(higher.knots), np.unique(curve.knots))
    t = spread(curve)
    np.testing.assert_allclose(higher(t), curve(t), atol=1e-13)


@quick
@given(extreme_curves(), st.integers(1, 3))
def test_elevated_weights_are_means_of_the_given_ones(curve, by):
    higher = curve.elevate(by)
    assert curve.weights.min() <= higher.weights.min() <= higher.weights.max() <= curve.weights.max()
    np.testing.assert_allclose(higher.control_points[[0, -1]], curve.control_points[[0, -1]], rtol=1e-15)


def test_elevation_against_exact_blossoms():
    """The coefficient of a cubic at the knots (a, a, b) is the mean of the quadratic's at (a, b), (a, b) and (a, a)."""
    a, b = 0.25, 0.75
    curve = BSplineCurve([0, 0, 0, a, b, 1, 1, 1], 2, [[0, 1], [1, 5], [4, -2], [2, 2], [7, 0]])
    c = [[Fraction(x) for x in row] for row in curve.control_points.tolist()]
    # f(a, a) lies between f(0, a) and f(a, b), whose knots range from 0 to b.
    third = Fraction(1, 3)
    twice = [(1 - third) * x + third * y for x, y in zip(c[1], c[2], strict=True)]
    expected = [(2 * y + x) / 3 for x, y in zip(twice, c[2], strict=True)]
    higher = curve.elevate()
    assert higher.knots.tolist() == [0] * 4 + [a] * 2 + [b] * 2 + [1] * 4
    np.testing.assert_allclose(higher.control_points[3], [float(x) for x in expected], rtol=1e-15)


def model(weights, near: float = 0.5, gap: float = 0.0) -> pt.MultiPatch:
    """Two squares side by side that are not glued, one of them rational."""
    lower = np.array([[[0.0, 0.0], [0.0, 0.5], [0.0, 1.0]], [[1.0, 0.0], [1.0, 0.5], [1.0, 1.0]]])
    right = np.array([[[1.0, 0.0], [1.0, 1.0]], [[2.0, 0.0], [2.0, 1.0]]]) + np.array([gap, 0.0])
    first = Patch(([0, 0, 1, 1], [0, 0, near, 1, 1]), (1, 1), lower, weights)
    return pt.MultiPatch([first, Patch(([0, 0, 1, 1],) * 2, (1, 1), right)], ())


@pytest.mark.parametrize("near", [0.5, 1e-30, np.nextafter(1, 0)])
@pytest.mark.parametrize("gap", [0.0, 1e-4])
@pytest.mark.parametrize("light", [1e-8, 1e-16])
def test_unglued_sides_of_extreme_weights_are_examined(light, near, gap):
    """Found by fuzzing: the search for the nearest point of such a side overflowed."""
    for row in ([1, light, 1], [light, 1, light], [1, 1, light]):
        certificate = pt.certify(model([[1, 1, 1], row], near, gap), max_depth=6)
        assert certificate.status in ("certified", "degenerate", "undecided")
        pt.check_continuity(model([[1, 1, 1], row], near, gap))


def test_certificate_of_near_knots_and_other_degrees():
    """Degrees are raised to compare two sides, where near knots gave NaN."""
    near = [0.3, np.nextafter(0.3, 1)]
    y = np.array([0.0, *near, 1.0])
    lower = np.stack(np.broadcast_arrays(np.array([0.0, 1.0])[:, None], y), axis=-1)
    first = Patch(([0, 0, 1, 1], [0, 0, *near, 1, 1]), (1, 1), lower)
    second = Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[1, 0], [1, 1]], [[2, 0], [2, 1]]]).elevate(2)
    certificate = pt.certify(pt.MultiPatch([first, second], ()))
    assert "patch 0 east and patch 1 west coincide" in " ".join(certificate.reasons)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ([1, 1e-17], r"curve: weights from 1e-17 to 1; .* factor of 1e\+16"),
        ([1e-10, 1e10], r"curve: weights from 1e-10 to 1e\+10"),
        ([1, 5e-324], r"curve: weights from 4.94066e-324"),
        ([1e-151, 1e-151], "from 1e-150 to"),
        ([1e151, 1e151], r"to 1e\+150: correct or scale them"),
    ],
)
def test_weights_beyond_the_bounds_are_refused(weights, message):
    with pytest.raises(InputError, match=message) as caught:
        BSplineCurve(*LINE, weights)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="patch: weights from"):
        Patch(([0, 0, 1, 1],) * 2, (1, 1), np.zeros((2, 2, 2)), [weights, weights])


@pytest.mark.parametrize("unit", [1.0, 1 / LARGEST, LARGEST / MAX_WEIGHT_RATIO])
def test_weights_at_the_bounds_are_taken(unit):
    assert BSplineCurve(*LINE, [unit, unit * MAX_WEIGHT_RATIO])(0.5) is not None


@pytest.mark.parametrize("length", [1e-200, 1.0, 1e150])
def test_knots_nearer_than_the_bound_are_refused(length):
    points = [[0, 0], [1, 0], [1, 1]]
    near = 1.01 * length / MAX_KNOT_RATIO
    BSplineCurve(np.array([0, 0, near, length, length]), 1, points)
    with pytest.raises(InputError, match=r"curve: the knots 0\.0 and .* are nearer than 1e-30 of the domain.* equal"):
        BSplineCurve(np.array([0, 0, near / 2, length, length]), 1, points)
    with pytest.raises(InputError, match=r"patch direction v: the knots 0\.0 and "):
        Patch(([0, 0, 1, 1], [0, 0, near / 2, length, length]), (1, 1), np.zeros((2, 3, 2)))


def test_a_domain_longer_than_all_numbers_is_refused():
    with pytest.raises(InputError, match="domain's length"):
        BSplineCurve([-1e308, -1e308, 1e308, 1e308], 1, [[0, 0], [1, 0]])


def test_a_file_is_refused_with_the_patch():
    text = gismo.format_multipatch(model([[1, 1, 1], [1, 0.25, 1]]))
    with pytest.raises(InputError, match=r"Geometry id=0 .*weights from 1e-20 to 1"):
        gismo.read_multipatch(text.replace("0.25", "1e-20").encode())


def test_the_first_unusable_number():
    assert first_unusable([[1.0, LARGEST], [-LARGEST, 0.0]]) is None
    assert first_unusable([]) is None
    for bad in (np.nan, np.inf, -np.inf, 2 * LARGEST, -2 * LARGEST):
        assert first_unusable([[1.0, 2.0], [3.0, bad], [bad, 4.0]]) == 3
