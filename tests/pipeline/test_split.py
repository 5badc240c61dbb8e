"""Sources split where the target has corners that no joint takes."""

from __future__ import annotations

import itertools
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import domains
import models
import patchtransfer as pt
from patchtransfer import Boundary, InfeasibleTargetError, InputError, NotCertifiedError, TransferPlan
from patchtransfer.pipeline.divisions import LEAST_WIDTH, TOGETHER, _places
from patchtransfer.pipeline.splitting import _in_order
from shapes import loop

# Last: modules of other names lie in tests/support.
sys.path.append(str(Path(__file__).parents[2] / "scripts"))
from glyphs import glyph

quick = settings(max_examples=25, deadline=None)
quicker = settings(max_examples=8, deadline=None)

#: Of the bar.
CORNERS = [(0, 0), (4, 0), (4, 1), (0, 1)]
#: Distance, relative to the loop, of joints and corners that are the same.
AT = 1e-9


def bar(patches: int = 1) -> pt.MultiPatch:
    """A bar of length 4 and width 1, patch after patch."""
    ends = np.linspace(0, 4, patches + 1)
    return models.build([models.bilinear((a, 0), (b, 0), (b, 1), (a, 1)) for a, b in itertools.pairwise(ends)], 3, 1, 1)


def serif(foot: float = 0.3, size: float = 0.25) -> Boundary:
    """The bar with a foot at its right end."""
    return loop(
        [
            (0, 0),
            (4 - size, 0),
            (4 - size, -foot),
            (4, -foot),
            (4, 1 + foot),
            (4 - size, 1 + foot),
            (4 - size, 1),
            (0, 1),
        ]
    )


@st.composite
def bent_bars(draw):
    """Polygons: the bar with zigzags along both of its long sides, that turn by more than 20 degrees at each corner."""
    sides = []
    for y, outwards in ((0.0, -1.0), (1.0, 1.0)):
        n = draw(st.integers(0, 3))
        x = np.cumsum(draw(st.lists(st.floats(0.9, 1.1), min_size=n + 1, max_size=n + 1)))
        x = 4 * x[:-1] / x[-1]
        sign = outwards if n < 2 else draw(st.sampled_from([-1.0, 1.0]))
        size = {0: 0, 1: 0.4, 2: 0.25, 3: 0.2}[n] + draw(st.floats(0.0, 0.1))
        sides.append([(float(a), y + sign * size * (-1) ** i) for i, a in enumerate(x)])
    return loop([(0, 0), *sides[0], (4, 0), (4, 1), *reversed(sides[1]), (0, 1)])


def off_joints(result: pt.TransferResult) -> list[tuple[float, float]]:
    """Corners of the target that no joint is at."""
    found = []
    for there in result.registration.loops:
        corners, length = there.target.corners[0], there.target.length
        gap = abs(corners[:, None] - np.mod(there.joints[:-1], length))
        gap = np.minimum(gap, length - gap).min(axis=1)
        found += there.target.point(corners[gap > AT * length]).tolist()
    return found


def is_cover(origin, source: pt.MultiPatch) -> bool:
    """Whether the pieces of every patch fill it."""
    filled = np.zeros(len(source))
    for o in origin:
        knots = source.patches[o.patch].knots
        filled[o.patch] += (o.u[1] - o.u[0]) * (o.v[1] - o.v[0]) / np.ptp(knots[0]) / np.ptp(knots[1])
    return bool(np.allclose(filled, 1.0))


@quick
@given(bent_bars(), st.integers(1, 3))
def test_every_corner_gets_a_joint(target, patches):
    source = bar(patches)
    result = pt.transfer(source, target, continuity="c0", split="auto")
    assert result.succeeded
    assert off_joints(result) == []
    assert result.registration.missed_corners == ()
    assert result.boundary_error <= 1e-3
    if result.split is None:
        assert len(result.multipatch) == patches
        return
    assert len(result.multipatch) == len(result.split.origin) > patches
    assert is_cover(result.split.origin, source)
    # Straight sides between corners: what is left is rounding.
    assert result.boundary_error < 1e-6
    assert any("the source was split" in warning for warning in result.warnings)
    report = result.to_dict()["split"]
    assert report["corners"] == [list(corner) for corner in result.split.corners]
    assert len(report["origin"]) == len(result.multipatch)
    assert report["origin"][0].keys() == {"patch", "u", "v"}


@quicker
@given(bent_bars(), st.floats(-180, 180), st.floats(0.01, 100))
def test_turned_and_scaled_targets_are_split_alike(target, degrees, scale):
    source, matrix = bar(2), scale * domains.rotation(degrees)
    # The bar looks alike from both ends: its corners are given.
    corners = np.array(CORNERS)
    here = pt.transfer(source, target, np.c_[corners, corners], "c0", split="auto")
    there = pt.transfer(source, domains.mapped(target, matrix), np.c_[corners, corners @ matrix.T], "c0", split="auto")
    assert (here.split is None) == (there.split is None)
    if here.split is not None:
        assert [o.patch for o in here.split.origin] == [o.patch for o in there.split.origin]
        np.testing.assert_allclose(
            [(o.u, o.v) for o in here.split.origin], [(o.u, o.v) for o in there.split.origin], atol=1e-5
        )
        np.testing.assert_allclose(
            there.split.corners, np.array(here.split.corners) @ matrix.T, atol=1e-9 * scale, rtol=1e-9
        )
    assert there.quality.scaled_jacobian.mean == pytest.approx(here.quality.scaled_jacobian.mean, abs=1e-3)


@quicker
@given(st.lists(bent_bars(), min_size=2, max_size=3))
def test_a_family_has_the_same_patches(family):
    plan = TransferPlan(bar(2), "c0").split_for(family)
    results = list(plan.map(family, refine="never", on_failure="return"))
    for result in results:
        assert off_joints(result) == []
        assert result.multipatch.interfaces == plan.source.interfaces
        for a, b in zip(result.multipatch, plan.source, strict=True):
            assert all(np.array_equal(x, y) for x, y in zip(a.knots, b.knots, strict=True))
    if plan.split is not None:
        assert is_cover(plan.split.origin, bar(2))
        assert {corner for result in results for corner in result.split.corners} == set(plan.split.corners)


@pytest.mark.parametrize("letter", "LK")
def test_plain_letters_grow_serifs(letter):
    """What it is for: without, nearly half of the corners are rounded off."""
    source = pt.parameterize(glyph(letter, "DejaVuSans")).multipatch
    target = glyph(letter, "DejaVuSerif")
    result = pt.transfer(source, target, continuity="c0", split="auto")
    assert off_joints(result) == []
    assert result.boundary_error <= 1e-3
    assert is_cover(result.split.origin, source)
    missed = pt.transfer(source, target, continuity="c0", on_failure="return").registration.missed_corners
    # A free joint near by may serve one of them.
    assert 6 <= len(result.split.corners) <= len(missed)


def test_a_family_of_one_is_the_target_by_itself():
    plan = TransferPlan(bar(), "c0")
    alone = plan.transfer(serif(), split="auto")
    (one,) = plan.split_for([serif()]).map([serif()])
    assert one.split == alone.split
    assert all(
        np.array_equal(a.control_points, b.control_points)
        for a, b in zip(one.multipatch, alone.multipatch, strict=True)
    )


def test_plans_split_again():
    """A plan split for one target is split for another one: origins are in the first source's terms."""
    source = bar()
    kink = loop([(0, 0), (1.2, 0.5), (4, 0), (4, 1), (0, 1)])
    plan = TransferPlan(source, "c0").split_for([serif()])
    again = plan.split_for([kink])
    assert len(again.source) > len(plan.source)
    assert is_cover(again.split.origin, source)
    for piece, origin in zip(again.source, again.split.origin, strict=True):
        own = [np.linspace(*knots[[0, -1]], 4) for knots in piece.knots]
        there = source.patches[origin.patch].grid(np.linspace(*origin.u, 4), np.linspace(*origin.v, 4))
        assert np.abs(piece.grid(*own) - there).max() < 1e-12
    for target in (serif(), kink):
        assert off_joints(again.transfer(target)) == []


def test_corners_on_both_sides_share_a_cut():
    result = pt.transfer(bar(), serif(), continuity="c0", split="auto")
    # Three corners on either long side, with their partners across.
    assert len(result.multipatch) <= 4
    hexagon = loop([(0, 0), (2, -0.3), (4, 0), (4, 1), (2.05, 1.3), (0, 1)])
    result = pt.transfer(bar(), hexagon, continuity="c0", split="auto")
    assert len(result.multipatch) == 2
    assert len(result.split.corners) == 2
    assert len(result.split.cuts) == 1


def test_a_joint_near_by_is_moved_and_no_patch_split():
    """Two corners on one side, one of them next to a free joint: a single cut for the other."""
    target = loop([(0, 0), (4, 0), (4, 1), (3.2, 1.3), (2.1, 1.3), (0, 1)])
    result = pt.transfer(bar(2), target, continuity="c0", split="auto")
    assert off_joints(result) == []
    assert len(result.split.cuts) == 1
    near = loop([(0, 0), (4, 0), (4, 1), (1.9, 1.3), (0, 1)])
    assert pt.transfer(bar(2), near, continuity="c0", split="auto").split is None


def test_corners_that_are_one_get_one_joint():
    """A chamfer far smaller than the fit tolerance."""
    target = loop([(0, 0), (2.0, -0.9), (2.0002, -0.9), (4, 0), (4, 1), (0, 1)])
    result = pt.transfer(bar(), target, continuity="c0", split="auto")
    assert len(result.multipatch) == 2
    assert result.boundary_error < 1e-3


def test_close_corners_get_a_joint_each():
    target = loop([(0, 0), (1.9, 0), (1.95, -0.1), (2.05, -0.1), (2.1, 0), (4, 0), (4, 1), (0, 1)])
    result = pt.transfer(bar(), target, continuity="c0", split="auto")
    assert off_joints(result) == []
    assert result.boundary_error < 1e-6


SPIKE = [(1.9, 0), (1.95, -0.6), (2.05, -0.6), (2.1, 0)]
MUSHROOM = [(1.9, 0), (1.9, -0.3), (1.6, -0.3), (1.6, -0.5), (2.4, -0.5), (2.4, -0.3), (2.1, -0.3), (2.1, 0)]
#: Turns once and a half: its parts lie side by side, so that no strip reaches the inmost.
SPIRAL = [(1.9, 0), (1.9, -0.1), (2.3, -0.1), (2.3, -0.3), (1.9, -0.3), (1.9, -0.2), (2.2, -0.2), (2.2, -0.18)]
SPIRAL += [(1.85, -0.18), (1.85, -0.35), (2.35, -0.35), (2.35, 0)]


@pytest.mark.parametrize("tab", [SPIKE, MUSHROOM], ids=["spike", "mushroom"])
def test_tabs_far_deeper_than_wide(tab):
    target = loop([(0, 0), *tab, (4, 0), (4, 1), (0, 1)])
    result = pt.transfer(bar(), target, continuity="c0", split="auto")
    assert result.certificate.status == "certified"
    assert off_joints(result) == []
    assert result.boundary_error < 1e-8
    assert len(result.multipatch) == 1 + len(tab)


@pytest.mark.parametrize("refine", ["auto", "never"])
def test_never_worse_than_without(refine):
    """A tab that leaves its patches no room: the source as it is comes nearer than no map at all."""
    target = loop([(0, 0), *SPIRAL, (4, 0), (4, 1), (0, 1)])
    how = {"continuity": "c0", "fit_tolerance": 0.04, "refine": refine}
    whole, result = (pt.transfer(bar(), target, split=split, **how) for split in ("never", "auto"))
    assert result.split is None
    assert result.split_in_vain
    assert all(
        np.array_equal(a.control_points, b.control_points)
        for a, b in zip(result.multipatch, whole.multipatch, strict=True)
    )
    assert len(result.registration.missed_corners) == len(SPIRAL)
    (said,) = (warning for warning in result.warnings if "splitting the source" in warning)
    # Two are so close that they share a joint.
    assert "11 corners (1.9, 0)" in said
    # What was tried is not recommended.
    assert not any("--split auto" in warning for warning in result.warnings)
    assert any("--split auto" in warning for warning in whole.warnings)


@pytest.mark.parametrize("how", [{"continuity": "c1"}, {"continuity": "g1"}, {"method": "paper", "continuity": "c0"}])
def test_other_continuities_and_methods(how):
    source = bar()
    if how["continuity"] == "g1":
        source = source.split_spans(2).reduce_continuity(1)
    target = loop([(0, 0), (1.5, -0.5), (4, 0), (4, 1), (2.7, 1.5), (0, 1)])
    result = pt.transfer(source, target, split="auto", **how)
    assert result.succeeded
    assert off_joints(result) == []
    assert len(result.multipatch) == 3


def test_landmarks_and_labels_are_kept():
    source = bar().with_labels({"bottom": [(k, side) for k, side in bar().boundaries]})
    marks = [(*corner, *corner) for corner in CORNERS[:1]]
    result = pt.transfer(source, serif(), marks, continuity="c0", split="auto", on_failure="return")
    joints = np.array([[*a, *b] for a, b in result.registration.joints])
    assert abs(joints - marks[0]).sum(axis=1).min() < 1e-6
    assert set(result.multipatch.sides["bottom"]) == set(result.multipatch.boundaries)


def test_what_is_found_can_be_handed_back():
    """The landmarks of a split result ask for the same correspondence of its source."""
    plan = TransferPlan(bar(), "c0").split_for([serif()])
    found = plan.transfer(serif())
    again = pt.transfer(plan.source, serif(), found.registration.landmarks, continuity="c0")
    assert off_joints(again) == []
    np.testing.assert_allclose(np.array(again.registration.joints), np.array(found.registration.joints), atol=1e-6)


def test_plans_of_split_sources_travel():
    plan = TransferPlan(bar(), "c0").split_for([serif()])
    sent = pickle.loads(pickle.dumps(plan))
    a, b = (p.transfer(serif()).multipatch for p in (plan, sent))
    assert all(np.array_equal(x.control_points, y.control_points) for x, y in zip(a, b, strict=True))


def test_nothing_to_split():
    plan = TransferPlan(bar(2), "c0")
    target = loop([(0, 0), (5, 0), (5, 2), (0, 1)])
    assert plan.split_for([target]) is plan
    with_, without = plan.transfer(target, split="auto"), plan.transfer(target)
    assert with_.split is None
    assert with_.to_dict()["split"] is None
    assert all(
        np.array_equal(a.control_points, b.control_points)
        for a, b in zip(with_.multipatch, without.multipatch, strict=True)
    )


def test_without_it_the_message_recommends_it():
    """As a warning where the corners are rounded off well enough, else in the error."""
    kink = loop([(0, 0), (1.0, -0.02), (2.0, 0.28), (4, 0), (4, 1), (0, 1)])
    result = pt.transfer(bar(), kink, continuity="c0", fit_tolerance=0.05, on_failure="return")
    assert result.succeeded
    (advice,) = (warning for warning in result.warnings if "--split auto" in warning)
    assert "(2, 0.28)" in advice
    assert (2.0, 0.28) in [(round(c.x, 9), round(c.y, 9)) for c in result.registration.missed_corners]
    with pytest.raises(
        NotCertifiedError, match=r"\(4, 1\.3\).*--split auto \(split='auto'\)|--split auto.*"
    ) as failure:
        pt.transfer(bar(), serif(), continuity="c0", refine="never")
    assert "(3.75, 0)" in str(failure.value)


def test_targets_of_a_family_that_cannot_be_registered_are_named():
    plan, two = TransferPlan(bar(), "c0"), domains.ring()
    with pytest.raises(InfeasibleTargetError, match=r"^targets\[1\]: "):
        plan.split_for([serif(), two])
    assert len(plan.split_for([serif(), two], skip_failures=True).source) > 1
    with pytest.raises(InputError, match="got 2 for 1"):
        plan.split_for([serif()], [None, None])
    with pytest.raises(InputError, match="split must be one of never, auto"):
        plan.transfer(serif(), split="always")


@given(st.data())
@settings(max_examples=100, deadline=None)
def test_corners_take_the_nearest_joints_in_order(data):
    """Against all choices."""
    m = data.draw(st.integers(1, 6))
    n = data.draw(st.integers(0, m))
    places = st.floats(0, 1)
    wanted = np.sort(data.draw(st.lists(places, min_size=n, max_size=n)))
    offered = np.sort(data.draw(st.lists(places, min_size=m, max_size=m)))
    chosen = _in_order(wanted, offered)
    assert (np.diff(chosen) > 0).all()
    best = min(abs(wanted - offered[list(c)]).sum() for c in itertools.combinations(range(m), n))
    assert abs(wanted - offered[chosen]).sum() == pytest.approx(best)


@given(
    st.lists(st.tuples(st.integers(0, 3), st.floats(0, 1)), min_size=1, max_size=12),
    st.lists(st.sampled_from([0.25, 0.5, 0.51, 0.75]), max_size=3),
)
@settings(max_examples=200, deadline=None)
def test_cuts_of_a_strip(wanted, knots):
    """One for every corner of a side, in order, apart from each other; no more than there are corners."""
    places = _places([((0, end, 1), x) for end, x in wanted], knots)
    most = max(sum(end == e for e, _ in wanted) for end in range(4))
    assert most <= len(places) <= len(wanted)
    width = min(LEAST_WIDTH, 0.5 / (len(places) + 1))
    assert (np.diff([0.0, *places, 1.0]) > width / 4).all()
    # Alone on its side, and with room, a corner has its cut near by.
    if len(wanted) == 1:
        assert abs(places[0] - wanted[0][1]) <= max(LEAST_WIDTH, TOGETHER)
