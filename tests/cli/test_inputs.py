"""The command line never writes over a file that it reads, and reads outlines as its options say."""

import json
import os
import re

import numpy as np
import pytest

import models
import patchtransfer as pt
import targets
from commands import failed, run


@pytest.fixture
def files(tmp_path):
    """A model, another with its patches, a target, landmarks and a layout with its boundary."""
    mp = models.grid(2, 1, 2, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    pt.write(mp, tmp_path / "a.xml")
    pt.write(pt.transfer(mp, target, landmarks).multipatch, tmp_path / "b.xml")
    pt.write(target, tmp_path / "target.xml")
    np.savetxt(tmp_path / "landmarks.csv", landmarks, delimiter=",", header="xs,ys,xt,yt", comments="")
    (tmp_path / "square.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><path d="M 0 0 L 1 0 L 1 1 L 0 1 Z"/></svg>'
    )
    pt.write(models.grid(1, 1, 2, 2).boundary(), tmp_path / "outline.xml")
    corners = [c.start.tolist() for c in pt.read_boundary(tmp_path / "outline.xml").loops[0]]
    layout = {"vertices": corners, "quads": [[0, 1, 2, 3]], "boundary": "outline.xml"}
    (tmp_path / "layout.json").write_text(json.dumps(layout))
    return tmp_path


#: Command, with the name of the file that its last argument would replace.
CASES = [
    ("a.xml", "transfer a.xml target.xml -o a.xml"),
    ("target.xml", "transfer a.xml target.xml -o target.xml"),
    ("square.svg", "transfer a.xml square.svg -o out.xml --plot square.svg"),
    ("square.svg", "transfer a.xml square.svg -o out.xml --plot-registration square.svg"),
    ("a.xml", "refine a.xml --split 2 -o a.xml"),
    ("a.xml", "refine a.xml --elevate 1 -o ./sub/../a.xml"),
    ("outline.xml", "build layout.json -o outline.xml"),
    ("layout.json", "build layout.json -o out.xml --json layout.json"),
    ("morphed/frame-000.xml", "morph morphed/frame-000.xml b.xml -n 3 -o morphed"),
    ("morphed/frame-000.xml", "morph b.xml morphed/frame-000.xml -n 3 -o morphed"),
    ("out/summary.csv", "batch a.xml out/summary.csv -o out --workers 1"),
    ("out/target.xml", "batch a.xml out/target.xml -o out --workers 1"),
]


@pytest.mark.parametrize(("kept", "command"), CASES)
def test_an_input_is_not_replaced(files, monkeypatch, kept, command):
    for folder, name, original in (
        ("sub", "a.xml", "a.xml"),
        ("morphed", "frame-000.xml", "a.xml"),
        ("out", "target.xml", "target.xml"),
        ("out", "summary.csv", "landmarks.csv"),
    ):
        (files / folder).mkdir(exist_ok=True)
        (files / folder / name).write_bytes((files / original).read_bytes())
    monkeypatch.chdir(files)
    before = {p: p.read_bytes() for p in files.rglob("*") if p.is_file()}
    failed(run(*command.split()), 2, f"{os.path.basename(kept)}.*would replace")
    assert {p: p.read_bytes() for p in files.rglob("*") if p.is_file()} == before


def test_reports_and_pictures_are_checked_too(files, monkeypatch):
    monkeypatch.chdir(files)
    # Whatever its name says, the content decides on reading.
    (files / "model.json").write_bytes((files / "a.xml").read_bytes())
    (files / "model.png").write_bytes((files / "a.xml").read_bytes())
    for command in (
        "check model.json --json model.json",
        "poisson model.json --json model.json",
        "poisson model.png --plot model.png",
        "plot model.png -o model.png",
    ):
        failed(run(*command.split()), 2, "would replace the input")


def test_links_are_followed(files):
    (files / "link.xml").symlink_to(files / "a.xml")
    failed(run("refine", files / "a.xml", "-o", files / "link.xml"), 2, "link.xml: the result would replace the input")
    failed(run("refine", files / "link.xml", "-o", files / "a.xml"), 2, "a.xml: the result would replace the input")


def test_other_files_are_replaced(files):
    (files / "old.xml").write_bytes((files / "a.xml").read_bytes())
    result = run("refine", files / "a.xml", "--split", "2", "-o", files / "old.xml")
    assert result.exit_code == 0, result.output
    assert pt.read(files / "old.xml") != pt.read(files / "a.xml")


@pytest.mark.parametrize("degree", [17, 500, 10**9])
def test_absurd_degrees_of_a_field_are_refused(files, degree):
    failed(run("poisson", files / "a.xml", "--degree", degree), 2, f"degree {degree} of the field.*1 to 16")


@pytest.mark.parametrize("points", [100_000, 10**12, 10**30])
def test_absurd_numbers_of_points_of_a_field_are_refused(files, points):
    failed(
        run("poisson", files / "a.xml", "--points", points),
        2,
        f"{points} points are too many.*8 GB with more than [0-9]+ per patch",
    )
    failed(run("poisson", files / "a.xml", "--degree", 17, "--points", points), 2, "--points|degree")


@pytest.mark.parametrize(
    "command", ["transfer a.xml shape.csv -o o.xml", "parameterize shape.csv -o o.xml", "build l.json -o o.xml"]
)
@pytest.mark.parametrize(
    ("given", "expected"),
    [("", (True, None)), ("--no-clean --smooth", (False, True)), ("--polygon", (True, False))],
)
def test_outlines_are_read_as_the_options_say(tmp_path, monkeypatch, command, given, expected):
    pt.write(models.grid(2, 1, 2, 3), tmp_path / "a.xml")
    (tmp_path / "l.json").write_text(
        '{"vertices": [[0, 0], [1, 0], [1, 1], [0, 1]], "quads": [[0, 1, 2, 3]], "boundary": "shape.csv"}'
    )

    def read_boundary(path, *, clean=True, smooth=None, **_others):
        raise pt.InputError(f"asked for {clean, smooth}")

    monkeypatch.setattr("patchtransfer.io.read_boundary", read_boundary)
    monkeypatch.chdir(tmp_path)
    failed(run(*command.split(), *given.split()), 2, re.escape(f"asked for {expected}"))


def test_targets_of_a_batch_are_read_as_the_options_say(tmp_path):
    pt.write(models.grid(2, 1, 2, 3), tmp_path / "a.xml")
    (tmp_path / "t.csv").write_text("0,0\n2,0\n2,0\n2,1\n0,1\n")
    words = ("batch", tmp_path / "a.xml", tmp_path / "t.csv", "-o", tmp_path / "out", "--workers", "1")
    assert run(*words).exit_code == 0
    # Another way of reading is another job.
    assert run(*words, "--no-clean").exit_code == 1
    assert "repeats" in (tmp_path / "out" / "summary.json").read_text()
