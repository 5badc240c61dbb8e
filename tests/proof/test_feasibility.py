"""Feasibility of boundary loops and corners."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import models
import patchtransfer as pt
from patchtransfer.pipeline import source_boundary
from patchtransfer.proof.feasibility import check_corners, check_loops, corner_report
from shapes import LINE, polygon

CUBIC = [0, 0, 0, 0, 1, 1, 1, 1]


def box(x, y, size):
    return polygon([(x, y), (x + size, y), (x + size, y + size), (x, y + size)])


def test_disjoint_nested_loops_pass_in_any_order_and_sense():
    outer, hole, other = box(0, 0, 4), box(1, 1, 1), box(2.5, 2.5, 1)
    backwards = [c.reversed() for c in hole[::-1]]
    assert check_loops([backwards, outer, other], "target boundary") == []


def test_hole_outside_is_named():
    with pytest.raises(pt.InfeasibleTargetError, match="target boundary: loop 2 lies outside the outer loop"):
        check_loops([box(0, 0, 4), box(1, 1, 1), box(7, 1, 1)], "target boundary")


def test_hole_inside_a_hole_is_named():
    with pytest.raises(pt.InfeasibleTargetError, match="loop 2 lies inside the hole that loop 1 bounds"):
        check_loops([box(0, 0, 4), box(1, 1, 2), box(1.5, 1.5, 1)], "target boundary")


def test_hole_that_crosses_the_outer_loop_is_named():
    with pytest.raises(pt.InfeasibleTargetError, match=r"loops 0 and 1 cross at \(4, [23]\): curve 1 at t="):
        check_loops([box(0, 0, 4), box(3.5, 2, 1)], "target boundary")


def test_self_crossing_loop_is_named():
    bow = polygon([(0, 0), (2, 2), (2, 0), (0, 2)])
    with pytest.raises(pt.InfeasibleTargetError, match=r"loop 0 crosses itself at \(1, 1\): curve 0 at"):
        check_loops([bow], "fit")


def test_touching_loops_give_a_warning():
    warnings = check_loops([box(0, 0, 4), box(3, 1, 1)], "target boundary")
    assert warnings
    assert all("touch" in w or "could not be decided" in w for w in warnings)


def test_curves_that_run_along_each_other_are_told_of_once():
    """Forth and back on one straight line, which meets itself everywhere."""
    loop = polygon([(0, 0), (2, 0), (2, 1), (0, 1), (0, 0.5), (0, 0.8)])
    warnings = check_loops([loop], "target boundary")
    assert len(warnings) < 12
    assert sum("places more" in w for w in warnings) > 0


def test_thin_neck_is_no_crossing():
    gap = 1e-6
    neck = polygon([(0, 0), (1, 0), (1, 0.5), (2, 0.5), (2, 0), (3, 0), (3, 1), (2, 1),
                    (2, 0.5 + gap), (1, 0.5 + gap), (1, 1), (0, 1)])  # fmt: skip
    assert check_loops([neck], "target boundary") == []


def test_angles_of_a_concave_polygon():
    dent = polygon([(0, 0), (2, 0), (2, 2), (1, 1), (0, 2)])
    corners = corner_report([dent], [[True] * 5])
    assert [c.angle for c in corners] == pytest.approx([90, 90, 45, 270, 45])
    assert [c.kind for c in corners] == ["regular", "regular", "regular", "infeasible", "regular"]
    assert corners[2].bound == pytest.approx(math.sin(math.radians(45)))
    with pytest.raises(pt.InfeasibleTargetError, match=r"loop 0, joint 3 at \(1, 1\).* 270°.*two patches"):
        check_corners([dent], [[True] * 5], "target boundary")
    flags = [True, True, True, False, True]
    assert check_corners([dent], [flags], "target boundary")[3].kind == "free"


@given(st.floats(0, 6.28), st.sampled_from([1e-6, 1.0, 1e6]), st.sampled_from([0.0, 1e3]), st.floats(0.1, 10))
def test_straight_joints_are_degenerate_wherever_they_lie(angle, scale, offset, ratio):
    along = scale * np.array([math.cos(angle), math.sin(angle)])
    joint = scale * np.array([offset, -offset])
    a, b, c = (
        joint - along,
        joint + ratio * along,
        joint + scale * np.array([-math.sin(angle), math.cos(angle)]),
    )
    corner = corner_report([polygon([joint, b, c, a])], [[True] * 4])[0]
    assert corner.kind == "degenerate"
    assert corner.angle == pytest.approx(180)


@given(st.floats(0.01, 3.13), st.floats(0, 6.28))
def test_interior_angle_is_that_of_a_wedge(angle, turn):
    def ray(a):
        return np.array([math.cos(a + turn), math.sin(a + turn)])

    corner = corner_report([polygon([(0, 0), ray(0), ray(angle)])], [[True] * 3])[0]
    assert corner.angle == pytest.approx(math.degrees(angle))
    assert corner.bound == pytest.approx(math.sin(angle))


def test_vanishing_first_difference_uses_the_next():
    slow = pt.BSplineCurve(CUBIC, 3, [[0, 0], [0, 0], [0.5, 0], [1, 0]])
    rest = polygon([(1, 0), (1, 1), (0, 1), (0, 0)])[:3]
    corner = corner_report([[slow, *rest]], [[True] * 4])[0]
    assert corner.angle == pytest.approx(90)
    assert corner.kind == "degenerate"


def test_corner_kinds_agree_with_the_certificate():
    """The kind of a patch's corner is what the certificate finds there."""
    for top, kind, status in ((1.2, "regular", "certified"), (1.0, "degenerate", "degenerate"),
                              (0.8, "infeasible", "folded")):  # fmt: skip
        points = np.array([[[0, 0], [0, 2]], [[2, 0], [top, top]]], float)
        patch = pt.Patch((LINE, LINE), (1, 1), points)
        mp = pt.MultiPatch([patch])
        assert pt.certify(mp).status == status
        loops = mp.boundary().loops
        kinds = [c.kind for c in corner_report(loops, [[True] * 4])]
        assert sorted(kinds) == sorted(["regular"] * 3 + [kind])


def test_a_crossing_is_told_before_landmarks_are_blamed(monkeypatch):
    """A hole turned inside out in a loop of its own: its landmarks run backwards, but that is not what is wrong."""
    mp = models.plate_with_hole(2, 2)
    hole = [[0.3, 0.3], [-0.3, -0.3], [0.3, -0.3], [-0.3, 0.3]]
    outer = [curve.start.tolist() for curve in mp.boundary().loops[0]]
    target = pt.Boundary([polygon(outer), polygon(hole)])
    starts = [curve.start for curve in mp.boundary().loops[1]]
    backwards = np.array([[*starts[0], *hole[0]], [*starts[2], *hole[3]], [*starts[4], *hole[1]]])
    plan = pt.TransferPlan(mp, "c0")
    # And at once: no correspondence is looked for.
    monkeypatch.setattr(source_boundary, "register", None)
    for landmarks in (None, backwards):
        with pytest.raises(pt.InfeasibleTargetError, match=r"boundary loop 1 crosses itself at .*curve \d.*curve \d"):
            plan.transfer(target, landmarks)
