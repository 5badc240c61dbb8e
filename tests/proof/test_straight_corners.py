"""Corners where one patch fills a straight angle: what is written is not negative there, in exact arithmetic."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import models
import patchtransfer as pt
from patchtransfer.geometry.patch import Patch
from patchtransfer.geometry.straight_corners import Triangles, straighten
from patchtransfer.proof.source_corners import certify_straight
from shapes import circle

BEZIER = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
LINE = [0.0, 0.0, 1.0, 1.0]


def area(points, row) -> Fraction:
    (cx, cy), (ax, ay), (bx, by) = ([Fraction(x) for x in points[i].tolist()] for i in row)
    return (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)


@given(
    st.floats(0, 6.28),
    st.sampled_from([1e-200, 1e-6, 1.0, 1e6, 1e100]),
    st.sampled_from([0.0, 1.0, 1e3, 1e8]),
    st.floats(0.01, 100),
    st.sampled_from([1, -1]),
)
def test_points_in_line_end_on_the_right_side(angle, scale, offset, ratio, sense):
    along = np.array([math.cos(angle), math.sin(angle)])
    corner = offset * np.array([0.7, -0.4])
    points = scale * np.stack([corner, corner + along, corner - ratio * along])
    mended, moved = straighten(points, Triangles(np.array([[0, 1, 2]]), np.array([sense])))
    assert sense * area(mended, (0, 1, 2)) >= 0
    assert (mended[0] == points[0]).all()
    assert moved == np.abs(mended - points).max() <= 16 * np.spacing(np.abs(points).max())
    if sense * area(points, (0, 1, 2)) >= 0:
        assert mended is points


def test_what_is_bent_by_more_than_rounding_stays():
    points = np.array([[0.0, 0.0], [1.0, -1e-9], [-1.0, 0.0]])
    mended, moved = straighten(points, Triangles(np.array([[0, 1, 2]]), np.array([1])))
    assert mended is points
    assert moved == 0


def disc(angle, offset):
    """A biquadratic patch that is smooth at its four corners, which share their neighbours."""
    points = np.zeros((3, 3, 2))
    points[0, 0], points[2, 0], points[2, 2], points[0, 2] = [-1, -1], [1, -1], [1, 1], [-1, 1]
    points[1, 0], points[2, 1], points[1, 2], points[0, 1] = [0, -2], [2, 0], [0, 2], [-2, 0]
    c, s = math.cos(angle), math.sin(angle)
    return Patch((BEZIER, BEZIER), (2, 2), points @ np.array([[c, s], [-s, c]]) + offset)


@pytest.mark.parametrize("left_handed", [False, True])
@given(st.floats(0, 6.28), st.sampled_from([0.0, 10.0, 1e5]))
def test_models_negative_by_rounding_are_mended(left_handed, angle, offset):
    patch = disc(angle, offset)
    if left_handed:
        patch = patch.with_control_points(patch.control_points.transpose(1, 0, 2))
    mp = pt.MultiPatch([patch], ())
    before = pt.certify(mp)
    mended, after, notes = certify_straight(mp)
    assert after.status == "degenerate"
    assert after.lower_bound == 0
    assert bool(notes) == (before.status == "undecided")
    if notes:
        assert before.cells[0].within_rounding
        assert "negative within the rounding" in before.reasons[0]
        assert "straight corner" in notes[0]
    else:
        assert mended is mp


def test_a_source_negative_by_rounding_is_used_and_the_result_says_so():
    angle = next(
        a for a in np.linspace(0, 1, 50) if pt.certify(pt.MultiPatch([disc(a, 0.0)], ())).status == "undecided"
    )
    source = pt.MultiPatch([disc(angle, 0.0)], ()).elevate()
    certificate = pt.certify(source)
    result = pt.transfer(source, source.boundary(), continuity="c0")
    assert result.certificate.status == "degenerate"
    if certificate.status == "undecided":
        assert any("straight corner" in warning for warning in result.warnings)


@given(st.floats(0, 6.28))
def test_straight_corners_of_results_are_never_negative(angle):
    """The target is a circle: all four corners of the square come to lie on a smooth boundary."""
    square = models.build([models.bilinear((-1, -1), (1, -1), (1, 1), (-1, 1))], 3, 2, None)
    quarter = np.exp(1j * (angle + np.pi / 2 * np.arange(4)))
    images = np.column_stack([quarter.real, quarter.imag])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    result = pt.transfer(square, pt.Boundary([[circle()]]), np.hstack([corners, images]))
    assert result.certificate.status == "degenerate"
    patch = result.multipatch.patches[0].control_points
    for i, j in ((0, 0), (-1, 0), (0, -1), (-1, -1)):
        row = np.stack([patch[i, j], patch[1 if i == 0 else -2, j], patch[i, 1 if j == 0 else -2]])
        assert area(row, (0, 1, 2)) * (1 if i == j else -1) >= 0


@pytest.mark.parametrize("offset", [0.0, 1e6, 1e8, 1e13])
def test_a_dent_below_rounding_is_not_called_injective(offset):
    for dent in 10.0 ** np.arange(-16, -1, 0.25):
        points = np.array([[[0.5 + dent, 0.5 + dent], [0, 1]], [[1, 0], [1, 1]]]) + offset
        c = pt.certify(pt.MultiPatch([Patch((LINE, LINE), (1, 1), points)], ()))
        row = np.stack([points[0, 0], points[1, 0], points[0, 1]])
        assert not (c.injective and area(row, (0, 1, 2)) < 0)
        assert c.status in ("certified", "degenerate", "undecided", "folded")
