"""Polish: proved numbers that only get better, under the rows, by a second route at dense samples."""

import json
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import targets
from commands import arguments, inputs_of_transfer, run
from patchtransfer.interior.polish_report import GOALS, PolishReport

GOAL = pytest.mark.parametrize("goal", GOALS)


def plate() -> pt.MultiPatch:
    return models.plate_with_hole(3, 2)


def bent(mp: pt.MultiPatch, degrees: float, seed: int = 0) -> tuple[pt.Boundary, np.ndarray]:
    return targets.deformed(mp, targets.bend(mp, degrees), seed=seed)


def number(result: pt.TransferResult, source: pt.MultiPatch, goal: str) -> float:
    """What was asked for, measured anew."""
    if goal == "dilatation":
        return pt.similarity(source, result.multipatch).dilatation.upper
    return pt.quality(result.multipatch, proved=True).proved.min_scaled_jacobian.lower


def better(goal: str, after: float, before: float) -> bool:
    return after >= before if goal == "scaled_jacobian" else after <= before


@GOAL
@pytest.mark.parametrize("continuity", ["c0", "c1", "g1"])
def test_what_was_asked_for_gets_better_under_the_same_rows(goal, continuity):
    mp = models.plate_with_hole(3, 3).reduce_continuity(1) if continuity == "g1" else plate()
    target, landmarks = bent(mp, 60)
    plan = pt.TransferPlan(mp, continuity)
    plain, polished = (plan.transfer(target, landmarks, polish=wanted) for wanted in (None, goal))
    assert polished.certificate.status == "certified"
    assert plain.polish is None
    report = polished.polish
    assert report.goal == goal
    # Exact G1 fixes all frames at the vertices, where the worst places are.
    assert report.power > 1 or continuity == "g1"
    assert report.before == number(plain, mp, goal)
    assert report.after == number(polished, mp, goal)
    assert better(goal, report.after, report.before)
    on = mp.topology.boundary_points
    before, after = (x.multipatch.topology.coordinates for x in (plain, polished))
    assert np.array_equal(before[on], after[on])
    if continuity != "c0":
        assert polished.rows.active == plain.rows.active
        assert polished.rows.residual < 1e-9
        # By another route: the rows of the plain map, applied to the polished one.
        assert plain.rows.space.residual(after) < 1e-9 * mp.diameter


@settings(max_examples=15)
@given(st.sampled_from(GOALS), st.floats(-80, 80), st.integers(0, 10**6), st.sampled_from(["c0", "c1"]))
def test_no_target_gets_worse(goal, degrees, seed, continuity):
    mp = plate()
    target, landmarks = bent(mp, degrees + 1e-3, seed)
    plan = pt.TransferPlan(mp, continuity)
    plain, polished = (plan.transfer(target, landmarks, polish=wanted, on_failure="return") for wanted in (None, goal))
    assert polished.certificate.injective == plain.certificate.injective
    if plain.certificate.injective:
        assert better(goal, number(polished, mp, goal), number(plain, mp, goal))


def test_polished_scaled_jacobians_hold_at_dense_samples():
    mp = plate()
    result = pt.transfer(mp, *bent(mp, 75), polish="scaled_jacobian")
    assert pt.quality(result.multipatch, samples=60).scaled_jacobian.min >= result.polish.after


def test_a_dilatation_can_reach_what_no_map_is_below():
    mp = models.strip(2, 3, 3)
    target, landmarks = bent(mp, 40)
    result = pt.transfer(mp, target, landmarks, "c0", polish="dilatation")
    least = math.exp(result.dilatation.least.best)
    assert least * (1 - 1e-9) <= result.polish.after <= result.polish.before
    assert result.polish.after < 1.01 * least


@pytest.mark.parametrize(("turn", "scale", "shift"), [(90, 1.0, 0.0), (33, 40.0, 0.0), (10, 1.0, 1e5)])
def test_motions_of_the_target_do_not_matter(turn, scale, shift):
    mp = plate()
    target, landmarks = bent(mp, 60)
    motion = targets.similarity(turn, scale)

    def moved(x: np.ndarray) -> np.ndarray:
        return motion(x) + shift

    there = pt.Boundary(
        [[pt.BSplineCurve(c.knots, c.degree, moved(c.control_points)) for c in loop] for loop in target.loops]
    )
    rows = np.column_stack([landmarks[:, :2], moved(landmarks[:, 2:])])
    a = pt.transfer(mp, target, landmarks, "c0", polish="scaled_jacobian").polish
    b = pt.transfer(mp, there, rows, "c0", polish="scaled_jacobian").polish
    assert b.power == a.power
    assert (b.before, b.after) == pytest.approx((a.before, a.after), rel=2e-3)


def test_joints_that_slid_go_back_where_the_dilatation_is_smaller():
    mp = pt.examples.load("star")[0]
    target, _ = targets.deformed(mp, targets.stretch(1.8, 20))
    plan = pt.TransferPlan(mp, "c0")
    slid, fixed = (
        plan.transfer(target, polish="dilatation", fixed_correspondence=fixed).polish for fixed in (False, True)
    )
    assert slid.after <= fixed.after * (1 + 1e-9)


def test_what_is_best_stays_to_the_bit_and_can_be_frozen():
    mp = plate()
    plan = pt.TransferPlan(mp, "c0")
    joints = np.array([curve.start for loop in mp.boundary().loops for curve in loop])
    rows = np.column_stack([joints, joints])
    plain, polished = (plan.transfer(mp.boundary(), rows, polish=goal) for goal in (None, "dilatation"))
    assert polished.polish.power == 1
    assert np.array_equal(plain.multipatch.topology.coordinates, polished.multipatch.topology.coordinates)
    polished.freeze()


def test_polished_maps_have_no_derivatives():
    mp = plate()
    result = pt.transfer(mp, *bent(mp, 60), polish="scaled_jacobian")
    with pytest.raises(pt.InputError, match="freeze: the map is polished"):
        result.freeze()


def test_what_cannot_be_proved_is_not_polished():
    knots = [0.0] * 16 + [1.0] * 16
    u = np.linspace(0, 1, 16)
    square = pt.MultiPatch([pt.Patch((knots, knots), (15, 15), np.stack(np.meshgrid(u, u, indexing="ij"), axis=-1))])
    result = pt.transfer(square, square.boundary(), continuity="c0", polish="dilatation")
    assert result.polish is None
    assert any("polish='dilatation' is left out" in text for text in result.warnings)


def test_options_say_what_they_may_be():
    mp = plate()
    with pytest.raises(pt.InputError, match="polish must be one of scaled_jacobian, dilatation"):
        pt.transfer(mp, mp.boundary(), polish="best")
    with pytest.raises(pt.InputError, match='polish is for method="certified"'):
        pt.transfer(mp, mp.boundary(), method="paper", polish="dilatation")
    with pytest.raises(pt.InputError, match="polish must be one of scaled_jacobian, None"):
        pt.parameterize(mp.boundary(), polish="dilatation")


def test_reports_are_data(tmp_path):
    mp = plate()
    result = pt.transfer(mp, *bent(mp, 60), polish="dilatation")
    assert PolishReport.from_dict(json.loads(json.dumps(result.to_dict()["polish"]))) == result.polish
    assert pickle.loads(pickle.dumps(result)).polish == result.polish
    infinite = PolishReport("dilatation", 1, math.inf, math.inf)
    assert PolishReport.from_dict(infinite.to_dict()) == infinite


def test_the_command_line_polishes(tmp_path):
    inputs_of_transfer(tmp_path)
    done = run(*arguments(tmp_path, "--polish", "scaled_jacobian", "--json", tmp_path / "r.json"))
    assert done.exit_code == 0, done.output
    assert "polish" in done.output
    found = json.loads((tmp_path / "r.json").read_text())
    assert found["polish"]["after"] >= found["polish"]["before"]
    assert found["polish"]["after"] == found["quality"]["proved"]["min_scaled_jacobian"]["lower"]


def test_parameterizations_lose_nothing():
    outline = pt.examples.load("frame")[1]
    plain, polished = (pt.parameterize(outline, polish=goal) for goal in (None, "scaled_jacobian"))
    assert polished.certificate.status == "certified"
    least = [x.quality.proved.min_scaled_jacobian.lower for x in (plain, polished)]
    mean = [x.quality.scaled_jacobian.mean for x in (plain, polished)]
    assert least[1] > least[0]
    assert mean[1] > mean[0] - 0.003
    assert polished.boundary_error == plain.boundary_error
