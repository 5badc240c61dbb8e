"""Outlines: arc length against quadrature, nearest points against dense sampling, corners."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

import models
from patchtransfer import BSplineCurve
from patchtransfer.geometry.outline import Outline, hausdorff
from shapes import circle, polygon
from strategies import boundaries


def length(curve: BSplineCurve, a: float, b: float) -> float:
    breaks = [a, *(k for k in np.unique(curve.knots) if a < k < b), b]
    return sum(
        quad(lambda t: float(np.hypot(*curve(t, 1))), x, y, epsabs=1e-11, epsrel=1e-11)[0]
        for x, y in itertools.pairwise(breaks)
    )


@pytest.mark.parametrize("name", ["plate with hole p2", "o-grid p3", "l-shape p3"])
def test_arc_length_agrees_with_quadrature(name):
    for loop in models.ALL[name]().boundary().loops:
        outline = Outline(loop)
        each = np.array([length(c, *c.domain) for c in loop])
        np.testing.assert_allclose(outline.joints, np.concatenate([[0], np.cumsum(each)]), atol=1e-8 * each.sum())
        assert outline.length == outline.joints[-1]
        curve = loop[1]
        for t in (0.21, 0.5, 0.83):
            s = outline.arc_length(1, np.array([t]))[0]
            assert s - outline.joints[1] == pytest.approx(length(curve, 0, t), abs=1e-4 * outline.length)
            # Exactly on the curve, near the parameter.
            assert np.linalg.norm(outline.point(s) - curve(t)) < 1e-4 * outline.length


@settings(max_examples=20, deadline=None)
@given(boundaries())
def test_joints_lie_where_curves_meet_and_the_area_changes_sign(boundary):
    for loop in boundary.loops:
        outline = Outline(loop)
        np.testing.assert_allclose(outline.point(outline.joints[:-1]), [c.start for c in loop], atol=1e-12)
        np.testing.assert_allclose(outline.point(outline.length), loop[0].start, atol=1e-12)
        back = Outline([c.reversed() for c in reversed(loop)])
        assert back.length == pytest.approx(outline.length, rel=1e-12)
        assert back.area == pytest.approx(-outline.area, rel=1e-9)
        assert outline.area > 0
        s = np.linspace(0, outline.length, 37)
        # Unit tangents are the chords' limit.
        step = 1e-6 * outline.length
        inner = s[
            np.abs(s[:, None] - np.append(outline.piece_breaks, outline.length)).min(axis=1) > 1e-3 * outline.length
        ]
        chord = outline.point(inner + step) - outline.point(inner - step)
        chord /= np.linalg.norm(chord, axis=1)[:, None]
        assert np.linalg.norm(outline.tangent(inner) - chord, axis=1).max(initial=0.0) < 1e-2


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(["plate with hole p2", "o-grid p3", "l-shape p2", "annulus p3"]))
def test_nearest_beats_dense_sampling(seed, name):
    rng, count = np.random.default_rng(seed), 8
    for loop in models.ALL[name]().boundary().loops:
        outline = Outline(loop)
        s = rng.uniform(0, outline.length, count)
        points = outline.point(s) + 0.01 * outline.length * rng.uniform(-1, 1, (count, 2))
        found, distance = outline.nearest(points)
        np.testing.assert_allclose(np.linalg.norm(outline.point(found) - points, axis=1), distance, atol=1e-12)
        dense = np.concatenate([c(np.linspace(*c.domain, 4001)) for c in loop])
        best = np.linalg.norm(points[:, None] - dense, axis=2).min(axis=1)
        assert (distance <= best + 1e-6 * outline.length).all()
        on, zero = outline.nearest(outline.point(s))
        assert zero.max() < 1e-8 * outline.length
        wrapped = np.abs(on - s)
        assert np.minimum(wrapped, outline.length - wrapped).max() < 1e-6 * outline.length


def test_nearest_knows_corners():
    outline = Outline(polygon([[0, 0], [2, 0], [2, 1], [0, 1]]))
    s, distance = outline.nearest(np.array([[2.5, -0.5], [2.5, 1.5], [1.0, 0.2], [-1.0, -1.0]]))
    np.testing.assert_allclose(distance, [0.5**0.5, 0.5**0.5, 0.2, 2**0.5], atol=1e-12)
    np.testing.assert_allclose(s[:3], [2, 3, 1], atol=1e-9)
    assert min(s[3], outline.length - s[3]) < 1e-9


def test_corners_turn_by_their_exterior_angle():
    corners = [[0, 0], [4, 0], [4, 2], [2, 1], [0, 2]]
    outline = Outline(polygon(corners))
    edges = np.roll(corners, -1, 0) - np.array(corners)
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    expected = (heading - np.roll(heading, 1) + np.pi) % (2 * np.pi) - np.pi
    turn = outline.turn(outline.joints[:-1])
    np.testing.assert_allclose(turn, expected, atol=1e-12)
    assert turn.sum() == pytest.approx(2 * np.pi)
    assert turn[3] < 0
    np.testing.assert_allclose(outline.turn(np.array([1.0, 5.0])), 0, atol=1e-12)
    np.testing.assert_allclose(outline.tangent(outline.joints[1], from_left=True), [1, 0], atol=1e-15)
    np.testing.assert_allclose(outline.tangent(outline.joints[1]), [0, 1], atol=1e-15)


def test_nurbs_circle():
    outline = Outline([circle(3.0)])
    assert outline.length == pytest.approx(6 * np.pi, rel=1e-8)
    assert outline.area == pytest.approx(9 * np.pi, rel=1e-2)
    s = np.linspace(0, outline.length, 50)
    np.testing.assert_allclose(np.linalg.norm(outline.point(s), axis=1), 3, rtol=1e-14)
    angle = np.unwrap(np.arctan2(*outline.point(s)[:-1].T[::-1]))
    np.testing.assert_allclose(angle, s[:-1] / 3, atol=1e-3)
    np.testing.assert_allclose(outline.turn(outline.piece_breaks), 0, atol=1e-7)
    _, distance = outline.nearest(np.array([[1.0, 1.0], [0.0, 4.0]]))
    np.testing.assert_allclose(distance, [3 - 2**0.5, 1], atol=1e-12)


def test_coinciding_end_control_points_have_a_tangent():
    slow = BSplineCurve([0, 0, 0, 1, 1, 1], 2, [[0, 0], [0, 0], [1, 0]])
    rest = polygon([[1, 0], [1, 1], [0, 0]])[:2]
    outline = Outline([slow, *rest])
    np.testing.assert_allclose(outline.tangent(0.0), [1, 0], atol=1e-9)
    assert outline.length == pytest.approx(2 + 2**0.5, rel=1e-9)


def test_hausdorff_of_circles_and_of_a_spike():
    assert hausdorff(Outline([circle(1.0)]), Outline([circle(1.25).reversed()])) == pytest.approx(0.25, abs=1e-12)
    square = polygon([[0, 0], [1, 0], [1, 1], [0, 1]])
    spike = polygon([[0, 0], [1, 0], [1, 1], [0.5, 1.4], [0, 1]])
    # Two-sided: from the square alone the distance is smaller.
    assert hausdorff(Outline(square), Outline(spike)) == pytest.approx(0.4, abs=1e-9)
