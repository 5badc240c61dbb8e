"""`--split auto` of `transfer` and `batch`."""

from __future__ import annotations

import json

import pytest

import models
import patchtransfer as pt
from commands import failed, run
from patchtransfer.batch import BatchOptions, run_batch
from shapes import loop

HOUSE = [(0, 0), (2, -0.6), (4, 0), (4, 1), (2.2, 1.7), (0, 1)]
KINK = [(0, 0), (4, 0), (4, 1), (0.8, 1.5), (0, 1)]


@pytest.fixture
def files(tmp_path):
    """A bar of one patch, and targets with corners along its sides."""
    source = models.build([models.bilinear((0, 0), (4, 0), (4, 1), (0, 1))], 3, 1, 1)
    pt.write(source, tmp_path / "source.xml")
    for name, corners in (("house", HOUSE), ("kink", KINK), ("plain", [(0, 0), (5, 0), (5, 1), (0, 1)])):
        pt.write(loop(corners), tmp_path / f"{name}.xml")
    return tmp_path


def test_a_split_transfer_is_written_and_told(files):
    options = "--split", "auto", "--json", files / "r.json", "--plot", files / "p.png", "--continuity", "c0"
    more = "--plot-registration", files / "q.png"
    result = run("transfer", files / "source.xml", files / "house.xml", "-o", files / "out.xml", *options, *more)
    assert result.exit_code == 0, result.output
    assert "1 -> 2 patches, for 2 corners of the target" in result.output
    assert "the source was split" in result.stderr
    report = json.loads((files / "r.json").read_text())
    assert sorted(report["split"]["corners"]) == [[2, -0.6], pytest.approx([2.2, 1.7])]
    assert [piece["patch"] for piece in report["split"]["origin"]] == [0, 0]
    written = pt.read(files / "out.xml")
    assert len(written) == 2
    assert pt.certify(written).injective


def test_without_it_the_error_names_corners_and_option(files):
    result = run("transfer", files / "source.xml", files / "house.xml", "-o", files / "out.xml", "--refine", "never")
    failed(result, 1, r"--split auto \(split='auto'\).* 2 corners .*\(2, -0\.6\)")
    assert not (files / "out.xml").exists()


def test_a_batch_has_one_source_for_all(files):
    targets = [files / f"{name}.xml" for name in ("house", "kink", "plain", "missing")]
    options = BatchOptions(split="auto")
    rows = run_batch(files / "source.xml", targets, files / "out", options, continuity="c0")
    assert [row.ok for row in rows] == [True, True, True, False]
    results = [pt.read(row.output) for row in rows[:3]]
    assert [row.patches for row in rows[:3]] == [len(results[0])] * 3
    assert len(results[0]) > 2
    for other in results[1:]:
        assert other.interfaces == results[0].interfaces
    split = json.loads((files / "out/plain.report.json").read_text())["split"]
    assert split["corners"] == []
    assert len(split["origin"]) == len(results[0])
    # Finished ones are known again, unless another target asks for other splits.
    assert [
        row.skipped for row in run_batch(files / "source.xml", targets, files / "out", options, continuity="c0")
    ] == [
        True,
        True,
        True,
        False,
    ]
    fewer = run_batch(files / "source.xml", targets[2:3], files / "out", options, continuity="c0")
    assert not fewer[0].skipped
    assert fewer[0].patches == 1


def test_processes_get_the_split_source(files):
    targets = [files / "house.xml", files / "kink.xml"]
    result = run("batch", files / "source.xml", *targets, "-o", files / "out", "--split", "auto", "--workers", 2)
    assert result.exit_code == 0, result.output
    assert len(pt.read(files / "out/house.xml")) == len(pt.read(files / "out/kink.xml")) > 2
