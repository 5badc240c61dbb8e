"""Points of outlines moved by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import strategies
from patchtransfer import Boundary, BSplineCurve, InputError
from patchtransfer.editor.editing import PointAddress, addresses, control_points, moved, pulled

places = st.tuples(st.floats(-3, 3), st.floats(-3, 3))


def circle():
    """Four cubics, smooth at their joints."""
    k = 0.5522847498
    quarter = np.array([[1, 0], [1, k], [k, 1], [0, 1]])
    turn = np.array([[0, 1], [-1, 0]])
    quarters = [quarter @ np.linalg.matrix_power(turn, n) for n in range(4)]
    return Boundary([[BSplineCurve([0, 0, 0, 0, 1, 1, 1, 1], 3, points) for points in quarters]])


@settings(max_examples=40, deadline=None)
@given(strategies.boundaries(), st.integers(0, 10**6), places)
def test_the_point_is_there_and_the_loop_closed(boundary, number, to):
    at = addresses(boundary)[number % len(addresses(boundary))]
    after = moved(boundary, at, to)
    np.testing.assert_array_equal(after.loops[at.loop][at.curve].control_points[at.point], to)
    for before, loop in zip(boundary.loops, after.loops, strict=True):
        for i, curve in enumerate(loop):
            np.testing.assert_array_equal(curve.knots, before[i].knots)
            gap = curve.control_points[-1] - loop[(i + 1) % len(loop)].control_points[0]
            assert np.abs(gap).max() <= 1e-6 * boundary.diameter
    changed = (control_points(boundary) != control_points(after)).any(axis=1)
    # The point, its double, and legs beside it.
    assert changed.sum() <= 4
    for k, (a, b) in enumerate(zip(boundary.loops, after.loops, strict=True)):
        if k != at.loop:
            assert a == b


@given(st.integers(0, 11), places)
def test_smooth_joints_stay_smooth(number, to):
    before = circle()
    after = moved(before, addresses(before)[number], to)
    loop = after.loops[0]
    for k in range(4):
        into = loop[k].control_points[-1] - loop[k].control_points[-2]
        out = loop[(k + 1) % 4].control_points[1] - loop[(k + 1) % 4].control_points[0]
        cross = into[0] * out[1] - into[1] * out[0]
        assert abs(cross) <= 1e-9 * max(np.hypot(*into) * np.hypot(*out), 1e-30) + 1e-12


def test_corners_stay_corners_and_lines_lines():
    square = Boundary.from_points([(0, 0), (1, 0), (1, 1), (0, 1)])
    after = moved(square, PointAddress(0, 1, 0), (2, -1))
    np.testing.assert_array_equal([c.start for c in after.loops[0]], [(0, 0), (2, -1), (1, 1), (0, 1)])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 11), st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)), st.floats(0.01, 0.5))
def test_what_is_pulled_is_there_smooth_and_still_beyond_the_reach(number, shift, reach):
    before = circle()
    at = addresses(before)[number]
    to = before.loops[0][at.curve].control_points[at.point] + shift
    after = pulled(before, at, tuple(to), reach)
    np.testing.assert_allclose(after.loops[0][at.curve].control_points[at.point], to, atol=1e-12)
    loop = after.loops[0]
    for k in range(4):
        into = loop[k].control_points[-1] - loop[k].control_points[-2]
        out = loop[(k + 1) % 4].control_points[1] - loop[(k + 1) % 4].control_points[0]
        # The circle's own joints are straight to the digits of its legs.
        assert abs(into[0] * out[1] - into[1] * out[0]) <= 1e-9
    moved_joints = [not np.allclose(a.start, b.start, atol=1e-12) for a, b in zip(before.loops[0], loop, strict=True)]
    if reach < 0.12:
        assert sum(moved_joints) <= 1


@settings(max_examples=40, deadline=None)
@given(strategies.boundaries(), st.integers(0, 10**6), places, st.floats(0.01, 0.5))
def test_what_is_pulled_stays_closed(boundary, number, shift, reach):
    at = addresses(boundary)[number % len(addresses(boundary))]
    to = boundary.loops[at.loop][at.curve].control_points[at.point] + np.array(shift)
    # A boundary that is open is refused when it is made.
    after = pulled(boundary, at, tuple(to), reach)
    assert [len(loop) for loop in after.loops] == [len(loop) for loop in boundary.loops]


def test_lines_that_go_on_straight_stay_joined():
    """The leg of a line is its other end."""
    square = Boundary.from_points([(0, 0), (1, 0), (2, 0), (3, 0), (3, 3), (0, 3)], smooth=False, clean=False)
    after = pulled(square, PointAddress(0, 2, 0), (2, -0.5), 0.3)
    np.testing.assert_allclose(after.loops[0][1].end, (2, -0.5))
    np.testing.assert_array_equal(after.loops[0][1].end, after.loops[0][2].start)


def test_a_pull_without_reach_is_a_move():
    assert pulled(circle(), PointAddress(0, 1, 1), (1, 1), 0.0) == moved(circle(), PointAddress(0, 1, 1), (1, 1))


@pytest.mark.parametrize("at", [(1, 0, 0), (0, 4, 0), (0, 0, 3), (0, 0, -1)])
def test_points_that_are_not_there(at):
    with pytest.raises(InputError, match="no control point"):
        moved(circle(), PointAddress(*at), (0, 0))
