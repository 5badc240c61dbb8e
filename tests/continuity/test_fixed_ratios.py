"""Rows with the source's ratios and frames are the same for all targets, so that blends of results keep them."""

from __future__ import annotations

import numpy as np
import pytest

import models
import patchtransfer as pt
import smoothness
import targets
from patchtransfer import examples
from patchtransfer.errors import InputError


def residual(result: pt.TransferResult, points: np.ndarray) -> float:
    return float(np.abs(result.rows.space.rows.matrix @ points).max() / np.linalg.norm(np.ptp(points, axis=0)))


@pytest.mark.parametrize("name", models.ALL)
@pytest.mark.parametrize("angle", [20, 60])
def test_morphs_keep_the_rows_of_both_ends(name, angle):
    source = models.ALL[name]()
    plan = pt.TransferPlan(source, ratios="source")
    ends = [plan.transfer(*targets.deformed(source, targets.bend(source, a)), on_failure="return") for a in (10, angle)]
    assert all(end.certificate.injective for end in ends)
    frames = pt.morph(*(end.multipatch for end in ends), 5, on_failure="return")
    x = [frame.multipatch.topology.coordinates for frame in frames.frames]
    released = [{interface for interface, _ in end.rows.released} for end in ends]
    same = released[0] == released[1] and ends[0].rows.active == ends[1].rows.active
    for frame, points in zip(frames.frames, x, strict=True):
        if same and frame.way in ("given", "interpolated"):
            assert max(residual(end, points) for end in ends) < 1e-12
    if same:
        # One null space for the family.
        assert max(residual(ends[0], points) for points in (x[0], x[-1], (x[0] + x[-1]) / 2)) < 1e-12
    # Each end's own rows hold in any case.
    assert max(residual(end, end.multipatch.topology.coordinates) for end in ends) < 1e-12


def test_frames_in_the_middle_are_as_smooth_as_the_ends():
    source, target, landmarks = examples.load("human")
    other = targets.deformed(source, targets.bend(source, 30))
    shares = {}
    for ratios in ("source", "target"):
        plan = pt.TransferPlan(source, ratios=ratios)
        ends = [plan.transfer(target, landmarks).multipatch, plan.transfer(*other).multipatch]
        frames = pt.morph(*ends, 5)
        assert {frame.way for frame in frames.frames[1:-1]} == {"interpolated"}
        shares[ratios] = [smoothness.share(smoothness.spans(mp)) for mp in frames]
    assert min(shares["source"]) > 0.4
    assert max(shares["target"][1:-1]) < 0.1


def test_the_option_and_the_plan_are_the_same():
    source, target, landmarks = examples.load("wrench")
    ways = [
        pt.transfer(source, target, landmarks, ratios="source"),
        pt.TransferPlan(source, ratios="source").transfer(target, landmarks),
        pt.TransferPlan(source).transfer(target, landmarks, ratios="source"),
        pt.TransferPlan(source, ratios="source").transfer(target, landmarks, ratios="target"),
        pt.transfer(source, target, landmarks),
    ]
    first, second, third, fourth, fifth = (r.multipatch.topology.coordinates for r in ways)
    assert np.array_equal(first, second)
    assert np.array_equal(first, third)
    assert np.array_equal(fourth, fifth)
    assert not np.array_equal(first, fourth)
    assert ways[0].quality.scaled_jacobian.mean > ways[4].quality.scaled_jacobian.mean - 0.01


def test_ratios_that_are_none():
    mp = models.grid(2, 2, 3, 2)
    for make in (lambda: pt.TransferPlan(mp, ratios="mean"), lambda: pt.transfer(mp, mp.boundary(), ratios="mean")):
        with pytest.raises(InputError, match="ratios must be one of target, source"):
            make()
    with pytest.raises(InputError, match="c1"):
        pt.TransferPlan(models.with_freedom(mp), "g1", ratios="source")
