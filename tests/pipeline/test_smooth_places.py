"""Corners of the source on smooth places of the target: opened for a second patch, or left out with their patch."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
from patchtransfer import MultiPatch, Side, TransferPlan
from shapes import circle, loop, quad, turned

quick = settings(max_examples=10, deadline=None)


def pear(sharp: float = 0.3) -> pt.Boundary:
    """A smooth outline but for one corner at the top."""
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    r = 1 + sharp * np.exp(-6 * np.abs(np.angle(np.exp(1j * (t - np.pi / 2)))))
    return pt.Boundary.from_points([np.column_stack([r * np.cos(t), r * np.sin(t)])], smooth=True)


def serif_bar(names: bool = False) -> MultiPatch:
    """A bar with a flange at either side of its right end, a patch each."""
    quads = [
        quad((0, 0), (3, 0), (3, 1), (0, 1)),
        quad((3, 0), (4, 0), (4, 1), (3, 1)),
        quad((3, -0.5), (4, -0.5), (4, 0), (3, 0)),
        quad((3, 1), (4, 1), (4, 1.5), (3, 1.5)),
    ]
    mp = MultiPatch([turned(patch.elevate(2), k % 2 == 1, k > 1, k == 2) for k, patch in enumerate(quads)])
    return mp.with_labels({"tip": [s for s in mp.boundaries if s[0] == 3]}) if names else mp


def plain_bar() -> pt.Boundary:
    """Its corners are those of the bar; the flanges' feet have theirs on the long sides."""
    return loop([(0, 0), (4, 0), (4, 1), (0, 1)])


@pytest.mark.parametrize("continuity", ["c0", "c1"])
@pytest.mark.parametrize("radius", [0.7, 2.0])
def test_a_square_on_a_disc(continuity, radius):
    source = models.grid(1, 1, 3, 2, None)
    target = pt.Boundary([[circle(radius)]])
    plain = pt.transfer(source, target, continuity=continuity, refine="tolerance")
    assert plain.certificate.status == "degenerate"
    result = pt.transfer(source, target, continuity=continuity, split="auto")
    assert result.certificate.status == "certified"
    assert result.quality.scaled_jacobian.min > 0.2
    assert sorted(result.split.opened) == [(0, 0), (0, 1), (0, 2), (0, 3)]
    assert result.split.dropped == ()
    assert {origin.patch for origin in result.split.origin} == {0}
    assert all(vertex.valence > 1 for vertex in result.multipatch.topology.vertices)
    (said,) = (warning for warning in result.warnings if "the source was split" in warning)
    assert f"1 -> {len(result.multipatch)} patches" in said
    assert "two patches meet where corners" in said
    assert result.to_dict()["split"]["opened"][0].keys() == {"patch", "corner"}


def test_a_corner_stays_where_the_target_has_one():
    source = models.grid(1, 1, 3, 2, None)
    result = pt.transfer(source, pear(), continuity="c0", split="auto")
    assert result.certificate.status == "certified"
    assert len(result.split.opened) == 3


@quick
@given(st.floats(0, 6), st.floats(0.1, 10), st.tuples(st.floats(-5, 5), st.floats(-5, 5)))
def test_wherever_the_target_is(angle, scale, shift):
    """Moved, turned and scaled targets have the same patches."""
    source = models.star(5, 3, 1)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    curve = circle()
    points = scale * (curve.control_points @ turn) + shift
    target = pt.Boundary([[pt.BSplineCurve(curve.knots, curve.degree, points, curve.weights)]])
    result = pt.transfer(source, target, continuity="c0", split="auto")
    assert result.certificate.status == "certified"
    assert len(result.split.opened) == 5
    assert result.quality.scaled_jacobian.min > 0.2


def rows_of(source: MultiPatch) -> np.ndarray:
    """Landmarks: the left end stays, the flanges' feet lie on the right end's corners."""
    return np.array(
        [
            (0, 0, 0, 0),
            (3, 0, 3, 0),
            (4, 0, 4, 0.1),
            (4, 1, 4, 0.9),
            (3, 1, 3, 1),
            (0, 1, 0, 1),
        ],
        float,
    )


def test_flanges_that_the_target_lacks_are_left_out():
    """Both free corners of a flange lie on a straight side of the target."""
    source = serif_bar()
    target = loop([(0, 0), (9, 0), (9, 1), (0, 1)])
    # The bar's end is far along; flanges are matched to pieces of the long sides.
    landmarks = [(0, 0, 0, 0), (4, 0, 9, 0), (4, 1, 9, 1), (0, 1, 0, 1), (3, 0, 6, 0), (3, 1, 6, 1)]
    result = pt.transfer(source, target, landmarks, split="auto")
    assert result.certificate.status == "certified"
    assert result.split.dropped == (2, 3)
    assert [origin.patch for origin in result.split.origin] == [0, 1]
    assert len(result.multipatch) == 2
    assert result.boundary_error < 1e-8
    assert result.to_dict()["split"]["dropped"] == [2, 3]
    (said,) = (warning for warning in result.warnings if "the source was split" in warning)
    assert "4 -> 2 patches" in said
    assert "patches 2, 3" in said


def test_flanges_with_names_are_kept():
    source = serif_bar(names=True)
    target = loop([(0, 0), (9, 0), (9, 1), (0, 1)])
    landmarks = [(0, 0, 0, 0), (4, 0, 9, 0), (4, 1, 9, 1), (0, 1, 0, 1), (3, 0, 6, 0), (3, 1, 6, 1)]
    result = pt.transfer(source, target, landmarks, split="auto")
    assert result.certificate.status == "certified"
    assert result.split.dropped == (2,)
    assert len(result.split.opened) == 2
    assert {result.split.origin[k].patch for k, _ in result.multipatch.sides["tip"]} == {3}


def test_flanges_that_something_is_matched_to_are_kept():
    source = serif_bar()
    target = loop([(0, 0), (9, 0), (9, 1), (0, 1)])
    landmarks = [(0, 0, 0, 0), (4, 0, 9, 0), (4, 1, 9, 1), (0, 1, 0, 1), (3, 0, 6, 0), (3, 1, 6, 1)]
    landmarks += [(3.5, -0.5, 7.5, 0)]
    result = pt.transfer(source, target, landmarks, split="auto")
    assert 2 not in result.split.dropped
    assert {origin.patch for origin in result.split.origin} >= {0, 1, 2}


def test_families_share_their_patches():
    source = models.grid(1, 1, 3, 2, None)
    targets = [pear(), pt.Boundary([[circle()]]), loop([(0, 0), (1, 0), (1, 1), (0, 1)])]
    plan = TransferPlan(source, "c0").split_for(targets)
    assert len(plan.split.opened) == 4
    results = list(plan.map(targets))
    assert {len(result.multipatch) for result in results} == {len(plan.source)}
    assert [result.certificate.status for result in results] == ["certified"] * 3


def test_a_mirror_image_is_opened_alike():
    source = models.star(5, 3, 1)
    plan = TransferPlan(source, "c0").split_for([pt.Boundary([[circle()]])])
    image = plan._mirrored
    assert image.split.opened == plan.split.opened
    assert len(image.source) == len(plan.source)
    bare = TransferPlan(serif_bar(), "c0")
    bare = bare._divided(pt.pipeline.divisions.without(bare._welded, None, [2, 3]))
    assert bare._mirrored.split.dropped == (2, 3)


def test_sources_that_would_need_far_more_patches_stay_as_they_are():
    """Every opened corner of a long row cuts all of it."""
    row = models.strip(1, 3, 1)
    result = pt.transfer(row, pt.Boundary([[circle()]]), continuity="c0", split="auto")
    assert len(result.multipatch) <= 4 * max(len(row), 1) or result.split.opened
    assert Side.WEST in Side
