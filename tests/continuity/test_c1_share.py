"""The share of C1: as an independent measure has it, reached by knots where asked for, and told where it is low."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import models
import patchtransfer as pt
import smoothness
import targets
from patchtransfer import examples
from patchtransfer.cli import main
from patchtransfer.errors import InputError


def bent(source: pt.MultiPatch, angle: float = 30) -> tuple[pt.Boundary, np.ndarray]:
    return targets.deformed(source, targets.bend(source, angle))


@pytest.mark.parametrize("name", models.ALL)
@pytest.mark.parametrize("continuity", ["c0", "c1"])
def test_shares_are_those_of_an_independent_measure(name, continuity):
    source = models.ALL[name]()
    result = pt.transfer(source, *bent(source), continuity, on_failure="return")
    spans = smoothness.spans(result.multipatch)
    found = result.continuity
    assert found.c1_share == pytest.approx(smoothness.share(spans), abs=2e-3)
    for i, interface in enumerate(found.interfaces):
        assert interface.c1_share == pytest.approx(smoothness.share([s for s in spans if s.interface == i]), abs=2e-3)
        assert (interface.c1_share < 1) == bool(interface.c1_obstacles)
    assert found.c1_share + sum(found.c1_obstacles.values()) == pytest.approx(1.0)


def test_reasons_tell_what_is_in_the_way():
    star = models.star(5, 3, 4)
    found = pt.transfer(star, *bent(star)).continuity
    assert set(found.c1_obstacles) <= {
        "extraordinary vertices",
        "corners of the boundary",
        "boundary joints where speeds of the sides differ",
        "rows relaxed beside extraordinary ones",
    }
    assert "extraordinary vertices" in found.interfaces[0].c1_obstacles
    linear = models.grid(2, 2, 1, 2)
    flat = pt.transfer(linear, *bent(linear)).continuity
    assert set(flat.c1_obstacles) == {"patches of degree 1"}
    single = pt.MultiPatch([linear.patches[0]])
    assert pt.check_continuity(single).c1_share == 1.0
    content = found.to_dict()
    assert content["c1_share"] == found.c1_share
    assert content["interfaces"][0]["c1_obstacles"] == list(found.interfaces[0].c1_obstacles)


def test_shares_do_not_depend_on_where_and_how_large_a_model_is():
    star = models.star(5, 3, 4)
    result = pt.transfer(star, *bent(star)).multipatch
    share = pt.check_continuity(result).c1_share
    for factor, shift in ((1e-3, 0.0), (1e3, 1e6), (1.0, 1e5)):
        moved = result.with_shared_points(factor * result.topology.coordinates + shift)
        assert pt.check_continuity(moved).c1_share == pytest.approx(share, abs=1e-9)


@pytest.mark.parametrize("name", ["star", "wrench", "two-hole-plate"])
def test_knots_bring_the_share_that_is_asked_for(name):
    source, target, landmarks = examples.load(name)
    plan = pt.TransferPlan(source)
    before = plan.transfer(target, landmarks)
    after = plan.transfer(target, landmarks, c1_share=0.8)
    assert after.certificate.injective
    assert after.refined
    assert before.continuity.c1_share < 0.8 <= after.continuity.c1_share
    assert smoothness.share(smoothness.spans(after.multipatch)) >= 0.8 - 2e-3
    # The boundary is the same curve, with more knots.
    assert after.boundary_error == pytest.approx(before.boundary_error, rel=1e-6)
    assert any("for C1 across patches, knots in" in w for w in after.warnings)


def test_a_share_that_is_there_already_costs_nothing():
    source, target, landmarks = examples.load("wrench")
    plan = pt.TransferPlan(source)
    before = plan.transfer(target, landmarks)
    easy = plan.transfer(target, landmarks, c1_share=before.continuity.c1_share - 1e-3)
    assert not easy.refined
    np.testing.assert_array_equal(easy.multipatch.topology.coordinates, before.multipatch.topology.coordinates)


def test_what_stops_the_share_is_told():
    linear = models.grid(2, 2, 1, 2)
    result = pt.transfer(linear, *bent(linear), c1_share=0.9)
    (note,) = [w for w in result.warnings if "c1_share=0.9 is not reached" in w]
    assert "degree 1" in note
    assert not result.refined
    star = models.star(5, 3, 2)
    whole = pt.transfer(star, *bent(star), c1_share=1.0, on_failure="return")
    assert any("c1_share=1 is not reached" in w and "extraordinary vertices" in w for w in whole.warnings)


def test_a_low_share_names_the_option():
    source, target, landmarks = examples.load("star")
    assert any("--c1-share" in w for w in pt.transfer(source, target, landmarks).warnings)
    assert not any("c1-share" in w for w in pt.transfer(source, target, landmarks, "c0").warnings)
    wrench = examples.load("wrench")
    assert not any("c1-share" in w for w in pt.transfer(*wrench).warnings)


def test_the_command_has_the_option(tmp_path):
    source, target, _ = examples.load("star")
    given = [str(tmp_path / name) for name in ("s.xml", "t.xml", "o.xml", "r.json")]
    pt.write(source, given[0])
    pt.write(target, given[1])
    run = CliRunner().invoke(
        main, ["transfer", *given[:2], "-o", given[2], "--c1-share", "0.7", "--ratios", "source", "--json", given[3]]
    )
    assert run.exit_code == 0, run.output
    assert "C1 across patches" in run.output
    content = json.loads((tmp_path / "r.json").read_text())
    assert content["continuity"]["c1_share"] >= 0.7
    assert pt.check_continuity(pt.read(given[2])).c1_share >= 0.7 - 1e-6


@pytest.mark.parametrize("share", [0, -1, 1.5, float("nan"), "0.9"])
def test_shares_that_are_none(share):
    mp = models.grid(2, 2, 2, 2)
    with pytest.raises(InputError, match="c1_share must lie"):
        pt.transfer(mp, mp.boundary(), c1_share=share)


@pytest.mark.parametrize(("continuity", "method"), [("c0", "certified"), ("c1", "paper")])
def test_shares_where_they_mean_nothing(continuity, method):
    mp = models.grid(2, 2, 2, 2)
    with pytest.raises(InputError, match="c1_share"):
        pt.transfer(mp, mp.boundary(), None, continuity, method, c1_share=0.9)


def test_the_picture_has_every_span_once():
    source, target, landmarks = examples.load("wrench")
    result = pt.transfer(source, target, landmarks).multipatch
    ax = pt.plot.c1_spans(result).axes[0]
    drawn = {c.get_label(): len(c.get_segments()) for c in ax.collections if not c.get_label().startswith("_")}
    spans = smoothness.spans(result)
    assert drawn == {"C1": sum(s.smooth for s in spans), "not C1": sum(not s.smooth for s in spans)}
