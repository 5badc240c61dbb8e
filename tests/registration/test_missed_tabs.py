"""Tabs of the target where the source is straight."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import domains
import models
import patchtransfer as pt
import targets
from patchtransfer import BSplineCurve, NotCertifiedError
from patchtransfer.registration.register import register
from shapes import loop

#: Control points of the upper side from right to left, round a mushroom.
MUSHROOM = [(4, 1), (3, 1), (2.2, 1), (2.1, 1), (2.2, 1.2), (2.6, 1.6), (2.6, 2.2), (2, 2.5), (1.4, 2.2), (1.4, 1.6),
            (1.8, 1.2), (1.9, 1), (1.8, 1), (1, 1), (0, 1)]  # fmt: skip


def bar(patches: int = 1) -> pt.MultiPatch:
    """A bar of length 4 and width 1, patch after patch."""
    ends = np.linspace(0, 4, patches + 1)
    return models.build([models.bilinear((a, 0), (b, 0), (b, 1), (a, 1)) for a, b in itertools.pairwise(ends)], 3, 2, 1)


def with_upper_side(control_points) -> pt.Boundary:
    n = len(control_points)
    knots = np.concatenate([[0] * 4, np.arange(1, n - 3), [n - 3] * 4])
    straight = [BSplineCurve([0, 0, 1, 1], 1, ends) for ends in ([(0, 1), (0, 0)], [(0, 0), (4, 0)], [(4, 0), (4, 1)])]
    return pt.Boundary([[BSplineCurve(knots, 3, control_points), *straight]])


def registered(source: pt.MultiPatch, target: pt.Boundary):
    corners = np.array([(0, 0), (4, 0), (4, 1), (0, 1)])
    return register(source.boundary().loops, target, np.c_[corners, corners])


@pytest.mark.parametrize("patches", [1, 2])
def test_a_tab_is_named_with_its_tip(patches):
    # Of two patches, the joint between them lies on the tab.
    found = registered(bar(patches), with_upper_side(MUSHROOM))
    (tab,) = found.missed_tabs
    assert tab.x == pytest.approx(2, abs=0.1)
    assert tab.y == pytest.approx(2.35, abs=0.15)
    assert tab.loop == 0
    assert 1.5 < tab.stretch < 2
    assert any(f"a tab at ({tab.x:.4g}, {tab.y:.4g}) that no side of the source reaches" in w for w in found.warnings)


def test_a_notch_counts_as_well():
    notch = with_upper_side([(x, 1 - 0.5 * (y - 1)) for x, y in MUSHROOM[:5]] + [(2.7, 0.6), (2.7, 0.25), (2, 0.15),
                            (1.3, 0.25), (1.3, 0.6)] + [(x, 1 - 0.5 * (y - 1)) for x, y in MUSHROOM[10:]])  # fmt: skip
    (tab,) = registered(bar(), notch).missed_tabs
    assert tab.y < 0.4


@settings(max_examples=15, deadline=None)
@given(st.floats(0, 360), st.floats(-3, 3), st.floats(-5, 5))
def test_it_moves_with_the_target(degrees, size, shift):
    matrix = 10.0**size * domains.rotation(degrees)
    target = with_upper_side(MUSHROOM)
    (here,) = registered(bar(), target).missed_tabs
    corners = np.array([(0, 0), (4, 0), (4, 1), (0, 1)])
    moved = domains.mapped(target, matrix, (shift, -shift))
    (there,) = register(bar().boundary().loops, moved, np.c_[corners, corners @ matrix.T + [shift, -shift]]).missed_tabs
    assert there.stretch == pytest.approx(here.stretch, rel=1e-6)
    tip = matrix @ [here.x, here.y] + [shift, -shift]
    assert np.allclose([there.x, there.y], tip, atol=0.02 * 10.0**size)


@pytest.mark.parametrize("angle", [90, 180, 270])
def test_a_bend_is_no_tab(angle):
    source = bar(4)
    target, rows = targets.deformed(source, targets.bend(source, angle), seed=1)
    assert not register(source.boundary().loops, target, rows).missed_tabs


def test_waves_corners_and_round_sides_are_no_tabs():
    shallow = with_upper_side([(4 - 4 * t, 1 + 0.2 * np.sin(6 * np.pi * t)) for t in np.linspace(0, 1, 15)])
    serif = loop([(0, 0), (4, 0), (4, 1), (2.4, 1), (2.4, 3), (1.6, 3), (1.6, 1), (0, 1)])
    for target in (shallow, serif, bar().boundary()):
        assert not registered(bar(), target).missed_tabs
    # Where the source has the tab itself, its side is not straight.
    target = with_upper_side(MUSHROOM)
    assert not register(target.loops, target).missed_tabs


def test_the_refusal_and_the_report_name_it():
    narrow = [(x if not 3 < k < 11 else 2 + 0.5 * (x - 2), y if y == 1 else 1 + 3 * (y - 1))
              for k, (x, y) in enumerate(MUSHROOM)]  # fmt: skip
    target = with_upper_side(narrow)
    rows = [(0, 0, 0, 0), (4, 0, 4, 0), (4, 1, 4, 1), (0, 1, 0, 1)]
    with pytest.raises(NotCertifiedError, match=r"a tab at \(.*that no side of the source reaches.*parameterize") as no:
        pt.transfer(bar(), target, rows, continuity="c0", refine="never")
    (tab,) = no.value.result.to_dict()["registration"]["missed_tabs"]
    assert tab["y"] > 3
