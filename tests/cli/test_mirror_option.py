"""`--mirror auto` of `transfer` and `batch`."""

from __future__ import annotations

import json

import numpy as np
import pytest

import domains
import models
import patchtransfer as pt
from commands import failed, run
from patchtransfer.batch import BatchOptions, run_batch

#: Cells of an F.
CELLS = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 3), (2, 3), (1, 1)]
MIRROR = np.diag([-1.0, 1.0])


@pytest.fixture
def files(tmp_path):
    """A letter, and as targets itself and its mirror image."""
    source = models.build([models.bilinear((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)) for i, j in CELLS], 3, 1, 1)
    pt.write(source, tmp_path / "source.xml")
    pt.write(source.boundary(), tmp_path / "plain.xml")
    pt.write(domains.mapped(source.boundary(), MIRROR), tmp_path / "image.xml")
    return tmp_path


def test_a_mirrored_transfer_is_written_and_told(files):
    options = "--mirror", "auto", "--json", files / "r.json", "--plot-registration", files / "q.png"
    result = run("transfer", files / "source.xml", files / "image.xml", "-o", files / "out.xml", *options)
    assert result.exit_code == 0, result.output
    assert "mirror image of the source" in result.output
    assert "the source was mirrored" in result.stderr
    report = json.loads((files / "r.json").read_text())
    assert report["mirrored"] is True
    joints = np.array([[*joint["source"], *joint["target"]] for joint in report["registration"]["joints"]])
    assert np.allclose(joints[:, :2] @ MIRROR, joints[:, 2:], atol=1e-6)
    assert pt.certify(pt.read(files / "out.xml")).injective


def test_landmarks_of_a_mirror_image_need_it(files):
    corners = np.array([(0, 0), (1, 0), (3, 3), (0, 4)])
    rows = ["xs,ys,xt,yt", *(",".join(map(str, row)) for row in np.c_[corners, corners @ MIRROR])]
    (files / "l.csv").write_text("\n".join(rows))
    names = files / "source.xml", files / "image.xml", "-o", files / "out.xml", "--landmarks", files / "l.csv"
    failed(run("transfer", *names), 2, r"run backwards.*--mirror auto \(mirror='auto'\)")
    result = run("transfer", *names, "--mirror", "auto")
    assert result.exit_code == 0, result.output


def test_a_batch_mirrors_where_needed(files):
    targets = [files / "plain.xml", files / "image.xml"]
    rows = run_batch(files / "source.xml", targets, files / "out", BatchOptions(mirror="auto", split="auto"))
    assert [(row.ok, row.mirrored) for row in rows] == [(True, False), (True, True)]
    reports = [json.loads((files / f"out/{name}.report.json").read_text()) for name in ("plain", "image")]
    assert [report["mirrored"] for report in reports] == [False, True]
    again = run_batch(files / "source.xml", targets, files / "out", BatchOptions(mirror="auto", split="auto"))
    assert all(row.skipped for row in again)
    other = run_batch(files / "source.xml", targets[:1], files / "out", BatchOptions(split="auto"))
    assert not other[0].skipped
