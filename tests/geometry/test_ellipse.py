"""Ellipses that curves lie on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import conics
from patchtransfer import BSplineCurve
from patchtransfer.geometry.ellipse import Ellipse, turned


@given(st.floats(0.5, 2.5), st.floats(0.05, 20), st.floats(0, 7), st.floats(-5, 5), st.floats(-3, 3))
def test_affine_images_of_arcs_are_on_theirs(angle, ratio, turn, x, y):
    arc = conics.arc(angle, turn / 3)
    points = turned(arc.control_points * [ratio, 1.0], turn) + np.array([x, y])
    found = Ellipse.through([arc.with_control_points(points)])
    if found is None:
        # Short arcs of long ellipses leave too much open.
        assert angle < 1.5 or not 0.2 < ratio < 5
        return
    np.testing.assert_allclose(found.centre, [x, y], atol=1e-6 * max(ratio, 1))
    on = found.from_circle(np.column_stack([np.cos([0.3, 2.0]), np.sin([0.3, 2.0])]))
    np.testing.assert_allclose(found.angles(on), [0.3, 2.0], atol=1e-12)
    np.testing.assert_allclose(found.from_circle(found.to_circle(points)), points, atol=1e-9 * max(ratio, 1))


@pytest.mark.parametrize(
    "curve",
    [
        BSplineCurve([0, 0, 0, 1, 1, 1], 2, [[0, 0], [1, 1], [2, 0]]),
        BSplineCurve([0, 0, 1, 1], 1, [[0, 0], [2, 0]]),
        conics.conic([0, 0], [1, 1], [2, 0], 1.5),
        BSplineCurve([0, 0, 0, 0, 1, 1, 1, 1], 3, [[0, 0], [1, 2], [2, -1], [3, 0]]),
    ],
    ids=["parabola", "line", "hyperbola", "cubic"],
)
def test_other_curves_are_on_none(curve):
    assert Ellipse.through([curve]) is None


def test_arcs_of_two_circles_are_on_none():
    arc = conics.arc(2.0)
    assert Ellipse.through([arc, arc.with_control_points(arc.control_points * 1.001)]) is None
