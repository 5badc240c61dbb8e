"""What the package tells the logger "patchtransfer", and that it prints nothing."""

from __future__ import annotations

import logging
import re
import subprocess
import sys
from pathlib import Path

import pytest

import domains
import patchtransfer as pt

WRENCH = Path(pt.__file__).parent / "examples/wrench"


def transferred(**options) -> pt.TransferResult:
    source, target = pt.read(WRENCH / "source.xml"), pt.read_boundary(WRENCH / "target.svg")
    return pt.transfer(source, target, **options)


def heard(caplog, level: int) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno == level]


def test_stages_are_records_with_their_figures(caplog, capfd):
    caplog.set_level(logging.DEBUG, "patchtransfer")
    result = transferred()
    assert {record.name for record in caplog.records} == {"patchtransfer"}
    stages = [record for record in caplog.records if record.levelno == logging.INFO]
    assert {record.stage for record in stages} == set(result.timings)
    for record in stages:
        assert re.fullmatch(rf"{record.stage}: \d+\.\d{{3}} s(, .+)?", record.getMessage())
        assert record.seconds <= result.timings[record.stage] + 1e-9
    assert sum(record.seconds for record in stages) == pytest.approx(sum(result.timings.values()))
    debug = heard(caplog, logging.DEBUG)
    assert "fitting begins" in debug
    assert set(result.log) <= set(debug)
    assert heard(caplog, logging.WARNING) == list(result.warnings)
    assert capfd.readouterr() == ("", "")


def test_a_warning_is_one_record_though_it_comes_early(caplog):
    """A rabbit as a man: doubted before the work, and in the result."""
    rabbit, human = pt.examples.load("rabbit")[0], pt.examples.load("human")[1]
    caplog.set_level(logging.DEBUG, "patchtransfer")
    result = pt.transfer(rabbit, human, continuity="c0", on_failure="return", time_limit=1.0)
    assert result.registration.doubts
    assert sorted(heard(caplog, logging.WARNING)) == sorted(result.warnings)
    told = [record.getMessage() for record in caplog.records]
    assert told.index(result.registration.doubts[0]) < told.index("fitting begins")


def test_attempts_inside_a_stage_are_details(caplog):
    caplog.set_level(logging.DEBUG, "patchtransfer")
    result = pt.parameterize(domains.L)
    stages = [record.stage for record in caplog.records if record.levelno == logging.INFO]
    assert stages == list(result.timings)
    assert "registration" not in stages
    assert "fitting begins" in heard(caplog, logging.DEBUG)


def test_the_library_is_silent_and_loads_no_logging_of_its_own():
    code = f"""
import sys
import patchtransfer as pt
source, target = pt.read({str(WRENCH / "source.xml")!r}), pt.read_boundary({str(WRENCH / "target.svg")!r})
landmarks = pt.read_landmarks({str(WRENCH / "landmarks.csv")!r})
result = pt.transfer(source, target, landmarks)
assert "logging" not in sys.modules
import logging
result = pt.transfer(source, target, landmarks)
# Warnings are records, and Python has no place for them that nobody has chosen.
logging.getLogger("patchtransfer").warning("unheard")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
