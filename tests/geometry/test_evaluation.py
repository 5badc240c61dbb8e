"""Points and derivatives at many parameters at once: against SciPy and exact fractions."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from patchtransfer import BSplineCurve, InputError, Patch
from shapes import circle
from strategies import curves, patches

quick = settings(max_examples=40, deadline=None)
orders = st.integers(0, 3)


def parameters(patch: Patch, seed: int, n: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Random ones, with the domain's corners."""
    rng = np.random.default_rng(seed)
    u, v = (rng.uniform(*limits, n) for limits in patch.domain)
    (a, b), (c, d) = patch.domain
    u[:4], v[:4] = (a, a, b, b), (c, d, c, d)
    return u, v


def scipy_derivative(patch: Patch, coefficients: np.ndarray, u, v, du: int, dv: int) -> np.ndarray:
    """Of the tensor product with `coefficients` (n_u, n_v, d), by SciPy's univariate basis functions."""

    def basis(axis: int, t: np.ndarray, order: int) -> np.ndarray:
        n = patch.shape[axis]
        return BSpline(patch.knots[axis], np.eye(n), patch.degrees[axis])(t, order)

    return np.einsum("ki,kj,ijd->kd", basis(0, u, du), basis(1, v, dv), coefficients)


@quick
@given(patches(), orders, orders, st.integers(0, 99))
def test_derivatives_of_any_order_agree_with_scipy(patch, du, dv, seed):
    u, v = parameters(patch, seed)
    w = np.ones(patch.shape) if patch.weights is None else patch.weights
    homogeneous = np.dstack([patch.control_points * w[..., None], w])
    if patch.weights is None:
        wanted = scipy_derivative(patch, patch.control_points, u, v, du, dv)
        found = patch.derivative(u, v, du, dv)
    else:
        # Leibniz's rule forwards: the derivatives of point and weight give those of their product, which SciPy has.
        wanted = scipy_derivative(patch, homogeneous, u, v, du, dv)[:, :2]
        found = np.zeros_like(wanted)
        for i in range(du + 1):
            for j in range(dv + 1):
                weight = scipy_derivative(patch, homogeneous, u, v, du - i, dv - j)[:, 2:]
                found += comb(du, i) * comb(dv, j) * weight * patch.derivative(u, v, i, j)
    # What the products that cancel are as large as.
    terms = np.abs(homogeneous).max() + 1.0
    shortest = [np.diff(np.unique(k)).min() for k in patch.knots]
    scale = terms * (100 * patch.degrees[0] / shortest[0]) ** du * (100 * patch.degrees[1] / shortest[1]) ** dv
    np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-12 * scale)


@quick
@given(patches(), st.integers(0, 99))
def test_arrays_of_parameters_broadcast_to_the_bit(patch, seed):
    u, v = parameters(patch, seed)
    one_by_one = np.array([patch(a, b) for a, b in zip(u, v, strict=True)])
    assert np.array_equal(patch(u, v), one_by_one)
    assert np.array_equal(patch(u.reshape(4, 10), v.reshape(4, 10)), one_by_one.reshape(4, 10, 2))
    assert np.array_equal(patch(u[:, None], v), patch.grid(u, v))
    assert np.array_equal(patch(float(u[5]), v), patch.grid(u[5:6], v)[0])
    assert patch(u[0], v[0]).shape == (2,)
    assert patch(np.empty((0, 3)), v[0]).shape == (0, 3, 2)
    j = patch.jacobian(u, v[:7, None])
    assert j.shape == (7, 40, 2, 2)
    assert np.array_equal(j[..., 0], patch.derivative(u, v[:7, None], 1, 0))
    assert np.array_equal(j[..., 1], patch.derivative(u, v[:7, None], dv=1))


def test_rational_derivatives_of_an_exact_fraction():
    # x = u / (1 + u), y = v / (1 + u): weights 1 and 2 along u.
    patch = Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 1]], [[0.5, 0], [0.5, 0.5]]], [[1, 1], [2, 2]])
    u, v = Fraction(3, 8), Fraction(5, 16)
    factorial = 1
    for k in range(1, 7):
        factorial *= k
        # d^k/du^k of u / (1 + u) = 1 - 1 / (1 + u), and of v / (1 + u).
        power = Fraction((-1) ** k * factorial) / (1 + u) ** (k + 1)
        wanted = [float(-power), float(v * power)]
        np.testing.assert_allclose(patch.derivative(float(u), float(v), k), wanted, rtol=1e-13)
        np.testing.assert_allclose(patch.derivative(float(u), float(v), k, 1), [0, float(power)], rtol=1e-13)
    assert not patch.derivative(0.5, 0.5, 0, 2).any()


@quick
@given(curves(), orders)
def test_derivatives_of_curves_of_any_order(curve, order):
    t = np.random.default_rng(order).uniform(*curve.domain, (3, 11))
    assert np.array_equal(curve.derivative(t, order), curve(t, order))
    if curve.weights is None:
        assert np.array_equal(curve.derivative(t, order), curve.to_scipy()(t, nu=order))
        return
    h = BSpline(curve.knots, curve.homogeneous(), curve.degree)
    found = sum(comb(order, k) * h(t, order - k)[..., 2:] * curve(t, k) for k in range(order + 1))
    shortest = np.diff(np.unique(curve.knots)).min()
    scale = (np.abs(curve.homogeneous()).max() + 1) * (100 * curve.degree / shortest) ** order
    np.testing.assert_allclose(found, h(t, order)[..., :2], rtol=1e-11, atol=1e-12 * scale)


def test_the_third_derivative_of_a_circle_is_what_the_frenet_formulas_say():
    # Third derivative of a unit circle: by the Frenet formulas x''' = (v'' - v³) T + 3 v v' N, v the speed.
    c, t = circle(1.0), np.linspace(0.05, 0.95, 19)
    first, second, third = (c.derivative(t, k) for k in (1, 2, 3))
    speed = np.linalg.norm(first, axis=1)
    tangent = first / speed[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    rate = (second * tangent).sum(axis=1)
    np.testing.assert_allclose((third * normal).sum(axis=1), 3 * speed * rate, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("u", "v", "message"),
    [
        (-0.25, 2.5, r"patch: parameter u = -0.25 is outside the domain \[0.0, 1.0\]"),
        ([0.5, np.nextafter(1.0, 2.0)], 2.5, r"parameter u = 1.0000000000000002 is outside the domain \[0.0, 1.0\]"),
        (0.5, [[2.0], [3.5]], r"parameter v = 3.5 is outside the domain \[2.0, 3.0\]"),
        (float("nan"), 2.5, "parameter u = nan is outside"),
        ([0.1, 0.2], [2.1, 2.2, 2.3], "parameters u and v: shape mismatch"),
    ],
)
def test_parameters_outside_are_refused_by_value_and_domain(u, v, message):
    patch = Patch(([0, 0, 1, 1], [2, 2, 3, 3]), (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])
    for call in (patch, patch.derivative, patch.jacobian):
        with pytest.raises(InputError, match=message):
            call(u, v)


def test_curves_and_orders_are_refused_alike():
    curve = BSplineCurve([0, 0, 1, 1], 1, [[0, 0], [2, 1]])
    with pytest.raises(InputError, match=r"curve: parameter t = 1.5 is outside the domain \[0.0, 1.0\]"):
        curve([0.5, 1.5])
    with pytest.raises(InputError, match="order = -1: the order of a derivative"):
        curve.derivative(0.5, -1)
    patch = Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), np.zeros((2, 2, 2)))
    with pytest.raises(InputError, match="dv = -2: the order of a derivative"):
        patch.derivative(0.5, 0.5, 1, -2)
    with pytest.raises(InputError, match=r"parameter u = 1.5 is outside"):
        patch.grid([0.5, 1.5], [0.5])
