"""``patchtransfer parameterize``: files written, or none."""

from __future__ import annotations

import json

import pytest

import domains
import patchtransfer as pt
from commands import failed, listing, run


@pytest.fixture
def folder(tmp_path):
    """With a valid outline and one that crosses itself."""
    pt.write(domains.L, tmp_path / "L.xml")
    pt.write(domains.BOW_TIE, tmp_path / "tie.xml")
    return tmp_path


def test_writes_model_report_and_picture(folder):
    out, report, picture = folder / "out.xml", folder / "r.json", folder / "p.png"
    result = run("parameterize", folder / "L.xml", "-o", out, "--json", report, "--plot", picture, "--degree", 2)
    assert result.exit_code == 0, result.output
    assert "certified" in result.stdout
    model = pt.read(out)
    assert [patch.degrees for patch in model.patches] == [(2, 2)] * 3
    assert pt.certify(model).status == "certified"
    content = json.loads(report.read_text())
    assert content["patches"] == 3
    assert content["certificate"]["status"] == "certified"
    assert content["candidates"][0]["patches"] == 3
    assert content["error"] is None
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_report_on_standard_output(folder):
    result = run("parameterize", folder / "L.xml", "-o", folder / "out.xml", "--json", "-", "--max-patches", 2)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["patches"] == 2


@pytest.mark.parametrize(
    ("outline", "status", "options", "message"),
    [
        ("tie.xml", 2, [], r"crosses itself at \(0.5, 0.5\)"),
        ("L.xml", 2, ["--fit-tolerance", 0], "fit_tolerance must lie between 0 and 1"),
        ("L.xml", 2, ["--time-limit", -1], "time_limit must be a positive number"),
        ("L.xml", 2, ["--continuity", "g1", "--degree", 2], "needs degree 3 or more"),
        ("L.xml", 1, ["--max-patches", 1], "2 patches where max_patches is 1; allow more"),
    ],
)
def test_nothing_is_written_on_failure(folder, outline, status, options, message):
    before = listing(folder)
    outputs = ["-o", folder / "out.xml", "--plot", folder / "p.png"]
    failed(run("parameterize", folder / outline, *outputs, *options), status, message)
    assert listing(folder) == before


def test_the_report_of_a_failure(folder):
    result = run("parameterize", folder / "tie.xml", "-o", folder / "out.xml", "--json", "-")
    assert result.exit_code == 2
    assert listing(folder) == {"L.xml", "tie.xml"}
    assert "crosses itself" in json.loads(result.stdout)["error"]


def test_the_outline_is_not_written_over(folder):
    before = (folder / "L.xml").read_bytes()
    failed(run("parameterize", folder / "L.xml", "-o", folder / "L.xml"), 2, "would replace the input")
    assert (folder / "L.xml").read_bytes() == before


def test_layers_are_chosen_and_notes_are_told(folder):
    ezdxf = pytest.importorskip("ezdxf")
    document = ezdxf.new()
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (4, 0), (4, 3), (0, 3)], close=True, dxfattribs={"layer": "Plate"})
    space.add_text("A4", dxfattribs={"layer": "Plate"})
    space.add_lwpolyline([(-9, -9), (9, -9), (9, 9), (-9, 9)], close=True, dxfattribs={"layer": "Frame"})
    document.saveas(folder / "plate.dxf")
    report = folder / "r.json"
    layers = ["--layer", "plate", "--layer", "0"]
    result = run("parameterize", folder / "plate.dxf", "-o", folder / "out.xml", "--json", report, *layers)
    assert result.exit_code == 0, result.output
    notes = [
        "left out, for they draw no outline: 1 TEXT on layer 'Plate'",
        "left out, for their layers were not chosen: 1 on layer 'Frame'",
    ]
    assert json.loads(report.read_text())["notes"] == notes
    assert result.stderr.splitlines() == [f"note: {note}" for note in notes]
    assert len(pt.read(folder / "out.xml").patches) == 1
    failed(run("parameterize", folder / "plate.dxf", "-o", folder / "o.xml", "--layer", "x"), 2, "no layer 'x'")
