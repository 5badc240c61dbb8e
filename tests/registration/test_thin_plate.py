"""The bending energy against SciPy's smoothing spline, and sliding along the boundary by it."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

import models
import targets
from patchtransfer.geometry.outline import Outline
from patchtransfer.registration.inner_distances import slide, sliding
from patchtransfer.registration.sampled_boundary import BoundaryShape, image_of
from patchtransfer.registration.thin_plate import bending_matrix, plate


def cloud(n, seed=1):
    p = np.random.default_rng(seed).uniform(-1, 1, (n, 2))
    p -= p.mean(axis=0)
    return p / np.sqrt((p**2).sum(axis=1).mean())


@pytest.mark.parametrize("slack", [1e-6, 1e-3])
def test_the_plate_is_scipys_smoothing_spline(slack):
    p = cloud(40)
    y = np.sin(3 * p[:, 0]) * p[:, 1]
    plate = RBFInterpolator(p, y, kernel="thin_plate_spline", smoothing=8 * np.pi * slack)(p)
    np.testing.assert_allclose(y - slack * bending_matrix(7 * p + 3, slack) @ y, plate, atol=1e-9)


def test_affine_maps_cost_nothing_and_all_others_something():
    p = cloud(30)
    matrix = bending_matrix(p)
    np.testing.assert_allclose(matrix @ np.column_stack([np.ones(30), p]), 0, atol=1e-9)
    values = np.linalg.eigvalsh(matrix)
    assert (abs(values[:3]) < 1e-9).all()
    assert values[3] > 1e-3


@pytest.fixture(scope="module")
def stretched():
    """Shapes of a plate with a hole and its image under a quadratic map; true arc lengths of the source's nodes."""
    mp = models.plate_with_hole()

    def f(x):
        return x + 0.2 * x * x[:, ::-1] + 0.1 * x**2

    target, _ = targets.deformed(mp, f, reverse=False)
    outlines = [Outline(loop) for loop in mp.boundary().loops]
    images = sorted((Outline(loop) for loop in target.loops), key=lambda outline: -abs(outline.area))
    source, other = BoundaryShape.sample(outlines), BoundaryShape.sample(images)
    truth = []
    for outline, image, s in zip(outlines, images, source.s, strict=True):
        y = image.nearest(f(outline.point(s)))[0]
        truth.append(np.unwrap(y, period=image.length))
    return source, other, truth


def test_gradient_and_matrix_are_derivatives(stretched):
    source, target, truth = stretched
    without, bent = sliding(source, target, [0, 1]), sliding(source, target, [0, 1], 0.7)

    def bending(y):
        return [b - a for a, b in zip(without.model(y), bent.model(y), strict=True)]

    y, h = np.concatenate(truth) + 0.01, 1e-5
    _, gradient, hessian = bending(y)
    for i in (5, 40, len(truth[0]) + 3):
        e = h * np.eye(len(y))[i]
        slope = (bending(y + e)[0] - bending(y - e)[0]) / (2 * h)
        assert slope == pytest.approx(gradient[i], rel=1e-4, abs=1e-9)
    # Forces along the boundary are linear in the points there, as far as tangents do not turn.
    matrix, _, size, _ = plate(source, target, [0, 1], 0.7)
    tangents = [o.tangent(x) for o, x in zip(target.outlines, np.split(y, [len(truth[0])]), strict=True)]
    t = np.concatenate(tangents) / size
    np.testing.assert_allclose(hessian, 2 * 0.7 * matrix * (t @ t.T), atol=1e-9 * abs(hessian).max())


def test_sliding_by_bending_is_nearer_to_a_smooth_map_than_by_distances(stretched):
    source, target, truth = stretched
    lengths = [outline.length for outline in target.outlines]
    anchors, keep = [], []
    for outline, s, y, length, turn in zip(source.outlines, source.s, truth, lengths, source.turn, strict=True):
        z = y + np.where(turn == 0, 0.004 * length * np.sin(0.5 * np.arange(len(y))), 0.0)
        anchors.append(np.column_stack([np.append(s, s[0] + outline.length), np.append(z, z[0] + length)]))
        keep.append(s[turn != 0])
    error = []
    for bending in (0.0, 0.01):
        start = slide(source, target, [0, 1], anchors, source.s, bending)[1]
        found, energy = slide(source, target, [0, 1], anchors, keep, bending)
        assert energy < start
        off = [abs(image_of(a, s) - y) / lengths[0] for a, s, y in zip(found, source.s, truth, strict=True)]
        np.testing.assert_allclose(off[0][source.turn[0] != 0], 0, atol=1e-12)
        error.append(np.concatenate(off).mean())
    assert error[1] < 0.7 * error[0]
    assert error[1] < 4e-3
