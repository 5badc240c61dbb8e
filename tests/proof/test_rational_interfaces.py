"""Interfaces of rational patches whose numbers differ by rounding, by a factor, or really."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patchtransfer import Interface, MultiPatch, Patch, Side, certify

KNOTS = [0, 0, 0, 1, 1, 1]


def ring(radius: float, weights: bool = True) -> Patch:
    """A quarter of a ring, u along the arc; its south side has `radius`, its north side one more."""
    arc = np.array([[1, 0], [1, 1], [0, 1]])
    points = np.stack([radius * arc, (radius + 1) * arc], axis=1)
    w = np.repeat([[1.0], [np.sqrt(0.5)], [1.0]], 2, axis=1)
    return Patch((KNOTS, [0, 0, 1, 1]), (2, 1), points, w if weights else None)


def pair(change=lambda points, weights: None, scale: float = 1.0) -> MultiPatch:
    """Two rings; the outer one's numbers on the common side are changed."""
    inner, outer = ring(1.0), ring(2.0)
    points, weights = outer.control_points.copy(), outer.weights * scale
    change(points, weights)
    outer = Patch(outer.knots, outer.degrees, points, weights)
    return MultiPatch([inner, outer], [Interface(0, Side.NORTH, 1, Side.SOUTH, False)])


def up(array, at, ulps=1):
    for _ in range(ulps):
        array[at] = np.nextafter(array[at], np.inf)


@pytest.mark.parametrize("ulps", [1, 4])
def test_points_that_differ_by_rounding_are_proved_for_their_mean(ulps):
    certificate = certify(pair(lambda points, weights: up(points, (1, 0, 0), ulps)))
    assert certificate.status == "certified", certificate.reasons
    assert "the two sides differ by rounding" in certificate.notes[0]


@pytest.mark.parametrize("ulps", [1, 4])
def test_weights_that_differ_by_rounding_are_proved_for_their_mean(ulps):
    certificate = certify(pair(lambda points, weights: up(weights, (1, 0), ulps)))
    assert certificate.status == "certified", certificate.reasons
    assert "the weights of the two sides differ by rounding" in certificate.notes[0]


def test_weights_that_differ_are_not_one_curve():
    def wrong(points, weights):
        weights[1, 0] *= 1 + 1e-12

    certificate = certify(pair(wrong))
    assert certificate.status == "undecided"
    assert "weights of the two sides differ by 1e-12" in certificate.reasons[0]


@settings(max_examples=20, deadline=None)
@given(st.integers(-30, 30))
def test_weights_up_to_a_factor_are_one_curve(exponent):
    assert certify(pair(scale=2.0**exponent)).status == "certified"


def test_a_factor_that_rounds_is_not_taken_for_one():
    # 0.1 times the weights is not the same ratio to the bit, and a mean of 1 and 0.1 would be another model.
    mp = pair(lambda points, weights: up(weights, (1, 0)), scale=0.5)
    certificate = certify(mp)
    assert certificate.status == "undecided"
    assert "weights of the two sides differ" in certificate.reasons[0]


def half(rational: bool, weight: float) -> Patch:
    """The unit square right of x = 1, its weights 1 or `weight` on the side there and another inside."""
    nodes = np.linspace(0, 1, 3)
    points = np.stack(np.meshgrid(1 + nodes, nodes, indexing="ij"), axis=2)
    w = np.full((3, 3), weight)
    w[1, 1] = 1.5
    return Patch((KNOTS, KNOTS), (2, 2), points, w if rational else None)


@pytest.mark.parametrize("weight", [1.0, 0.5, 0.3, np.nextafter(1.0, 0)])
def test_a_rational_side_with_equal_weights_fits_a_polynomial_one(weight):
    left = half(False, 1.0)
    left = left.with_control_points(left.control_points - [1, 0])
    certificate = certify(MultiPatch([left, half(True, weight)]))
    assert certificate.status == "certified", certificate.reasons


def test_a_rational_side_with_other_weights_does_not_fit_a_polynomial_one():
    left, right = half(False, 1.0), half(True, 1.0)
    left = left.with_control_points(left.control_points - [1, 0])
    weights = right.weights.copy()
    weights[0, 1] = 1.2
    certificate = certify(MultiPatch([left, Patch(right.knots, right.degrees, right.control_points, weights)]))
    assert certificate.status == "undecided"
    assert "weights of the two sides differ" in certificate.reasons[0]


def test_patches_with_equal_weights_are_polynomial_in_a_model():
    square = half(False, 1.0)
    weighted = Patch(square.knots, square.degrees, square.control_points, np.full((3, 3), 0.7))
    mp = MultiPatch([weighted])
    assert not mp.is_rational
    assert mp == MultiPatch([square])
