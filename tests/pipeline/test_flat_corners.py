"""Corners of one patch that the target leaves nearly straight."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline

import models
import patchtransfer as pt


def flattened_square(theta: float, waves: list[float]) -> tuple[pt.Boundary, np.ndarray]:
    """A square with its corner (1, 1) moved until the boundary turns by `theta` degrees there, and wavy sides.

    The waves leave the tangents at the corners as they are.
    """
    ends = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    images = ends.copy()
    images[2] = 0.5 + np.tan(np.radians(theta) / 2) / 2
    t = np.linspace(0, 1, 41)[:, None]
    curves = []
    for i, wave in enumerate(waves):
        a, b = images[i], images[(i + 1) % 4]
        across = np.array([a[1] - b[1], b[0] - a[0]])
        points = a + t * (b - a) + wave * np.sin(np.pi * t) ** 2 * np.sin(3 * np.pi * t) * across
        curves.append(pt.BSplineCurve.from_scipy(make_interp_spline(t[:, 0], points, 3)))
    return pt.Boundary([curves]), np.hstack([ends, images])


@pytest.mark.parametrize(("degree", "spans"), [(2, 1), (2, 2), (3, 1), (3, 2)])
@given(
    theta=st.sampled_from([0.5, 1.0, 3.0, 6.0, 12.0, 25.0]),
    waves=st.lists(st.floats(-0.06, 0.06), min_size=4, max_size=4),
)
@example(theta=3.0, waves=[0.05, -0.05, 0.05, -0.05])
def test_corners_of_one_patch_that_are_nearly_straight_stay_below_180_degrees(degree, spans, theta, waves):
    """Legs strayed beyond what the corner is short of 180 degrees: the target had a map, the fit had none."""
    square = models.bilinear((0, 0), (1, 0), (1, 1), (0, 1))
    mp = models.build([square], degree, spans, None)
    target, landmarks = flattened_square(theta, waves)
    result = pt.transfer(mp, target, landmarks, "c0", on_failure="return")
    assert not result.fit_failed
    assert result.certificate.injective
