"""``patchtransfer library``: the best of a folder written, all candidates told."""

from __future__ import annotations

import json

import pytest

import models
import patchtransfer as pt
import targets
from commands import failed, listing, run


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with models, and a target that is one of them bent."""
    monkeypatch.setenv("PATCHTRANSFER_CACHE", str(tmp_path / "cache"))
    shelf = tmp_path / "models"
    shelf.mkdir()
    bar = models.grid(1, 4, 2, 3)
    for name, model in {"square": models.grid(1, 1, 2, 3), "bar": bar, "plate": models.plate_with_hole()}.items():
        pt.write(model, shelf / f"{name}.xml")
    pt.write(targets.deformed(bar, targets.bend(bar, 50))[0], tmp_path / "target.xml")
    return tmp_path


def test_writes_the_best_and_tells_all(place):
    out, report, picture = place / "out.xml", place / "r.json", place / "p.png"
    result = run("library", place / "models", place / "target.xml", "-o", out, "--json", report, "--plot", picture)
    assert result.exit_code == 0, result.output
    table = result.stdout.splitlines()
    assert table[1].startswith("bar.xml")
    assert "chosen" in table[1]
    assert "and 1 more: 1 with another number of loops" in result.stdout
    assert pt.certify(pt.read(out)).injective
    assert len(pt.read(out)) == 4
    content = json.loads(report.read_text())
    assert content["library"]["chosen"] == "bar.xml"
    assert len(content["library"]["candidates"]) == 3
    assert content["error"] is None
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert (place / "cache" / "signatures.sqlite").exists()


def test_without_output_it_ranks(place):
    result = run("library", place / "models", place / "target.xml", "--no-cache", "--json", "-")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["library"]["candidates"][0]["name"] == "bar.xml"
    assert listing(place) == {"models", "target.xml"}
    result = run("library", place / "models", place / "target.xml", "--cache", place / "mine", "--keep", 1)
    assert "and 2 more: 1 with another number of loops, 1 less alike by signature" in result.stdout
    assert listing(place / "mine") == {"signatures.sqlite"}


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (["--plot", "p.png"], 2, "name that with -o"),
        (["--cache", "models/bar.xml"], 2, "cannot be made"),
        (["-o", "models/bar.xml"], 2, "would replace the input"),
        (["--fit-tolerance", 3], 2, "fit_tolerance must lie between"),
    ],
)
def test_bad_options(place, monkeypatch, options, status, message):
    monkeypatch.chdir(place)
    failed(run("library", "models", "target.xml", *options), status, message)


def test_a_folder_without_models(place):
    (place / "empty").mkdir()
    failed(run("library", place / "empty", place / "target.xml"), 2, "no models")
    (place / "models" / "a.txt").write_text("nothing")
    failed(run("library", place / "models", place / "target.xml"), 2, "--skip-unreadable")
    result = run("library", place / "models", place / "target.xml", "--skip-unreadable")
    assert result.exit_code == 0
    assert "warning: left out:" in result.stderr


def test_no_model_with_as_many_loops(place):
    (place / "models" / "plate.xml").unlink()
    pt.write(models.plate_with_hole().boundary(), place / "holed.xml")
    out = place / "out.xml"
    failed(
        run("library", place / "models", place / "holed.xml", "-o", out, "--no-parameterize"),
        2,
        "no model of the library has 2 boundary loops, as the target has: 2 with 1",
    )
    assert not out.exists()
    result = run("library", place / "models", place / "holed.xml", "-o", out)
    assert result.exit_code == 0, result.output
    assert "(parameterize)" in result.stdout
    assert len(pt.read(out).boundary().loops) == 2
