"""Exit statuses are what the guide's tables say."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import patchtransfer as pt
from commands import arguments, inputs_of_transfer, listing, run
from failing import eight, folded_source
from patchtransfer.cli import COMMANDS, support

GUIDE = Path(__file__).parents[2] / "docs/guide/command-line.md"
WRENCH = Path(pt.__file__).parent / "examples/wrench"


def section() -> str:
    return GUIDE.read_text().partition("## Exit status\n")[2].partition("\n## ")[0]


def test_the_tables_have_every_status_and_command():
    statuses = {int(number) for number in re.findall(r"^\| (\d+) \|", section(), re.MULTILINE)}
    assert statuses == {0, support.NOT_CERTIFIED, support.BAD_INPUT, support.INTERRUPTED}
    rows = re.findall(r"^\| (`.*?) \|", section(), re.MULTILINE)
    names = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    assert sorted(names) == sorted(COMMANDS)


@pytest.fixture
def folded(tmp_path):
    pt.write(folded_source(), tmp_path / "folded.xml")
    return tmp_path / "folded.xml"


def test_status_1_of_a_model_is_for_check_only(folded, tmp_path):
    assert run("check", folded).exit_code == 1
    assert run("check", WRENCH / "source.xml").exit_code == 0
    for command in (
        ("refine", folded, "-o", tmp_path / "r.xml"),
        ("convert", folded, tmp_path / "c.json"),
        ("quality", folded, "--proved"),
        ("plot", folded, "-o", tmp_path / "p.png"),
        ("compare", folded, folded),
        ("schema",),
    ):
        result = run(*command)
        assert result.exit_code == 0, (command, result.output)


def test_status_1_writes_what_is_to_be_kept_only(tmp_path):
    rabbit, human = WRENCH.parent / "rabbit/source.xml", WRENCH.parent / "human/target.svg"
    hopeless = "transfer", rabbit, human, "--continuity", "c0", "--time-limit", 0.001, "-o", tmp_path / "out.xml"
    assert run(*hopeless).exit_code == 1
    assert listing(tmp_path) == set()
    assert run(*hopeless, "--keep-uncertified").exit_code == 1
    assert listing(tmp_path) == {"out.xml"}


def test_status_2_writes_nothing(tmp_path):
    files = inputs_of_transfer(tmp_path)
    before = listing(files)
    pt.write(eight(), tmp_path / "eight.xml")
    before = listing(files)
    for wrong in (
        arguments(files, "--no-such-option"),
        arguments(files, "--fit-tolerance", -1),
        ("transfer", files / "none.xml", files / "target.xml", "-o", files / "out.xml"),
        ("transfer", files / "source.xml", files / "eight.xml", "-o", files / "out.xml"),
        arguments(files / "elsewhere"),
        ("no-such-command",),
    ):
        assert run(*wrong).exit_code == 2, wrong
        assert listing(files) == before, wrong


def test_a_batch_tells_of_one_failure(tmp_path):
    pt.write(eight(), tmp_path / "eight.xml")
    batch = "batch", WRENCH / "source.xml", WRENCH / "target.svg", "-o", tmp_path / "out", "--workers", 1
    assert run(*batch).exit_code == 0
    assert run(*batch, tmp_path / "eight.xml").exit_code == 1
    assert {"target.xml", "target.report.json", "eight.report.json"} <= listing(tmp_path / "out")
