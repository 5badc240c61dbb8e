"""The command line in this process: how it is called, what a failure looks like; its reports are as published."""

import re

import numpy as np
from click.testing import CliRunner, Result

import models
import patchtransfer as pt
import reports
import targets
from patchtransfer.cli import main


def run(*arguments) -> Result:
    """Call the command with arguments of any type; all reports that it writes are held to their schema."""
    texts = [str(a) for a in arguments]
    result = CliRunner().invoke(main, texts)
    for content, names in reports.written(texts, result.stdout) if texts else ():
        wrong = reports.faults(content, *names)
        assert not wrong, wrong[:5]
    return result


def inputs_of_transfer(folder):
    """The folder, with a source of eight patches around a hole, a target and landmarks in it."""
    mp = models.plate_with_hole(2, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    pt.write(mp, folder / "source.xml")
    pt.write(target, folder / "target.xml")
    np.savetxt(folder / "landmarks.csv", landmarks, delimiter=",", header="xs,ys,xt,yt", comments="")
    return folder


def arguments(folder, *more):
    """`transfer` of those inputs, written to out.xml."""
    return "transfer", folder / "source.xml", folder / "target.xml", "-o", folder / "out.xml", *more


def failed(result: Result, status: int, message: str) -> None:
    """The status, no traceback, and one line on standard error that matches."""
    assert result.exit_code == status, result.output
    assert result.exception is None or isinstance(result.exception, SystemExit), repr(result.exception)
    lines = result.stderr.strip().split("\n")
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert re.search(message, lines[0]), lines[0]


def listing(folder) -> set[str]:
    """Names of the files in a folder."""
    return {p.name for p in folder.iterdir()}
