"""Legs that chords ask for: of the wished lengths, on their lines, and no farther from the target than is permitted."""

from __future__ import annotations

import numpy as np
import pytest

import patchtransfer as pt
import real
import smoothness
import targets
from patchtransfer import examples
from patchtransfer.fitting.fit import fit_boundary
from patchtransfer.fitting.legs import PERMITTED, with_legs
from patchtransfer.pipeline import inside

TOLERANCE = 1e-3


def legs(sides, i: int) -> list[np.ndarray]:
    """Before and after the start of side i."""
    before, after = sides[i - 1].curve.control_points, sides[i].curve.control_points
    return [before[-2] - before[-1], after[1] - after[0]]


@pytest.mark.parametrize("name", ["rabbit", "human", "two-hole-plate", "frame"])
@pytest.mark.parametrize("factor", [0.9, 1.15])
def test_legs_have_the_wished_lengths_and_sides_stay_on_the_target(name, factor):
    source, target, landmarks = examples.load(name)
    found = pt.transfer(source, target, landmarks, "c0")
    fitted, registration = fit_boundary(found.registration, tolerance=TOLERANCE), found.registration
    wanted = {}
    for k, sides in enumerate(fitted.loops):
        smooth = [i for i, side in enumerate(sides) if side.smooth]
        for i in smooth[::3]:
            before, after = (float(np.hypot(*leg)) for leg in legs(sides, i))
            wanted[k, i] = before / factor, after * factor
    moved = with_legs(fitted, registration, wanted, TOLERANCE)
    reached = 0
    for (k, i), lengths in wanted.items():
        old, new = legs(fitted.loops[k], i), legs(moved.loops[k], i)
        for a, b in zip(old, new, strict=True):
            assert abs(a[0] * b[1] - a[1] * b[0]) < 1e-12 * np.hypot(*a) * np.hypot(*b)
        now = [float(np.hypot(*leg)) for leg in new]
        if np.allclose(now, lengths, rtol=1e-12):
            reached += 1
        else:
            np.testing.assert_array_equal(old, new)
    assert reached >= 0.7 * len(wanted) > 0
    for before, after in zip(fitted.loops, moved.loops, strict=True):
        for a, b in zip(before, after, strict=True):
            assert b.error <= max(a.error, PERMITTED * TOLERANCE)
            np.testing.assert_array_equal(a.curve.control_points[[0, -1]], b.curve.control_points[[0, -1]])
    # Second route: the distance of the curves from the target.
    diameter = registration.loops[0].target.diameter
    for loop, sides in zip(registration.loops, moved.loops, strict=True):
        for side in sides:
            at = side.curve(np.linspace(*side.curve.domain, 200))
            assert loop.target.nearest(at)[1].max() < (1.5 * side.error + 1e-8) * diameter


def test_sides_that_follow_the_target_exactly_are_left_alone():
    source, _, _ = examples.load("rabbit")
    found = pt.transfer(source, source.boundary(), continuity="c0", fixed_correspondence=True)
    fitted = found.fitted
    assert fitted.error < 1e-9
    wanted = {
        (k, i): tuple(1.2 * float(np.hypot(*leg)) for leg in legs(sides, i))
        for k, sides in enumerate(fitted.loops)
        for i, side in enumerate(sides)
        if side.smooth
    }
    assert with_legs(fitted, found.registration, wanted, TOLERANCE).loops == fitted.loops


def test_wishes_that_the_fit_does_not_permit_are_not_granted():
    source, target, landmarks = examples.load("rabbit")
    found = pt.transfer(source, target, landmarks, "c0")
    wanted = {
        (k, i): tuple(5.0 * float(np.hypot(*leg)) for leg in legs(sides, i))
        for k, sides in enumerate(found.fitted.loops)
        for i, side in enumerate(sides)
        if side.smooth
    }
    moved = with_legs(found.fitted, found.registration, wanted, TOLERANCE)
    assert moved.error <= max(found.fitted.error, PERMITTED * TOLERANCE)


def pair(source, target, landmarks, monkeypatch) -> list[pt.TransferResult]:
    """With the legs as they were fitted, and with those of chords."""
    after = pt.transfer(source, target, landmarks, "c1")
    with monkeypatch.context() as patched:
        patched.setattr(inside, "with_legs_of_chords", lambda posed, *_: posed)
        before = pt.transfer(source, target, landmarks, "c1")
    return [before, after]


@pytest.mark.parametrize(("name", "more"), [("rabbit", 0.05), ("human", 0.03), ("frame", 0.1), ("two-hole-plate", 0.0)])
def test_more_of_the_interfaces_is_c1_at_the_same_accuracy(name, more, monkeypatch):
    before, after = pair(*examples.load(name), monkeypatch)
    shares = [smoothness.share(smoothness.spans(r.multipatch)) for r in (before, after)]
    assert shares[1] > shares[0] + more
    assert after.boundary_error <= max(before.boundary_error, PERMITTED * TOLERANCE)
    assert after.certificate.injective
    assert after.quality.scaled_jacobian.min > before.quality.scaled_jacobian.min - 0.01


def test_only_c1_asks_for_legs(monkeypatch):
    source, target, landmarks = examples.load("rabbit")
    fits = [pt.transfer(source, target, landmarks, "c0").fitted]
    fits.append(pt.transfer(source, target, landmarks, "c1", ratios="source").fitted)
    fits.append(pair(source, target, landmarks, monkeypatch)[0].fitted)
    assert fits[0].loops == fits[1].loops == fits[2].loops


@real.needed
def test_legs_of_a_published_model(monkeypatch):
    source = real.model("yeti")
    before, after = pair(source, *targets.deformed(source, targets.bend(source, 40)), monkeypatch)
    shares = [smoothness.share(smoothness.spans(r.multipatch)) for r in (before, after)]
    assert shares[1] > shares[0] + 0.1
    assert after.boundary_error <= max(before.boundary_error, PERMITTED * TOLERANCE)
