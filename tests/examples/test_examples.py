import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import patchtransfer as pt
from other_programs import gismo_finds_interfaces, gismo_model, gismo_sides, glued_sides
from patchtransfer import examples
from patchtransfer.cli import main

README = Path(__file__).parents[2] / "README.md"


#: Boundary loops, patches at most, and valences of the extraordinary vertices.
PROMISED = {
    "wrench": (2, 18, [5, 5]),
    "rabbit": (1, 30, [3, 3, 5, 5]),
    "human": (1, 30, [3, 3, 3, 3, 5, 5]),
    "frame": (2, 16, []),
    "two-hole-plate": (3, 30, [5] * 8),
    "star": (1, 12, [6]),
    "annulus": (2, 4, []),
    "plate-with-hole": (2, 4, []),
}


def test_every_example_is_promised_something():
    assert PROMISED.keys() == examples.EXAMPLES.keys()


@pytest.mark.parametrize("name", PROMISED)
def test_source_is_a_good_model_with_the_vertices_promised(name):
    source, _, _ = examples.load(name)
    loops, patches, valences = PROMISED[name]
    assert pt.certify(source).injective
    assert pt.quality(source).scaled_jacobian.mean >= 0.88
    assert len(source.loops) == loops
    assert min(5, patches) <= len(source) <= patches
    rational = name in examples.RATIONAL
    assert {patch.degrees for patch in source.patches} == {(2, 2) if rational else (3, 3)}
    assert all((patch.weights is not None) == rational for patch in source.patches)
    assert sorted(v.valence for v in source.vertices if v.extraordinary) == valences


@pytest.mark.parametrize("name", PROMISED)
def test_transfer_is_certified_and_on_the_target(name):
    result = pt.transfer(*examples.load(name))
    assert result.certificate.injective
    low = result.continuity.c1_share < 0.5
    assert [warning.startswith("C1 across patches") for warning in result.warnings] == [True] * low
    assert result.boundary_error <= 1e-3
    assert result.quality.scaled_jacobian.mean >= 0.85


def test_the_wrench_moves_its_jaws_in_steps():
    """Every step is certified, and quality falls with every step (as Fig. 12 of the paper), unless joints slide.

    Where they do, the more the jaws have moved the more there is to gain.
    """
    fixed, slid = [], []
    for step in range(1, examples.STEPS["wrench"] + 1):
        for quality, keep in ((fixed, True), (slid, False)):
            result = pt.transfer(*examples.load("wrench", step), fixed_correspondence=keep)
            assert result.certificate.status == "certified"
            assert result.boundary_error <= 1e-3
            quality.append(result.quality.scaled_jacobian.mean)
    assert fixed == sorted(fixed, reverse=True)
    gains = [after - before for before, after in zip(fixed, slid, strict=True)]
    assert gains[0] > 0
    assert gains == sorted(gains)
    with pytest.raises(pt.InputError, match="has 4 steps, there is no step 5"):
        examples.load("wrench", 5)


@pytest.mark.parametrize("name", examples.RATIONAL)
def test_rational_targets_are_met_exactly(name):
    source, target, landmarks = examples.load(name)
    for rows in (landmarks, None):
        result = pt.transfer(source, target, rows)
        assert result.certificate.status == "certified"
        assert result.boundary_error < 1e-12
        for before, after in zip(source, result.multipatch, strict=True):
            assert np.array_equal(before.weights, after.weights)
    for loop in result.registration.loops:
        assert all(own is not None for own in loop.own)


@pytest.mark.parametrize("name", PROMISED)
def test_pygismo_finds_the_same_interfaces(name, tmp_path):
    source, _, _ = examples.load(name)
    pt.write(source, tmp_path / "source.xml")
    assert pt.read(tmp_path / "source.xml") == source
    found = gismo_finds_interfaces(gismo_model(tmp_path / "source.xml"))
    assert gismo_sides(found) == glued_sides(source)


@pytest.mark.parametrize("name", [name for name in PROMISED if name not in examples.RATIONAL])
def test_target_is_cut_elsewhere_than_the_source(name):
    source, target, landmarks = examples.load(name)
    loops = pt.transfer(source, target, landmarks).registration.loops
    joints = np.concatenate([loop.target.point(loop.joints[:-1]) for loop in loops])
    # Every drawing is cut at its corners.
    smooth = np.concatenate([abs(loop.target.turn(loop.joints[:-1])) < np.radians(15) for loop in loops])
    ends = np.array([curve.start for loop in target.loops for curve in loop])
    apart = np.linalg.norm(joints[:, None] - ends[None], axis=2) / target.diameter
    assert (apart[smooth].min(axis=1) > 1e-3).sum() >= smooth.sum() / 2
    assert (apart.min(axis=0) > 1e-3).sum() >= 2


def test_command_runs_an_example(tmp_path):
    folder = tmp_path / "new" / "wrench"
    outcome = CliRunner().invoke(main, ["examples", "wrench", "-o", str(folder)])
    assert outcome.exit_code == 0, outcome.output
    assert "certified" in outcome.output
    assert {p.name for p in folder.iterdir()} == {
        *("source.xml", "target.svg", "landmarks.csv", "result.xml"),
        *("transfer.png", "registration.png", "report.json"),
    }
    report = json.loads((folder / "report.json").read_text())
    assert report["certificate"]["injective"]
    assert report["boundary_error"] <= 1e-3
    assert report["quality"]["scaled_jacobian"]["mean"] >= 0.88
    written = pt.read(folder / "result.xml")
    assert pt.certify(written).injective
    assert pt.read(folder / "source.xml") == examples.load("wrench")[0]
    assert (folder / "transfer.png").read_bytes().startswith(b"\x89PNG")


def test_command_runs_a_rational_example(tmp_path):
    outcome = CliRunner().invoke(main, ["examples", "annulus", "-o", str(tmp_path / "annulus")])
    assert outcome.exit_code == 0, outcome.output
    assert {p.name for p in (tmp_path / "annulus").iterdir()} == {
        *("source.xml", "target.xml", "landmarks.csv", "result.xml"),
        *("transfer.png", "registration.png", "report.json"),
    }
    assert pt.read(tmp_path / "annulus" / "result.xml").patches[0].weights is not None


def test_command_lists_examples():
    outcome = CliRunner().invoke(main, ["examples"])
    assert outcome.exit_code == 0
    assert [line.partition(":")[0] for line in outcome.output.splitlines()] == list(examples.EXAMPLES)


def test_unknown_name_is_refused_and_lists_the_names(tmp_path):
    outcome = CliRunner().invoke(main, ["examples", "spanner", "-o", str(tmp_path)])
    assert outcome.exit_code == 2
    assert "'spanner'" in outcome.output
    assert "wrench" in outcome.output
    assert not list(tmp_path.iterdir())


def test_unwritable_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("taken")
    outcome = CliRunner().invoke(main, ["examples", "wrench", "-o", str(tmp_path / "file")])
    assert outcome.exit_code == 2
    assert "file" in outcome.output
    assert (tmp_path / "file").read_text() == "taken"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_folder_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    outcome = CliRunner().invoke(main, ["examples", "wrench", "-o", str(tmp_path)])
    tmp_path.chmod(0o700)
    assert outcome.exit_code == 2
    assert "permission" in outcome.output.lower()


def test_readme_python_runs(tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    monkeypatch.chdir(tmp_path)
    for block in blocks:
        names: dict[str, object] = {}
        exec(compile(block, "README.md", "exec"), names)
        result = names["result"]
        assert isinstance(result, pt.TransferResult)
        assert result.certificate.injective
    assert pt.certify(pt.read("result.xml")).injective
