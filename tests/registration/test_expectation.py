"""What a registration says before there is a map: mismatch, the probability that it is right, and what to expect."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import models
import patchtransfer as pt
import targets
from commands import run
from patchtransfer import examples
from patchtransfer.registration.calibrated import MEAN, MINIMUM, RIGHT
from patchtransfer.registration.confidence import DOUBTFUL, confidence, traits
from patchtransfer.registration.expected import POOR, distance, expected
from patchtransfer.registration.mismatch import Mismatch
from patchtransfer.registration.register import register
from shapes import SQUARE, loop, polygon

NONE = Mismatch(0.0, 0.0, 0.0)


# --- mismatch -------------------------------------------------------------------------------------


def test_similar_shapes_have_none():
    mp = models.l_shape()
    target, _ = targets.deformed(mp, targets.similarity(70, 3.0, (1, 2)))
    found = register(mp.boundary().loops, target).mismatch
    assert max(found) < 1e-3


@pytest.mark.parametrize("factor", [1.5, 3.0])
def test_a_stretched_square_by_hand(factor):
    """Its sides keep their directions; the stretch jumps at corners from 1 to the factor."""
    corners = np.array(SQUARE, float)
    stretched = corners * [factor, 1]
    rows = np.column_stack([corners, stretched])
    found = register([polygon(SQUARE)], loop(stretched), rows).mismatch
    assert found.turned == pytest.approx(0, abs=1e-9)
    assert found.jump == pytest.approx(np.log(factor), rel=1e-6)
    # Inside a convex domain inner distances are those of the plane: second route, by points as dense.
    t = (np.arange(80) / 20)[:, None]
    side = np.minimum(t.astype(int).ravel(), 3)
    points = corners[side] + (t - side[:, None]) * (np.roll(corners, -1, axis=0) - corners)[side]
    i, j = np.triu_indices(80, 1)
    ratio = np.log(
        np.linalg.norm((points[i] - points[j]) * [factor, 1], axis=1) / np.linalg.norm(points[i] - points[j], axis=1)
    )
    assert found.distances == pytest.approx(ratio.std(), rel=1e-6)


def test_a_turned_target_has_the_same_mismatch():
    mp = models.l_shape()
    bent, landmarks = targets.deformed(mp, targets.waves(mp, 0.08, 3))
    turn = targets.similarity(130, 2.0)
    turned = pt.Boundary([[c.with_control_points(turn(c.control_points)) for c in loop] for loop in bent.loops])
    rows = np.column_stack([landmarks[:, :2], turn(landmarks[:, 2:])])
    before, after = (register(mp.boundary().loops, *given).mismatch for given in ((bent, landmarks), (turned, rows)))
    assert before == pytest.approx(after, rel=1e-5)
    assert min(before) > 0.01


# --- the probability ------------------------------------------------------------------------------


def test_confidence_is_a_probability_that_falls_with_what_speaks_against():
    turned = [confidence(Mismatch(x, 0.0, 0.0), 0.5, 4) for x in (0.0, 0.3, 1.0, 3.0)]
    assert all(a > b for a, b in pairwise(turned))
    assert 0.9 < turned[0] < 1
    assert 0 < turned[-1] < turned[0] - 0.3
    assert confidence(NONE, 0.9, 4) > confidence(NONE, 0.0, 4) > confidence(NONE, 0.0, 0)
    assert traits(NONE, 0.0, 4) == traits(NONE, 0.0, 40)
    # By hand.
    exponent = RIGHT[0] + RIGHT[1] * np.log(0.55) + RIGHT[2] * 0.25 + RIGHT[3] * 0.5
    assert confidence(Mismatch(0.5, 9.0, 9.0), 0.25, 2) == pytest.approx(1 / (1 + np.exp(-exponent)))


def test_symmetric_outlines_are_right_and_ambiguous():
    """Nobody can tell which corner is the first, and nobody minds."""
    registration = register([polygon(SQUARE)], loop(np.roll(SQUARE, 2, axis=0) * 2.0))
    assert registration.margin < 0.05
    assert registration.confidence > 0.9


def test_another_shape_is_rather_wrong_than_right():
    rabbit, (_, human, rows) = examples.load("rabbit")[0], examples.load("human")
    wrong = pt.TransferPlan(rabbit, "c0").register(human)
    right = pt.TransferPlan(examples.load("human")[0], "c0").register(human)
    assert wrong.confidence < DOUBTFUL < 0.7 < right.confidence
    assert "rather wrong than right" in wrong.warnings[0]
    assert right.doubts == []
    sure = pt.TransferPlan(examples.load("human")[0], "c0").register(human, rows)
    assert (sure.confidence, sure.doubts, sure.by_shape) == (1.0, [], False)


# --- what to expect -------------------------------------------------------------------------------


@pytest.mark.parametrize("table", [MEAN, MINIMUM])
def test_constants_are_of_three_quantiles(table):
    assert list(table) == [0.1, 0.5, 0.9]
    assert {len(row) for row in table.values()} == {1 + len(Mismatch._fields)}


@pytest.mark.parametrize("mean", [0.7, 0.95, 1.0])
@pytest.mark.parametrize("size", [0.0, 0.2, 1.0, 2.0])
def test_quantiles_are_in_order_and_between_0_and_1(mean, size):
    found = expected(Mismatch(size, size, size / 4), mean, mean / 2)
    for quantiles in found:
        assert 0 < quantiles.low <= quantiles.median <= quantiles.high <= 1


def test_more_mismatch_and_a_worse_source_let_expect_less():
    mild, strong = (expected(Mismatch(x, x, x / 4), 0.95, 0.6) for x in (0.2, 1.0))
    assert strong.mean_scaled_jacobian.median < mild.mean_scaled_jacobian.median
    assert strong.min_scaled_jacobian.median < mild.min_scaled_jacobian.median
    worse = expected(Mismatch(0.2, 0.2, 0.05), 0.95, 0.3)
    assert worse.min_scaled_jacobian.median < mild.min_scaled_jacobian.median
    # By hand.
    grown = distance(0.6) + MINIMUM[0.5] @ np.array([1.0, 0.2, 0.2, 0.05])
    assert mild.min_scaled_jacobian.median == pytest.approx(1 / np.cosh(grown))


def test_what_is_expected_is_expected_before_joints_slide():
    mp = models.plate_with_hole(2, 3)
    target, _ = targets.deformed(mp, targets.bend(mp, 30))
    plan = pt.TransferPlan(mp, "c0")
    before, result = plan.register(target), plan.transfer(target)
    assert before.expected == result.registration.expected
    assert before.confidence == result.registration.confidence
    report = result.to_dict()["registration"]
    assert report["expected"] == before.expected.to_dict()
    assert report["mismatch"] == before.mismatch._asdict()
    assert report["margin"] == before.margin
    json.dumps(report)
    # With landmarks it is worked out when somebody asks.
    given = plan.transfer(target, before.landmarks).registration
    assert given.confidence == 1
    assert given.expected.min_scaled_jacobian.low > 0
    assert replace(given, warnings=()).expected == given.expected


# --- a warning before the work --------------------------------------------------------------------


class Listener:
    """Writes down what it is told, in order."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def __call__(self, stage, step, energy, least) -> None:
        if not step:
            self.told.append(stage)

    def warned(self, text) -> None:
        self.told.append(text)


def test_doubts_are_told_before_the_work():
    rabbit, human = examples.load("rabbit")[0], examples.load("human")[1]
    listener = Listener()
    result = pt.transfer(rabbit, human, continuity="c0", progress=listener, on_failure="return", time_limit=1.0)
    doubts = result.registration.doubts
    assert doubts
    for text in doubts:
        assert listener.told.count(text) == result.warnings.count(text) == 1
        assert listener.told.index("registration") < listener.told.index(text) < listener.told.index("fitting")


def test_a_poor_map_is_foreseen():
    found = expected(Mismatch(2.5, 3.0, 0.6), 0.9, 0.3)
    assert found.min_scaled_jacobian.median < POOR
    assert found.doubt.startswith("expected scaled Jacobian: minimum about 0.0")
    assert expected(NONE, 0.95, 0.6).doubt is None


def test_the_command_shows_each_warning_once(tmp_path):
    rabbit, human = examples.load("rabbit")[0], examples.load("human")[1]
    pt.write(rabbit, tmp_path / "rabbit.xml")
    pt.write(human, tmp_path / "human.xml")
    given = ("transfer", tmp_path / "rabbit.xml", tmp_path / "human.xml", "-o", tmp_path / "out.xml", "-v")
    result = run(*given, "--continuity", "c0", "--time-limit", 1, "--keep-uncertified")
    lines = result.stderr.splitlines()
    doubt = next(k for k, line in enumerate(lines) if "rather wrong than right" in line)
    assert lines[doubt].startswith("warning: ")
    assert sum("rather wrong than right" in line for line in lines) == 1
    assert doubt < next(k for k, line in enumerate(lines) if line.startswith("fitting"))


def test_a_library_does_not_warn_of_candidates(capsys):
    shelf, listener = pt.Library({name: examples.load(name)[0] for name in ("rabbit", "human")}), Listener()
    ranked = shelf.rank(examples.load("human")[1], progress=listener)
    assert ranked[0].expected > ranked[1].expected
    assert not any("rather wrong" in text for text in listener.told)
