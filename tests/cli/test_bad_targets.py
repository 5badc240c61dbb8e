"""The command line on bad targets and landmarks, and the registration part of its report."""

import json
import re

import numpy as np
import pytest

import patchtransfer as pt
from commands import arguments, failed, inputs_of_transfer, listing, run

SQUARE = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])


@pytest.fixture
def files(tmp_path):
    return inputs_of_transfer(tmp_path)


def _csv(path, loops) -> None:
    """Closed outlines as points, a blank line between them."""
    path.write_text("x,y\n" + "\n\n".join("\n".join(f"{x},{y}" for x, y in loop) for loop in loops) + "\n")


@pytest.mark.parametrize(
    ("loops", "message"),
    [
        ([SQUARE], "source has 1 holes and the target 0"),
        ([SQUARE, 0.3 * SQUARE, 0.1 * SQUARE], "source has 1 holes and the target 2"),
        ([SQUARE, 0.3 * SQUARE + 5], "loop 1 lies outside the outer loop 0"),
        ([SQUARE, 0.3 * SQUARE + 1], "loops 0 and 1 cross"),
        ([SQUARE, SQUARE], "loops 0 and 1 lie on each other|repeats"),
        ([SQUARE[[0, 2, 1, 3]], 0.1 * SQUARE], "loop 0 crosses itself"),
        ([SQUARE, 0 * SQUARE], "loop|length|point"),
        ([SQUARE * [1, np.nan], 0.3 * SQUARE], "NaN"),
    ],
)
def test_bad_target_loops_are_bad_input(files, loops, message):
    _csv(files / "bad.csv", loops)
    before = listing(files)
    result = run("transfer", files / "source.xml", files / "bad.csv", "-o", files / "out.xml")
    failed(result, 2, message)
    assert listing(files) == before


def test_an_open_target_loop_is_bad_input(files):
    square = pt.Boundary(
        [[pt.BSplineCurve([0, 0, 1, 1], 1, [a, b]) for a, b in zip(SQUARE, np.roll(SQUARE, -1, 0), strict=True)]]
    )
    pt.write(square, files / "open.xml")
    text = (files / "open.xml").read_text()
    (files / "open.xml").write_text(re.sub(r"-1.0 1.0\s+-1.0 -1.0", "-1 1 -1 -0.5", text))
    assert (files / "open.xml").read_text() != text
    failed(run("transfer", files / "source.xml", files / "open.xml", "-o", files / "out.xml"), 2, "open|ends")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[[0, 2, 1]][:, 2:], r"rows \d and \d cross"),
        (lambda rows: rows[::-1, 2:], "rows 1, 2, 3, 4 run backwards.*mirror"),
        (lambda rows: np.full((4, 2), np.nan), "NaN"),
        (lambda rows: rows[[0, 0, 2, 3]][:, 2:], "rows 1 and 2 are the same point of the target"),
    ],
)
def test_bad_landmarks_are_bad_input(files, change, message):
    rows = np.loadtxt(files / "landmarks.csv", delimiter=",", skiprows=1)[:8:2]
    image = change(rows)
    bad = np.column_stack([rows[: len(image), :2], image])
    if len(image) == 3:
        bad = np.vstack([bad, rows[3:]])
    np.savetxt(files / "bad.csv", bad, delimiter=",", header="xs,ys,xt,yt", comments="")
    failed(run(*arguments(files, "--landmarks", files / "bad.csv")), 2, message)


def test_the_report_has_landmarks_to_correct_and_hand_back(files):
    failed_before = run(*arguments(files, "--json", files / "r.json", "--fixed-correspondence"))
    assert failed_before.exit_code == 0, failed_before.output
    registration = json.loads((files / "r.json").read_text())["registration"]
    assert 0 <= registration["confidence"] <= 1
    rows = np.array(registration["landmarks"])
    assert rows.shape[1] == 4
    np.savetxt(files / "again.csv", rows, delimiter=",", header="xs,ys,xt,yt", comments="")
    options = "--landmarks", files / "again.csv", "--fixed-correspondence"
    again = run(*arguments(files, *options, "--json", files / "s.json"))
    assert again.exit_code == 0, again.output
    other = json.loads((files / "s.json").read_text())["registration"]
    moved = [
        np.subtract(a["target"], b["target"]) for a, b in zip(registration["joints"], other["joints"], strict=True)
    ]
    assert np.linalg.norm(moved, axis=1).max() < 0.02
    assert other["confidence"] == 1
    assert other["runner_up"] is None
