"""Searches end: at once where no proof is possible, by a budget of work, and by the user's time limit."""

import json
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import models
import patchtransfer as pt
import targets
from failing import hopeless
from patchtransfer import InputError, MultiPatch, NotCertifiedError, io, progress
from patchtransfer.batch import BatchOptions, run_batch
from patchtransfer.cli import main
from patchtransfer.continuity.interfaces import control_rows
from patchtransfer.continuity.rows import C1Rows
from patchtransfer.interior.optimizer import SplineOptimizer, step_cost
from patchtransfer.interior.under_rows import optimize_under_rows
from patchtransfer.pipeline.posed import Registered, no_proof
from patchtransfer.progress import Budget
from patchtransfer.proof.certificate import check_boundary


def touching() -> tuple[MultiPatch, np.ndarray]:
    """Shared points of a strip whose long sides touch in the middle."""
    mp = models.strip(4, 2, 2)
    points = mp.topology.coordinates.copy()
    points[:, 1] = 0.5 + (points[:, 1] - 0.5) * np.abs(points[:, 0] - 2) / 2
    return mp, points


class Counted:
    """Newton steps by stage."""

    def __init__(self) -> None:
        self.stages: list[str] = []

    def __call__(self, stage: str, step: int, energy: float, least: float) -> None:
        # Stages that begin are told of with step 0.
        if step:
            self.stages.append(stage)


# --- boundaries that rule a proof out -------------------------------------------------------------


@pytest.mark.parametrize("continuity", ["c0", "c1"])
@pytest.mark.parametrize("refine", ["never", "auto"])
def test_a_touching_target_is_not_optimised_for_long(continuity, refine):
    mp, points = touching()
    moved = mp.with_shared_points(points)
    loops = [[side.curve(moved.patches) for side in loop] for loop in mp.topology.loops]
    landmarks = [
        [*side.curve(mp.patches).start, *side.curve(moved.patches).start] for loop in mp.topology.loops for side in loop
    ]
    target, counted = pt.Boundary(loops), Counted()
    assert check_boundary(target.loops).simple is None
    with pytest.raises(NotCertifiedError) as failure:
        pt.transfer(mp, target, landmarks, continuity, progress=counted, refine=refine)
    result = failure.value.result
    assert not result.certificate.injective
    # One map that illustrates, of the source and of the refined one; no harder rungs, no rows.
    assert set(counted.stages) == {"optimise"}
    assert len(counted.stages) <= 200 * (1 + (refine == "auto"))
    for text in (str(failure.value), result.log[-1]):
        assert "no proof is possible, whatever the inside: target boundary: boundary loop 0 touches or nearly" in text
        assert "at (2, 0.5): curve" in text
        assert "separate the curves there" in text
    assert "--refine" not in str(failure.value)
    assert result.fit_failed


def test_a_refill_of_a_touching_boundary_ends_with_the_place():
    mp, points = touching()
    counted = Counted()
    found = pt.TransferPlan(mp, "c1").refill(points, counted)
    assert not found.certificate.injective
    assert 0 < len(counted.stages) <= 200
    assert found.log[-1].startswith("no proof is possible, whatever the inside: boundary: boundary loop 0 touches")
    assert len(found.log) == 2


def test_a_fit_that_touches_asks_for_knots():
    """The target is proved simple, but the curves that the source's knots allow are not."""
    mp, points = touching()
    registration = pt.transfer(mp, mp.boundary()).registration
    report = check_boundary(
        [[side.curve(mp.with_shared_points(points).patches) for side in loop] for loop in mp.topology.loops]
    )
    text = no_proof(report, Registered(registration, None)).reason
    assert "fitted boundary: boundary loop 0 touches" in text
    assert text.endswith("the source's knots are too coarse for the target there")


# --- the budget -----------------------------------------------------------------------------------


def test_work_is_counted_in_nodes():
    mp = models.grid(2, 3)
    spans = sum((len(np.unique(p.knots[0])) - 1) * (len(np.unique(p.knots[1])) - 1) for p in mp.patches)
    assert step_cost(mp.patches) == spans * 5**2
    assert step_cost(mp.patches, 4) == spans * 9**2
    assert step_cost(mp.patches, 2, [(0, 0.1, 0.2)] * 10) == spans * 5**2 + 10 * 2 * 9
    assert SplineOptimizer(mp.topology, nodes_per_degree=4).step_cost == step_cost(mp.patches, 4)
    small, large = Budget.of_source(1.0), Budget.of_source(1e6)
    assert small.work == progress.WORK
    assert large.work == 1e6 * progress.STEPS
    half = large.part(0.5)
    assert half.steps(1e6, 10**9) == progress.STEPS / 2
    half.spend(half.work - 2.5e6)
    assert (half.steps(1e6, 200), half.steps(1e6, 1), half.steps(3e6, 200)) == (2, 1, 0)
    half.renew()
    assert half.steps(1e6, 200) == 200
    assert half.seconds_left() is None


@pytest.mark.parametrize("continuity", ["c0", "c1"])
def test_a_transfer_without_hope_keeps_to_its_budget(continuity, monkeypatch):
    mp, target, landmarks = hopeless()
    cost, counted, steps = step_cost(mp.patches), Counted(), 300
    monkeypatch.setattr(progress, "WORK", 0.0)
    monkeypatch.setattr(progress, "STEPS", steps)
    with pytest.raises(NotCertifiedError, match="stopped by the budget of Newton steps") as failure:
        pt.transfer(mp, target, landmarks, continuity, refine="never", progress=counted)
    result = failure.value.result
    assert result.log[-1] in result.warnings
    # Every step costs at least one of the source's own; the first rungs are free, 200 at most.
    assert len(counted.stages) <= steps + 200 * (1 if continuity == "c0" else 5)
    again, unlimited = Counted(), Counted()
    with pytest.raises(NotCertifiedError) as second:
        pt.transfer(mp, target, landmarks, continuity, refine="never", progress=again)
    assert second.value.result.log == result.log
    assert again.stages == counted.stages
    monkeypatch.undo()
    with pytest.raises(NotCertifiedError):
        pt.transfer(mp, target, landmarks, continuity, refine="never", progress=unlimited)
    assert len(unlimited.stages) > len(counted.stages)
    assert cost > 0


@pytest.mark.parametrize("proved", [False, True])
def test_a_certified_map_with_collapsed_corners_is_kept_for_want_of_another(proved):
    """It renews the budget, and is the result where neither fewer rows nor the map without any are certified."""
    mp = models.strip(2, 3, 3)
    t, reference = mp.topology, mp.topology.coordinates
    flat = reference.copy()
    across = t.interior_points[np.abs(reference[t.interior_points, 0] - 1) < 0.1]
    flat[across, 0] += 0.6 * np.abs(reference[across, 1] - 0.5)
    work, tries = Budget(1e6), []

    def solve(space, start):
        tries.append(work.work_left)
        work.spend(8e5)
        return (flat if len(tries) == 1 else reference), SimpleNamespace(injective=len(tries) == 1, cells=()), ["tried"]

    points, certificate, log, rows = optimize_under_rows(
        t,
        partial(C1Rows(t, control_rows(t)), reference),
        solve,
        reference,
        lambda _: SimpleNamespace(injective=proved, cells=()),
        rounds=1,
        budget=work,
    )
    assert tries == [1e6, 1e6]
    assert any(entry.startswith("corners collapse") for entry in log)
    assert certificate.injective
    assert np.array_equal(points, reference if proved else flat)
    warned = any("corners are nearly flat under continuity rows at 2" in text for text in rows.warnings(mp))
    assert warned == (rows.collapsed == 2) == (not proved)
    assert rows.to_dict()["collapsed"] == rows.collapsed


# --- the time limit -------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [0, -1.0, float("nan"), "5"])
def test_limits_that_are_none_are_refused(bad, tmp_path):
    mp = models.strip(2, 2, 1)
    with pytest.raises(InputError, match="time_limit must be a positive number of seconds"):
        pt.transfer(mp, mp.boundary(), time_limit=bad)
    io.write(mp, tmp_path / "source.xml")
    with pytest.raises(InputError, match="time_limit"):
        run_batch(tmp_path / "source.xml", [tmp_path / "t.csv"], tmp_path / "out", BatchOptions(time_limit=bad))


@pytest.mark.parametrize("continuity", ["c0", "c1"])
@pytest.mark.parametrize("refine", ["never", "auto"])
def test_a_time_limit_ends_the_search_with_what_there_is(continuity, refine):
    mp, target, landmarks = hopeless()
    counted = Counted()
    with pytest.raises(NotCertifiedError, match=r"stopped by the time limit of 1e-09 s") as failure:
        pt.transfer(mp, target, landmarks, continuity, progress=counted, refine=refine, time_limit=1e-9)
    result = failure.value.result
    assert "stopped by the time limit of 1e-09 s" in result.warnings
    # A step is begun before the clock is looked at: of the map without rows, rough or not.
    assert counted.stages == ["optimise"]
    plan = pt.TransferPlan(mp, continuity)
    results = list(
        plan.map([(target, landmarks), mp.boundary()], on_failure="return", time_limit=1e-9, fixed_correspondence=True)
    )
    assert [r.certificate.injective for r in results] == [False, True]
    # The harmonic map is certified: cut, but proved.
    assert "stopped by the time limit of 1e-09 s" in results[1].warnings


def test_sliding_honours_the_time_limit():
    mp = models.o_grid(3, 2)
    result = pt.transfer(mp, pt.Boundary(targets.deformed(mp, targets.bend(mp, 40))[0].loops), time_limit=1e-9)
    assert "stopped by the time limit of 1e-09 s" in result.warnings
    assert result.sliding is None or len(result.sliding.energies) <= 1
    assert result.stopped in result.warnings


def test_the_published_method_honours_the_time_limit():
    mp = models.o_grid(3, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 40))
    options = {"method": "paper", "on_failure": "return"}
    whole = pt.transfer(mp, target, landmarks, "c0", **options)
    cut = pt.transfer(mp, target, landmarks, "c0", **options, time_limit=1e-9)
    assert "stopped by the time limit of 1e-09 s" in cut.warnings
    history, full = cut.paper_history, whole.paper_history
    assert len(history.reversible_energy) == 1 < len(full.reversible_energy)
    assert history.descent_stop == "time limit"
    assert len(history.descent_energy) == 1 < len(full.descent_energy)


@pytest.mark.parametrize("method", ["certified", "paper"])
def test_a_generous_limit_changes_nothing(method):
    mp = models.o_grid(3, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 40))
    free, limited = (pt.transfer(mp, target, landmarks, method=method, time_limit=s) for s in (None, 1e300))
    assert free.warnings == limited.warnings
    for a, b in zip(free.multipatch.patches, limited.multipatch.patches, strict=True):
        np.testing.assert_array_equal(a.control_points, b.control_points)


def test_coarser_spaces_are_not_lost_when_the_time_is_over():
    """A large model ends on what its coarser spaces gave, not where it began."""
    mp = models.o_grid(3, 16)
    t, optimizer = mp.topology, SplineOptimizer(mp.topology)
    x = t.coordinates.copy()
    x[t.boundary_points] = targets.bend(mp, 60)(x[t.boundary_points])
    start = optimizer.harmonic(x)
    found = optimizer.minimise(start, seconds=0.0)
    assert found.stop == "time limit"
    assert len(found.history) == 0
    assert found.energy <= optimizer.minimise(start, max_steps=0).energy


# --- command line and batch -----------------------------------------------------------------------


@pytest.fixture
def files(tmp_path):
    """A source with a target that it is certified on within any limit, and one without hope."""
    mp, target, landmarks = hopeless()
    io.write(mp, tmp_path / "source.xml")
    for name, boundary, rows in (
        ("hard", target, landmarks),
        ("easy", mp.boundary(), [[*c.start, *c.start] for loop in mp.boundary().loops for c in loop]),
    ):
        # A single patch per side would be another model: boundaries are read from rings of ruled patches.
        lines = ["x,y"]
        for curve in boundary.loops[0]:
            s = np.linspace(*curve.domain, 41)[:-1]
            lines += [f"{float(x)!r},{float(y)!r}" for x, y in curve(s)]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
        table = "\n".join(",".join(repr(float(v)) for v in row) for row in rows)
        (tmp_path / f"{name}.landmarks.csv").write_text("xs,ys,xt,yt\n" + table + "\n")
    return tmp_path


def test_exit_statuses_of_the_command(files):
    def run(name: str, limit: str, *more: str):
        arguments = ["transfer", str(files / "source.xml"), str(files / f"{name}.csv"), "-o", str(files / "out.xml")]
        arguments += ["--landmarks", str(files / f"{name}.landmarks.csv"), "--time-limit", limit, *more]
        return CliRunner().invoke(main, arguments)

    cut = run("hard", "1e-9")
    assert cut.exit_code == 1
    assert "stopped by the time limit of 1e-09 s" in " ".join(cut.stderr.split())
    assert not (files / "out.xml").exists()
    kept = run("hard", "1e-9", "--keep-uncertified", "--json", str(files / "r.json"))
    assert kept.exit_code == 1
    assert "stopped by the time limit of 1e-09 s" in json.loads((files / "r.json").read_text())["warnings"]
    certified = run("easy", "1e-9")
    assert certified.exit_code == 0
    assert "stopped by the time limit of 1e-09 s" in " ".join(certified.stderr.split())
    for bad in ("0", "-3", "nan", "soon"):
        assert run("easy", bad).exit_code == 2


def test_rows_of_a_batch(files):
    targets_ = [files / "hard.csv", files / "easy.csv"]
    rows = run_batch(files / "source.xml", targets_, files / "out", BatchOptions(time_limit=1e-9))
    assert [row.ok for row in rows] == [False, True]
    assert "stopped by the time limit of 1e-09 s" in rows[0].error
    report = json.loads((files / "out" / "easy.report.json").read_text())
    assert "stopped by the time limit of 1e-09 s" in report["warnings"]
    # Another limit is another run.
    rows = run_batch(files / "source.xml", targets_[1:], files / "out", BatchOptions())
    assert not rows[0].skipped
    arguments = ["batch", str(files / "source.xml"), str(targets_[1]), "-o", str(files / "out"), "--workers", "1"]
    assert CliRunner().invoke(main, [*arguments, "--time-limit", "nan"]).exit_code == 2
    assert CliRunner().invoke(main, [*arguments, "--time-limit", "100"]).exit_code == 0
