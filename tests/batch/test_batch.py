import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

import models
import patchtransfer as pt
import targets
from failing import SLOT, notched
from patchtransfer import InputError, TransferPlan
from patchtransfer.batch import BatchOptions, run_batch
from patchtransfer.cli import main


def put(folder, name, mp, f, landmarks=True):
    target, marks = targets.deformed(mp, f)
    pt.write(target, folder / f"{name}.xml")
    if landmarks:
        np.savetxt(folder / f"{name}.landmarks.csv", marks, delimiter=",", header="xs,ys,xt,yt", comments="")
    return folder / f"{name}.xml"


@pytest.fixture
def case(tmp_path):
    """A source and three targets, one of them broken."""
    mp = models.grid(2, 1, 2, 2)
    pt.write(mp, tmp_path / "source.xml")
    good = [put(tmp_path, name, mp, targets.bend(mp, angle)) for name, angle in (("a", 20), ("b", -30))]
    (tmp_path / "broken.xml").write_text("<xml")
    return tmp_path, tmp_path / "source.xml", [good[0], tmp_path / "broken.xml", good[1]]


def stamps(folder):
    return {p.name: p.stat().st_mtime_ns for p in folder.iterdir()}


def test_failures_are_isolated_and_explained(case):
    folder, source, files = case
    rows = run_batch(source, files, folder / "out")
    assert [row.ok for row in rows] == [True, False, True]
    assert [row.status for row in rows] == ["certified", "failed", "certified"]
    assert "malformed" in rows[1].error
    assert rows[0].landmarks
    assert not rows[0].skipped
    assert {p.name for p in (folder / "out").iterdir()} == {
        "a.xml",
        "a.report.json",
        "b.xml",
        "b.report.json",
        "broken.report.json",
    }
    assert pt.certify(pt.read(folder / "out/a.xml")).injective
    report = json.loads((folder / "out/a.report.json").read_text())
    assert report["quality"]["scaled_jacobian"]["min"] == rows[0].min_scaled_jacobian
    assert json.loads((folder / "out/broken.report.json").read_text())["error"] == rows[1].error
    # The same as one by one.
    direct = pt.transfer(pt.read(source), pt.read_boundary(files[2]), pt.read_landmarks(folder / "b.landmarks.csv"))
    assert pt.read(folder / "out/b.xml").patches == direct.multipatch.patches


def test_finished_targets_are_skipped(case):
    folder, source, files = case
    out = folder / "out"
    first = run_batch(source, files, out)
    before = stamps(out)
    again = run_batch(source, files, out)
    assert [row.skipped for row in again] == [True, False, True]
    assert [row.min_scaled_jacobian for row in again] == [row.min_scaled_jacobian for row in first]
    after = stamps(out)
    assert {n for n in after if after[n] != before[n]} == {"broken.report.json"}
    assert not any(row.skipped for row in run_batch(source, files, out, force=True))


@pytest.mark.parametrize(
    "change",
    ["target", "landmarks", "landmarks removed", "source", "options", "output", "output removed", "report", "version"],
)
def test_whatever_a_result_depends_on_counts(case, change, monkeypatch):
    folder, source, files = case
    out, options = folder / "out", BatchOptions()
    run_batch(source, files, out, options)
    mp = pt.read(source)
    if change == "target":
        put(folder, "a", mp, targets.bend(mp, 25))
    elif change == "landmarks":
        with (folder / "a.landmarks.csv").open("a") as stream:
            stream.write("# another look\n")
    elif change == "landmarks removed":
        (folder / "a.landmarks.csv").unlink()
    elif change == "source":
        pt.write(models.grid(2, 1, 2, 3), source)
    elif change == "options":
        options = BatchOptions(fit_tolerance=2e-3)
    elif change == "output":
        (out / "a.xml").write_text((out / "a.xml").read_text() + "\n")
    elif change == "output removed":
        (out / "a.xml").unlink()
    elif change == "report":
        (out / "a.report.json").write_text("{}")
    else:
        monkeypatch.setattr("patchtransfer.batch.__version__", "99")
    rows = run_batch(source, files, out, options)
    assert not rows[0].skipped
    assert rows[0].ok
    assert rows[2].skipped == (change not in ("source", "options", "version"))
    assert run_batch(source, files, out, options)[0].skipped


def test_a_failure_leaves_no_stale_result(case):
    folder, source, files = case
    out = folder / "out"
    run_batch(source, files, out)
    files[0].write_text("<xml")
    rows = run_batch(source, files, out)
    assert not rows[0].ok
    assert not (out / "a.xml").exists()
    # A file that no batch has written is not touched.
    (out / "broken.report.json").unlink()
    (out / "broken.xml").write_text("mine")
    run_batch(source, files, out)
    assert (out / "broken.xml").read_text() == "mine"


def test_uncertified_maps_are_kept_on_request(tmp_path):
    # Feasible, but the source's knots cannot follow the slot.
    mp, target, landmarks = notched(*SLOT, spans=3)
    pt.write(mp, tmp_path / "source.xml")
    pt.write(target, tmp_path / "hard.xml")
    np.savetxt(tmp_path / "hard.landmarks.csv", landmarks, delimiter=",", header="xs,ys,xt,yt", comments="")
    case = tmp_path / "source.xml", [tmp_path / "hard.xml"]
    (row,) = run_batch(*case, tmp_path / "out", BatchOptions(refine="never"))
    assert not row.ok
    assert row.output is None
    assert "knots cannot" in row.error
    assert not (tmp_path / "out/hard.xml").exists()
    options = BatchOptions(keep_uncertified=True, refine="never")
    (kept,) = run_batch(*case, tmp_path / "kept", options)
    assert not kept.ok
    assert kept.error
    assert not pt.certify(pt.read(tmp_path / "kept/hard.xml")).injective
    assert not run_batch(*case, tmp_path / "kept", options)[0].skipped
    (refined,) = run_batch(*case, tmp_path / "refined")
    assert refined.ok
    assert refined.refined


def test_processes_give_the_same(case):
    folder, source, files = case
    seen = []
    rows = run_batch(source, files, folder / "two", workers=2, progress=seen.append)
    one = run_batch(source, files, folder / "one")
    assert sorted(row.target for row in seen) == sorted(map(str, files))
    assert [(r.target, r.status, r.min_scaled_jacobian) for r in rows] == [
        (r.target, r.status, r.min_scaled_jacobian) for r in one
    ]
    for name in ("a.xml", "b.xml"):
        assert (folder / "one" / name).read_bytes() == (folder / "two" / name).read_bytes()


class Panic(BaseException):
    """As the core's, no subclass of Exception."""


@pytest.mark.parametrize("error", [Panic("at the disco"), ZeroDivisionError("by zero"), MemoryError()])
def test_unexpected_errors_are_isolated_too(case, monkeypatch, error):
    folder, source, files = case
    original = TransferPlan.transfer

    def failing(self, target, landmarks=None, **options):
        if landmarks is None:
            raise error
        return original(self, target, landmarks, **options)

    monkeypatch.setattr(TransferPlan, "transfer", failing)
    (folder / "b.landmarks.csv").unlink()
    rows = run_batch(source, [files[0], files[2]], folder / "out")
    assert [row.ok for row in rows] == [True, False]
    assert type(error).__name__ in rows[1].error


def test_bad_input(case):
    folder, source, files = case
    with pytest.raises(InputError, match="same name"):
        run_batch(source, [files[0], folder / "other" / "a.svg"], folder / "out")
    with pytest.raises(InputError, match="would replace an input"):
        run_batch(source, files, folder)
    with pytest.raises(InputError, match="workers"):
        run_batch(source, files, folder / "out", workers=0)
    with pytest.raises(InputError, match="fit_tolerance"):
        run_batch(source, files, folder / "out", BatchOptions(fit_tolerance=2.0))
    with pytest.raises(InputError, match="no targets"):
        run_batch(source, [folder / "a.landmarks.csv"], folder / "out")
    with pytest.raises(InputError, match="no such file"):
        run_batch(folder / "missing.xml", files, folder / "out")
    assert not (folder / "out").exists()


# --- command line ---------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(main, ["batch", *map(str, arguments)])


def test_command(case):
    folder, source, files = case
    out = folder / "out"
    # As the shell gives it: landmarks are among the names.
    names = sorted(p for p in folder.iterdir() if p != source)
    result = run(source, *names, "-o", out, "--workers", 1)
    assert result.exit_code == 1
    assert "2 of 3 targets certified, 0 finished before" in result.output
    assert "malformed" in result.output
    with (out / "summary.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["status"] for row in rows] == ["certified", "certified", "failed"]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["certified"] == 2
    assert [row["target"] for row in summary["targets"]] == [row["target"] for row in rows]
    good = [files[0], files[2]]
    result = run(source, *good, "-o", out, "--workers", 1)
    assert result.exit_code == 0
    assert "2 finished before" in result.output
    result = run(source, *good, "-o", out, "--workers", 1, "--force")
    assert "0 finished before" in result.output


def test_command_with_a_bad_source(case):
    folder, _, files = case
    result = run(folder / "broken.xml", *files, "-o", folder / "out")
    assert result.exit_code == 2
    assert "malformed" in result.output
    assert not (folder / "out").exists()
    assert run(folder / "source.xml", "-o", folder / "out").exit_code == 2


def test_an_interrupted_batch_resumes(case, monkeypatch):
    folder, source, files = case
    original, calls = TransferPlan.transfer, []

    def interrupted(self, *args, **kwargs):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return original(self, *args, **kwargs)

    good = [files[0], files[2]]
    monkeypatch.setattr(TransferPlan, "transfer", interrupted)
    result = run(source, *good, "-o", folder / "out", "--workers", 1)
    assert result.exit_code == 130
    assert "resume" in result.output
    result = run(source, *good, "-o", folder / "out", "--workers", 1)
    assert result.exit_code == 0
    assert "1 finished before" in result.output
