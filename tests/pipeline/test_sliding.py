"""Joints that slide along the target to lower the distortion."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import models
import patchtransfer as pt
import shapes
import targets
from patchtransfer import InputError
from patchtransfer.geometry.outline import Outline
from patchtransfer.interior.solver import InteriorSolver
from patchtransfer.pipeline import inside
from patchtransfer.pipeline.inside import slide
from patchtransfer.pipeline.options import MISSED, Options, Run
from patchtransfer.pipeline.posed import Registered
from patchtransfer.pipeline.sliding import _modes, movable_joints
from patchtransfer.pipeline.source_boundary import SourceBoundary
from patchtransfer.progress import Budget, Clock
from patchtransfer.registration.register import register

CASES = {
    "annulus, swirl": (lambda: models.annulus(6, 3, 2), lambda mp: targets.swirl(mp, (0.3, 0.5), 40, 0.4)),
    "o-grid, bump": (lambda: models.o_grid(3, 3), lambda mp: targets.bump(mp, (0.9, 0.6), (0.3, 0.1), 0.3)),
    "star, bend": (lambda: models.star(5, 3, 2), lambda mp: targets.bend(mp, 70)),
    "plate, articulation": (lambda: models.plate_with_hole(3, 2), lambda mp: targets.articulation(mp, 30, blend=0.9)),
}


@pytest.mark.parametrize("name", CASES)
def test_sliding_lowers_the_energy_and_keeps_the_fit(name):
    make, deformation = CASES[name]
    mp = make()
    target, _ = targets.deformed(mp, deformation(mp), seed=2)
    plan = pt.TransferPlan(mp)
    fixed = plan.transfer(target, fixed_correspondence=True)
    slid = plan.transfer(target)
    before, after = slid.sliding.energies[0], slid.sliding.energies[-1]
    assert 2.6 - 1e-9 <= after <= before
    assert slid.certificate.injective
    assert slid.boundary_error <= max(1e-3, 1.2 * fixed.boundary_error) * (1 + 1e-9)
    assert slid.quality.condition_number.mean <= fixed.quality.condition_number.mean * 1.01
    if name == "annulus, swirl":
        # Both boundaries are smooth all around: there is room to slide, and it pays.
        assert after - 2.6 < 0.95 * (before - 2.6)


def test_joints_shifted_along_the_loop_slide_back():
    """The target is the source's own boundary, matched with an error: the identity has the least energy."""
    mp = models.annulus(6, 3, 3)
    target = mp.boundary()
    outlines = [Outline(loop) for loop in target.loops]
    rng = np.random.default_rng(5)
    rows = []
    for outline in outlines:
        s = outline.joints[:-1] + 0.1 * np.diff(outline.joints).min() * rng.uniform(-1, 1, len(outline.joints) - 1)
        rows.append(np.column_stack([outline.point(outline.joints[:-1]), outline.point(s)]))
    wrong = register(target.loops, target, np.concatenate(rows))
    boundary, run = SourceBoundary(target.loops, mp.topology), Run(Options(), Clock(), Budget())
    posed = boundary.pose(Registered(wrong, None), boundary.fit(wrong, run), run)
    _, sliding = slide(posed, [np.ones(6, bool)] * 2, boundary, InteriorSolver(mp, "c1"), run)
    before, after = sliding.energies[0], sliding.energies[-1]
    assert after - 2.6 < 0.1 * (before - 2.6)


def test_corners_and_landmarks_stay():
    mp = models.plate_with_hole(3, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30), seed=1)
    registration = register(mp.boundary().loops, target, landmarks)
    outer, hole = movable_joints(registration, None)
    assert outer.tolist().count(False) == 4
    assert hole.all()
    assert not any(mask.any() for mask in movable_joints(registration, landmarks))
    hole_rows = [row for row in landmarks if np.linalg.norm(row[:2]) < 0.5]
    outer, hole = movable_joints(registration, hole_rows[:3])
    assert hole.sum() == 5
    assert outer.sum() == 4


def test_landmarks_fix_the_correspondence_unless_told_otherwise():
    mp = models.annulus(6, 3, 2)
    f = targets.swirl(mp, (0.3, 0.5), 40, 0.4)
    target, landmarks = targets.deformed(mp, f, seed=2)
    fixed = pt.transfer(mp, target, landmarks)
    assert not any("slid" in line for line in fixed.log)
    for a, b in fixed.registration.joints:
        np.testing.assert_allclose(b, f(a[None])[0], atol=1e-6 * target.diameter)
    some = landmarks[::4]
    slid = pt.transfer(mp, target, some, fixed_correspondence=False)
    before, after = slid.sliding.energies[0], slid.sliding.energies[-1]
    assert after < before
    for row in some:
        image = min(slid.registration.joints, key=lambda pair: np.linalg.norm(pair[0] - row[:2]))[1]
        np.testing.assert_allclose(image, row[2:], atol=1e-6 * target.diameter)


def test_the_paper_method_does_not_slide():
    mp = models.annulus(6, 3, 2)
    target = mp.boundary()
    assert not any("slid" in line for line in pt.transfer(mp, target, method="paper").log)
    with pytest.raises(InputError, match="slide"):
        pt.transfer(mp, target, method="paper", fixed_correspondence=False)


@pytest.mark.parametrize("count", [5, 96, 97, 500])
def test_modes_are_few_and_move_all_joints_together(count):
    mask = np.ones(count, bool)
    mask[2] = False
    modes = _modes([mask])
    assert len(modes) <= 96
    total = sum(weights for _, weights in modes)
    assert total[2] == 0
    # Between the hats' centres the weights add up to one: a rigid motion is in the span.
    assert np.allclose(total[mask][: -(-count // 96) * (len(modes) - 1) + 1], 1.0)


#: Of a bow tie.
FOLDED = pt.certify(pt.MultiPatch([shapes.quad((0, 0), (1, 0), (0, 1), (1, 1))]))


def spoiling(monkeypatch, searches):
    """Searches for the inside, counted from 0, that find nothing certified."""
    solve, numbers = inside.solve, itertools.count()

    def spoiled(*arguments):
        posed, found = solve(*arguments)
        return posed, replace(found, certificate=FOLDED) if next(numbers) in searches else found

    monkeypatch.setattr(inside, "solve", spoiled)


def test_joints_slide_back_where_only_that_is_certified(monkeypatch):
    make, deformation = CASES["annulus, swirl"]
    mp = make()
    target, _ = targets.deformed(mp, deformation(mp), seed=2)
    plan = pt.TransferPlan(mp, "c0")
    fixed = plan.transfer(target, fixed_correspondence=True)
    assert plan.transfer(target).sliding.rounds > 0
    spoiling(monkeypatch, {0})
    back = plan.transfer(target)
    assert back.certificate.injective
    assert inside.SLID_BACK in back.warnings
    assert back.sliding.rounds == 0
    assert np.array_equal(np.array(back.registration.joints), np.array(fixed.registration.joints))
    for ours, unslid in zip(back.multipatch, fixed.multipatch, strict=True):
        assert np.array_equal(ours.control_points, unslid.control_points)


def test_what_fails_either_way_is_told_of_the_slid_joints(monkeypatch):
    make, deformation = CASES["annulus, swirl"]
    mp = make()
    target, _ = targets.deformed(mp, deformation(mp), seed=2)
    spoiling(monkeypatch, {0, 1})
    result = pt.transfer(mp, target, continuity="c0", on_failure="return", refine="never")
    assert FOLDED.status == result.certificate.status == "folded"
    assert result.sliding.rounds > 0
    assert inside.SLID_BACK not in result.warnings


@pytest.mark.parametrize("slack", [1.0 + 1e-6, 1.1])
def test_sliding_gives_no_success_up(slack):
    # The fit's error is just within what counts as a success, and just within the tolerance.
    make, deformation = CASES["o-grid, bump"]
    mp = make()
    target, _ = targets.deformed(mp, deformation(mp), seed=2)
    plan = pt.TransferPlan(mp, "c0")
    error = plan.transfer(target, fixed_correspondence=True, fit_tolerance=1e-9, refine="never",
                          on_failure="return").boundary_error  # fmt: skip
    for tolerance in (error * slack, error * slack / MISSED):
        how = {"fit_tolerance": tolerance, "refine": "never", "on_failure": "return"}
        fixed, slid = plan.transfer(target, fixed_correspondence=True, **how), plan.transfer(target, **how)
        if fixed.boundary_error <= tolerance:
            assert slid.boundary_error <= tolerance
        assert fixed.missed or not slid.missed
