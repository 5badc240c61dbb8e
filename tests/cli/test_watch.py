"""What is seen of a command while it works: the log of its stages, and the status line on a terminal."""

from __future__ import annotations

import json
import logging
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
from patchtransfer.cli import COMMANDS, main
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


def on_a_terminal(*command, delay: float = 0) -> str:
    """What the command writes to a terminal for both of its outputs, the status line after so many seconds."""
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    code = f"import sys; from patchtransfer.cli import main, watch; watch.DELAY = {delay}; main()"
    words = [sys.executable, "-c", code, *map(str, command)]
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


def test_a_command_that_is_over_soon_shows_no_status_line(tmp_path):
    assert re.findall("[\u2800-\u28ff]", on_a_terminal(*arguments(tmp_path), delay=60)) == []


def test_the_status_line_comes_while_a_stage_is_silent(tmp_path):
    """The core tells nothing while it solves, nor does the drawing of a picture."""
    text = on_a_terminal("plot", WRENCH / "source.xml", "-o", tmp_path / "p.png", delay=0.01)
    assert re.search("[\u2800-\u28ff] (reading|drawing)", text)
    # It is gone afterwards, and the cursor is back.
    assert text.rstrip().endswith("\x1b[2K") or "\x1b[?25h" in text[text.rindex("drawing") :]


def test_warnings_of_files_and_the_status_line_do_not_tear_each_other(tmp_path):
    far = (WRENCH / "target.svg").read_text()
    (tmp_path / "t.svg").write_text(far.replace("</svg>", "<text>not read</text></svg>"))
    text = on_a_terminal(*("transfer", WRENCH / "source.xml", tmp_path / "t.svg", "-o", tmp_path / "out.xml"))
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text).replace("\r", "\n")
    assert [line for line in plain.split("\n") if re.search(r"[\u2800-\u28ff].*(warning|note):", line)] == []


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_can_be_louder_and_quieter(name):
    flags = {flag for option in main.get_command(None, name).params for flag in option.opts}
    assert {"-v", "--verbose", "-q", "--quiet"} <= flags


def commands_on_files(folder) -> dict[str, tuple]:
    """A run of every command that works on files and ends, and where there are some with its stages."""
    a, b = WRENCH / "source.xml", folder / "b.xml"
    source = pt.read(a)
    pt.write(source.with_control_points([1.5 * patch.control_points for patch in source.patches]), b)
    pt.write(domains.L, folder / "L.xml")
    (folder / "shelf").mkdir()
    pt.write(source, folder / "shelf" / "wrench.xml")
    (folder / "layout.json").write_text(
        '{"vertices": [[0, 0], [2, 0], [2, 1], [1, 1], [0, 1], [1, 2], [0, 2], [1, 0]],'
        ' "quads": [[0, 7, 3, 4], [7, 1, 2, 3], [4, 3, 5, 6]], "boundary": "L.xml"}'
    )
    shelf = "library", folder / "shelf", WRENCH / "target.svg", "--no-cache", "-o", folder / "best.xml"
    return {
        "transfer": (arguments(folder), STAGES),
        "parameterize": (("parameterize", folder / "L.xml", "-o", folder / "p.xml"), ["reading", "layouts", "writing"]),
        "library": (shelf, ["reading", "signatures", "registration", "transfer", "writing"]),
        "build": (("build", folder / "layout.json", "-o", folder / "l.xml"), ["reading", "certificate", "writing"]),
        "refine": (("refine", a, "-o", folder / "r.xml", "--split", 2), ["reading", "refinement", "certificate"]),
        "convert": (("convert", a, folder / "c.json"), ["reading and writing"]),
        "check": (("check", a), ["reading", "certificate", "sides", "quality", "continuity"]),
        "quality": (("quality", a), ["reading", "quality"]),
        "compare": (("compare", a, b), ["reading", "similarity", "quality"]),
        "plot": (("plot", a, "-o", folder / "p.png"), ["reading", "drawing"]),
        "examples": (("examples", "star", "-o", folder / "star"), ["reading", "registration", "writing"]),
        "batch": (("batch", a, WRENCH / "target.svg", "-o", folder / "many", "--workers", 1), []),
        "morph": (("morph", a, b, "-n", 3, "-o", folder / "frames"), ["reading", "frames", "writing"]),
        "poisson": (
            ("poisson", a, "-o", folder / "u.vtu"),
            ["reading", "setup", "assembly", "solve", "errors", "writing"],
        ),
    }


def test_all_commands_are_quiet_or_tell_their_stages(tmp_path):
    commands = commands_on_files(tmp_path)
    # What a schema is asked for is the schema, however quiet.
    assert set(commands) | {"studio", "schema"} == set(COMMANDS)
    for name, (command, stages) in commands.items():
        quiet = run(*command, "-q")
        assert (quiet.exit_code, quiet.output) == (0, ""), (name, quiet.output)
        loud = run(*command, "-v")
        assert (loud.exit_code, loud.stdout != "") == (0, name != "plot"), name
        if name != "batch":
            lines = [line for line in loud.stderr.splitlines() if not line.startswith(("warning: ", "note: "))]
            assert set(stages) <= set(logged("\n".join(lines))), name


def test_quiet_leaves_errors_and_the_report(tmp_path):
    result = run("check", WRENCH / "source.xml", "-q", "--json", "-")
    assert json.loads(result.stdout)["error"] is None
    assert result.stderr == ""
    failed = run("check", tmp_path / "none.xml", "-q")
    assert (failed.exit_code, failed.stdout) == (2, "")
    assert re.fullmatch(r"error: .*none\.xml: no such file.*\n", failed.stderr)
    assert run("check", WRENCH / "source.xml", "-q", "-v").exit_code == 2


def test_louder_still_tells_what_was_decided(tmp_path):
    text = run(*arguments(tmp_path, "-vv")).stderr
    assert "fitting begins\n" in text
    assert re.search(r"^joints slid in \d+ rounds", text, re.MULTILINE)
    # Nobody listens any more.
    assert logging.getLogger("patchtransfer").level == logging.NOTSET
    assert [type(handler) for handler in logging.getLogger("patchtransfer").handlers] == [logging.NullHandler]


def test_columns_and_lines():
    rows = [("a", "1"), ("\x1b[32mlong\x1b[0m", "200")]
    assert table(rows, right=[1]) == "a       1\n\x1b[32mlong\x1b[0m  200"
    assert one_line("two\nlines\x1b[2J\a") == "two lines[2J"
    assert len(one_line("x" * 10**6)) < 3000
