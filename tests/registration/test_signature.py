"""Signatures tell domains apart without a correspondence, whatever their place, size, sense and start."""

import numpy as np
import pytest

import models
import patchtransfer as pt
import targets
from patchtransfer.geometry.outline import Outline
from patchtransfer.registration.register import target_outlines
from patchtransfer.registration.signature import SHAPE, signature


def of(model: pt.MultiPatch):
    return signature([Outline(loop) for loop in model.boundary().loops])


@pytest.mark.parametrize("model", [models.grid(3, 1), models.plate_with_hole()])
def test_motions_and_sizes_change_nothing(model):
    moved, _ = targets.deformed(model, targets.similarity(70, 3.0))
    own, other = of(model), signature(target_outlines(moved))
    assert own.loops == other.loops == len(model.loops)
    assert own.values.shape == SHAPE
    # Points start elsewhere on the loops, and curves of the target are fitted.
    assert own.distance(other) < 0.01
    assert own.distance(own) == 0


def test_the_plane_mirrored_has_the_same():
    model = models.plate_with_hole()
    image = pt.MultiPatch(
        [patch.with_control_points(patch.control_points * [-1, 1]) for patch in model.patches], model.interfaces
    )
    assert of(model).distance(of(image)) < 0.01


def test_a_bend_changes_less_than_another_shape():
    bar, square = models.grid(1, 6), models.grid(1, 1)
    bent, _ = targets.deformed(bar, targets.bend(bar, 60))
    found = signature(target_outlines(bent))
    assert found.distance(of(bar)) < 0.3 * found.distance(of(square))


def test_quantiles_are_those_of_numpy():
    from patchtransfer.registration.signature import OF_POINT, _quantiles

    rows = np.random.default_rng(3).uniform(size=(7, 23))
    assert np.allclose(_quantiles(rows, OF_POINT), np.quantile(rows, OF_POINT, axis=1).T, atol=1e-15)


def test_other_numbers_of_loops_are_infinitely_far():
    assert of(models.grid(1, 1)).distance(of(models.plate_with_hole())) == np.inf
