"""`refine --conform`, and that the advice of messages works when it is followed to the letter."""

import json
import re
import warnings

import numpy as np
import pytest

import patchtransfer as pt
import real
from commands import failed, run
from patchtransfer import MultiPatch, Patch, Side
from shapes import quad

A, B = quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((1, 0), (2, 0), (2, 1), (1, 1))
TALL = quad((0, 0), (1, 0), (1, 2), (0, 2))


def shifted(patch: Patch, by: float) -> Patch:
    """The patch with its west side moved to the east."""
    points = patch.control_points.copy()
    Side.WEST.of(points)[:, 0] += by
    return patch.with_control_points(points)


def weighted(patch: Patch, weights) -> Patch:
    return Patch(patch.knots, patch.degrees, patch.control_points, weights)


#: Patches that do not conform, and what is said about them.
BROKEN = {
    "knots": ([A, B.insert_knots(1, [0.5])], "patch 0 east and patch 1 west coincide; knots differ: 1 and 2 spans"),
    "more knots": (
        [A.insert_knots(1, [0.5]), B.insert_knots(1, [0.2, 0.7])],
        "patch 0 east and patch 1 west coincide; knots differ: 2 and 3 spans",
    ),
    "other knots": (
        [A.insert_knots(1, [0.5]), B.insert_knots(1, [0.25])],
        "patch 0 east and patch 1 west coincide; knots differ: 2 and 2 spans, but not the same ones",
    ),
    "degrees": ([A.elevate(), B.elevate(2)], "patch 0 east and patch 1 west coincide; degrees differ: 2 and 3"),
    "T-junction": (
        [TALL, B, quad((1, 1), (2, 1), (2, 2), (1, 2))],
        "patch 0 east from 0 to 0.5 and patch 1 west (T-junction) coincide",
    ),
    "gap": ([A, shifted(B, 3e-5)], "patch 0 east and patch 1 west are 3e-5 apart (gap)"),
    "overlap": ([A, shifted(B, -3e-4)], "patch 0 east and patch 1 west are 3e-4 apart (gap)"),
    "wide overlap": ([A, shifted(B, -0.02)], "patch 0 east and patch 1 west are 0.02 apart (gap)"),
    "gap of an interface": ([A, shifted(B, 1e-5)], "control points of the two sides differ by 1e-05"),
    "small gap of an interface": ([A, shifted(B, 1e-6)], "control points of the two sides differ by 1e-06"),
    "gap and knots": (
        [A, shifted(B.insert_knots(1, [0.5]), 1e-4)],
        "patch 0 east and patch 1 west are 1e-4 apart (gap); knots differ: 1 and 2 spans",
    ),
    "one side rational": (
        [A, weighted(B, [[2, 2.0001], [1, 2]])],
        "weights of the two sides differ by",
    ),
    "weights to scale": (
        [weighted(A, [[1, 1], [2, 3]]), weighted(B, [[1, 1.5001], [1, 2]])],
        "weights of the two sides differ by",
    ),
    "weights of few digits": (
        [weighted(A, [[1, 1], [1, 1.3333]]), weighted(B, [[1, 4 / 3], [1, 2]])],
        "weights of the two sides differ by",
    ),
}


def advised(text: str) -> list[str]:
    """Options of the first command that a text names."""
    found = re.search(r"`patchtransfer refine (--conform(?: --weld [-+.0-9e]+)?)`", text)
    assert found, text
    return found[1].split()


@pytest.mark.parametrize("name", BROKEN)
def test_check_names_the_sides_and_its_advice_works(tmp_path, name):
    patches, message = BROKEN[name]
    pt.write(MultiPatch(patches), tmp_path / "in.xml")
    checked = run("check", tmp_path / "in.xml")
    assert message in checked.stdout
    # What can be a slit is certified as one, with a word.
    assert checked.exit_code == (0 if name in ("gap", "gap and knots") else 1)
    result = run("refine", tmp_path / "in.xml", "-o", tmp_path / "out.xml", *advised(checked.stdout))
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    again = run("check", tmp_path / "out.xml", "--json", tmp_path / "r.json")
    assert again.exit_code == 0, again.output
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["unglued"] == []
    assert report["topology"]["boundary_loops"] == 1


@pytest.mark.parametrize("name", ["knots", "degrees", "T-junction", "gap", "gap and knots"])
def test_a_transfer_names_them_too_and_works_afterwards(tmp_path, name):
    patches, message = BROKEN[name]
    pt.write(MultiPatch(patches), tmp_path / "in.xml")
    box = np.ptp(np.concatenate([p.control_points.reshape(-1, 2) for p in patches]), axis=0)
    x, y = 1.2 * box
    (tmp_path / "target.csv").write_text(f"0,0\n{x},0\n{x},{y}\n0,{y}\n")
    arguments = ("-o", tmp_path / "result.xml")
    result = run("transfer", tmp_path / "in.xml", tmp_path / "target.csv", *arguments)
    failed(result, 2, f"2 separate parts: {re.escape(message)}")
    run("refine", tmp_path / "in.xml", "-o", tmp_path / "out.xml", *advised(result.stderr))
    result = run("transfer", tmp_path / "out.xml", tmp_path / "target.csv", *arguments)
    assert result.exit_code == 0, result.output


def listed(patches, tmp_path):
    """A file that lists the interface of two patches whatever they are."""
    fitting = MultiPatch([A, B])
    pt.write(fitting, tmp_path / "fitting.xml")
    rows = re.search(r"<interfaces>.*?</interfaces>", (tmp_path / "fitting.xml").read_text(), re.DOTALL)[0]
    pt.write(MultiPatch(patches, []), tmp_path / "in.xml")
    text = re.sub(r"<boundary>.*?</boundary>", rows, (tmp_path / "in.xml").read_text(), flags=re.DOTALL)
    (tmp_path / "in.xml").write_text(text)
    return tmp_path / "in.xml"


@pytest.mark.parametrize("name", ["knots", "degrees", "gap", "wide overlap"])
def test_listed_interfaces_that_differ_are_read_with_a_warning_that_works(tmp_path, name):
    path = listed(BROKEN[name][0], tmp_path)
    with pytest.warns(pt.InputWarning, match="interface patch 0 east - patch 1 west: .*left apart") as caught:
        loose = pt.read(path)
    assert loose.interfaces == ()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        options = advised(str(caught[0].message))
    result = run("refine", path, "-o", tmp_path / "out.xml", *options)
    assert result.exit_code == 0, result.output
    assert pt.certify(pt.read(tmp_path / "out.xml")).injective
    assert len(pt.read(tmp_path / "out.xml").interfaces) == 1


def test_listed_interfaces_of_sides_that_do_not_meet_are_refused(tmp_path):
    path = listed([A, quad((1.5, 0), (2, 0), (2, 1), (1.5, 1))], tmp_path)
    failed(run("check", path), 2, "0.5 apart.*leave the interfaces out")


def test_the_report_tells_what_was_done(tmp_path):
    pt.write(MultiPatch(BROKEN["gap and knots"][0]), tmp_path / "in.xml")
    options = ("--conform", "--weld", "1e-4", "--json", "-")
    result = run("refine", tmp_path / "in.xml", "-o", tmp_path / "out.xml", *options)
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert report["conform"]["moved"] == pytest.approx(5e-5)
    assert report["conform"]["origins"] == [0, 1]
    assert any("gap of 1e-4 closed" in note for note in report["conform"]["notes"])
    assert report["conform"]["left"] == []
    assert report["certificate"]["injective"] is True
    assert report["error"] is None


def test_what_is_left_is_a_warning(tmp_path):
    pt.write(MultiPatch(BROKEN["gap"][0]), tmp_path / "in.xml")
    result = run("refine", tmp_path / "in.xml", "-o", tmp_path / "out.xml", "--conform")
    assert result.exit_code == 0
    assert re.fullmatch(r"warning: patch 0 east .* 3e-5 apart \(gap\); run .*--weld 3e-5`\n", result.stderr)


def test_bad_options_are_refused(tmp_path):
    pt.write(MultiPatch([A, B]), tmp_path / "in.xml")
    failed(run("refine", tmp_path / "in.xml", "-o", tmp_path / "out.xml", "--weld", "1"), 2, "--conform")
    failed(run("refine", tmp_path / "in.xml", "-o", tmp_path / "out.xml", "--conform", "--weld", "-1"), 2, "weld")
    assert not (tmp_path / "out.xml").exists()


@real.needed
@pytest.mark.parametrize(
    ("name", "weld"),
    [
        ("gismo/lshape_holes", 0),
        ("gismo/g_cal", 0.0083),
        ("gismo/joystick", 1.5),
        ("gismo/mask1eye", 0.0059),
        ("unstructured/4p_ellipseTile", 0),
    ],
)
def test_real_models_conform(tmp_path, name, weld):
    path = real.path(f"real/{name}")
    if not path.exists():
        pytest.skip(f"{path} is missing")
    # Interfaces are found: rows of the older format are another matter.
    text = re.sub(r"<(interfaces|boundary)>.*?</\1>", "", path.read_text(), flags=re.DOTALL)
    (tmp_path / "in.xml").write_text(text)
    result = run("refine", tmp_path / "in.xml", "-o", tmp_path / "out.xml", "--conform", "--weld", weld)
    assert result.exit_code == 0, result.output
    assert run("check", tmp_path / "out.xml").exit_code == 0
