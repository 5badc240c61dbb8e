"""What is seen of a command while it works: the log of its stages, and the status line on a terminal."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import domains
import models
import patchtransfer as pt
import targets
from commands import run
from patchtransfer.cli.streams import one_line, table

#: A line of the log: the stage, its seconds, what it came to.
LINE = re.compile(r"^([a-z0-9 ]+): (\d+\.\d{3}) s(, .+)?$")
#: Stages of a transfer with its default options, in the order in which each ends first.
STAGES = [
    "reading",
    "feasibility",
    "registration",
    "fitting",
    "sliding",
    "optimisation",
    "certificate",
    "continuity rows",
    "quality",
    "writing",
]


WRENCH = Path(pt.__file__).parent / "examples/wrench"


def arguments(folder, *more):
    """`transfer` of the wrench with its landmarks, between which joints slide."""
    given = WRENCH / "source.xml", WRENCH / "target.svg", "--landmarks", WRENCH / "landmarks.csv"
    return "transfer", *given, "-o", folder / "out.xml", *more


def logged(text: str) -> dict[str, str]:
    """What the stages of a log came to, the last of each; everything must be a line of a log."""
    found = {}
    for line in text.splitlines():
        match = LINE.match(line)
        assert match, line
        found[match[1]] = match[3] or ""
    return found


def test_the_log_has_a_line_for_every_stage(tmp_path):
    result = run(*arguments(tmp_path, "-v"))
    assert result.exit_code == 0, result.output
    found = logged(result.stderr)
    assert list(found) == STAGES
    assert "18 patches" in found["reading"]
    assert "17 landmarks" in found["reading"]
    assert re.search(r"\d+ joints, confidence [01]\.\d\d", found["registration"])
    assert re.search(r"boundary error \d\.\de-\d\d", found["fitting"])
    assert re.search(r"joints slid in \d+ rounds: energy", found["sliding"])
    assert re.search(r"\d+ Newton steps, energy \d", found["optimisation"])
    assert "certified" in found["certificate"]
    assert re.search(r"scaled Jacobian min 0\.\d+, mean 0\.\d+", found["quality"])
    assert "out.xml" in found["writing"]
    assert "certificate" in result.stdout


def test_the_log_and_the_report_on_standard_output_do_not_mix(tmp_path):
    import json

    result = run(*arguments(tmp_path, "--json", "-", "--verbose"))
    report = json.loads(result.stdout)
    assert set(report["timings"]) | {"reading", "writing"} == set(logged(result.stderr))


def test_refinement_is_a_stage(tmp_path):
    result = run(*arguments(tmp_path, "-v", "--refine", "tolerance", "--fit-tolerance", 1e-5))
    lines = [line for line in result.stderr.splitlines() if LINE.match(line)]
    found = logged("\n".join(lines))
    assert re.search(r"\d+ boundary spans halved, \d+ control points", found["refinement"])


def test_nothing_is_told_where_nobody_asked(tmp_path):
    assert run(*arguments(tmp_path)).stderr == ""


def test_other_commands_log_their_stages(tmp_path):
    plate = tmp_path / "plate.xml"
    pt.write(models.plate_with_hole(2, 2), plate)
    pt.write(domains.L, tmp_path / "L.xml")
    (tmp_path / "layout.json").write_text(
        '{"vertices": [[0, 0], [2, 0], [2, 1], [1, 1], [0, 1], [1, 2], [0, 2], [1, 0]],'
        ' "quads": [[0, 7, 3, 4], [7, 1, 2, 3], [4, 3, 5, 6]], "boundary": "L.xml"}'
    )
    for command, stages in (
        (("parameterize", tmp_path / "L.xml", "-o", tmp_path / "p.xml"), {"reading", "layouts", "writing"}),
        (
            ("build", tmp_path / "layout.json", "-o", tmp_path / "b.xml"),
            {"reading", "registration", "certificate", "writing"},
        ),
        (
            ("morph", plate, plate, "-n", 3, "-o", tmp_path / "m"),
            {"reading", "frames"},
        ),
    ):
        result = run(*command, "-v")
        assert result.exit_code == 0, result.output
        assert stages <= set(logged(result.stderr)), command
        assert run(*command).stderr == ""


def test_a_batch_logs_its_targets(tmp_path):
    targets_ = [tmp_path / f"{name}.xml" for name in ("a", "b")]
    mp = models.plate_with_hole(2, 2)
    pt.write(mp, tmp_path / "source.xml")
    for k, path in enumerate(targets_):
        pt.write(targets.deformed(mp, targets.bend(mp, 10 + 10 * k))[0], path)
    batch = ("batch", tmp_path / "source.xml", *targets_, "-o", tmp_path / "out", "--workers", 1)
    lines = run(*batch, "-v").stderr.splitlines()
    assert len(lines) == 2
    for path, line in zip(targets_, lines, strict=True):
        assert re.fullmatch(rf"{re.escape(str(path))}: \d+\.\d\d\d s, certified, boundary error .*, scaled Jac.*", line)
    assert run(*batch).stderr == ""
    assert all("finished before" in line for line in run(*batch, "-v").stderr.splitlines())


def on_a_terminal(*command) -> str:
    """What the command writes to a terminal for both of its outputs."""
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    words = [sys.executable, "-m", "patchtransfer.cli", *map(str, command)]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "200", "NO_COLOR": ""}
    with subprocess.Popen(words, stdin=theirs, stdout=theirs, stderr=theirs, env=environment) as process:
        os.close(theirs)
        text = b""
        # A terminal whose other side is closed cannot be read.
        try:
            while part := os.read(ours, 65536):
                text += part
        except OSError:
            pass
    os.close(ours)
    assert process.returncode == 0, text
    return text.decode()


@pytest.mark.parametrize("options", [(), ("-v",)])
def test_a_terminal_shows_every_stage(tmp_path, options):
    text = on_a_terminal(*arguments(tmp_path, *options))
    drawn = re.findall(r"[\u2800-\u28ff] ([a-z ]+)", text)
    assert [stage for stage in STAGES if stage not in drawn] == []
    # The table stands below, in colour.
    assert re.search(r"certificate +\x1b\[32m\x1b\[1mcertified\x1b\[0m", text)
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text).replace("\r", "\n")
    logged_ = {match[1] for line in plain.split("\n") if (match := LINE.match(line))}
    assert logged_ == (set(STAGES) if options else set())


def test_columns_and_lines():
    rows = [("a", "1"), ("\x1b[32mlong\x1b[0m", "200")]
    assert table(rows, right=[1]) == "a       1\n\x1b[32mlong\x1b[0m  200"
    assert one_line("two\nlines\x1b[2J\a") == "two lines[2J"
    assert len(one_line("x" * 10**6)) < 3000
