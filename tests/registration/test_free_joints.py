"""Joints that nothing fixes go to the only corner of the target on their sides."""

from __future__ import annotations

import numpy as np
import pytest

import models
import patchtransfer as pt
from patchtransfer import Boundary
from patchtransfer.geometry.outline import Outline
from patchtransfer.registration.free_joints import joints_to_corners
from shapes import loop


def roof(apex: float) -> tuple[pt.MultiPatch, Boundary]:
    """A strip of two patches, and a house whose roof's corner is not above the strip's middle joint."""
    mp = models.build(
        [models.bilinear((0, 0), (1, 0), (1, 1), (0, 1)), models.bilinear((1, 0), (2, 0), (2, 1), (1, 1))], 3, 2, None
    )
    return mp, loop([(0, 0), (2, 0), (2, 1), (apex, 1.3), (0, 1)])


@pytest.mark.parametrize("apex", [0.75, 0.9, 1.0, 1.2])
@pytest.mark.parametrize("sliding", [True, False])
def test_the_middle_joint_goes_to_the_roof(apex, sliding):
    mp, target = roof(apex)
    result = pt.transfer(mp, target, refine="never", fixed_correspondence=not sliding)
    joints = np.array([b for _, b in result.registration.joints])
    assert np.linalg.norm(joints - [apex, 1.3], axis=1).min() < 1e-9
    assert result.boundary_error < 1e-6
    assert not any("no joint" in warning for warning in result.warnings)


def test_landmarks_stay():
    mp, target = roof(0.8)
    landmarks = np.array([[1, 1, 1.0, 1.25], [0, 0, 0, 0], [2, 0, 2, 0], [2, 1, 2, 1], [0, 1, 0, 1]])
    result = pt.transfer(mp, target, landmarks, refine="never", on_failure="return")
    assert any("corner at (0.8, 1.3) that no joint" in warning for warning in result.warnings)


def moved(anchors, target, single=(False,) * 4):
    square = Outline(loop([(0, 0), (1, 0), (1, 1), (0, 1)]).loops[0])
    return joints_to_corners(np.array(anchors, float), square, target, np.empty(0), np.array(single))


def test_of_two_joints_the_nearer_one_and_of_two_corners_none():
    """Anchors by arc length, a square on polygons of the same length: joints at 0, 1, 2, 3."""
    anchors = [[0, 0], [4, 4]]
    one = Outline(loop([(0, 0), (1.2, 0), (1.2, 0.8), (0, 0.8)]).loops[0])
    found = moved(anchors, one)
    # Corners at 0, 1.2, 2 and 3.2: the second and fourth joint move.
    np.testing.assert_allclose(np.sort(found[:-1], axis=0)[:, 1], [0, 1.2, 3.2])
    far = Outline(loop([(0, 0), (1.5, 0), (1.5, 0.5), (0, 0.5)]).loops[0])
    np.testing.assert_array_equal(moved(anchors, far), anchors)


def test_one_patch_does_not_go_to_a_reentrant_corner():
    mp = models.build([models.bilinear((0, 0), (2, 0), (2, 1), (0, 1))], 3, 2, None)
    dent = loop([(0, 0), (2, 0), (2, 1), (1.9, 0.9), (0, 1)])
    result = pt.transfer(mp, dent, refine="never", on_failure="return")
    assert np.abs(np.array([b for _, b in result.registration.joints])[:, 0] - 1.9).min() > 0.05


def test_the_runner_up_is_taken_by_name():
    """A rectangle on a square turned by nothing: the runner-up turns it by 90 or 180 degrees."""
    mp = models.build([models.bilinear((0, 0), (1.2, 0), (1.2, 1), (0, 1))], 3, 2, None)
    target = loop([(0, 0), (1.2, 0), (1.2, 1), (0, 1)])
    best = pt.transfer(mp, target)
    other = pt.transfer(mp, target, correspondence="runner-up")
    wanted = best.registration.runner_up.landmarks
    found = {tuple(np.round(a, 6)): b for a, b in other.registration.joints}
    for row in wanted:
        key = tuple(np.round(row[:2], 6))
        if key in found:
            np.testing.assert_allclose(found[key], row[2:], atol=1e-6)
    assert not np.allclose([b for _, b in best.registration.joints], [b for _, b in other.registration.joints])
    assert other.certificate.injective


def test_no_runner_up_is_an_error():
    mp, target = roof(1.0)
    corners = np.array([[0, 0, 0, 0], [2, 0, 2, 0], [2, 1, 2, 1], [0, 1, 0, 1], [1, 1, 1, 1.3], [1, 0, 1, 0]], float)
    with pytest.raises(pt.InputError, match=r"runner-up.: there is none"):
        pt.transfer(mp, target, corners, correspondence="runner-up")
