"""Whatever a file holds, a disk refuses or a user interrupts: a status, at most one line, and no traceback."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import models
import patchtransfer as pt
import targets
from commands import failed, run
from patchtransfer import files as whole_files
from patchtransfer import interruption, limits
from patchtransfer.cli.support import all_or_nothing
from patchtransfer.files import json_text
from patchtransfer.io import points, safe_xml
from patchtransfer.io.loops import chain

PROGRAM = [sys.executable, "-m", "patchtransfer.cli"]
SQUARE = {"vertices": [[0, 0], [1, 0], [1, 1], [0, 1]], "quads": [[0, 1, 2, 3]], "boundary": "square.csv"}


@pytest.fixture
def files(tmp_path):
    """A folder with a model, a target and a layout's boundary."""
    mp = models.grid(2, 1, 2, 2)
    pt.write(mp, tmp_path / "a.xml")
    pt.write(targets.deformed(mp, targets.bend(mp, 20))[0], tmp_path / "target.xml")
    (tmp_path / "square.csv").write_text("0,0\n1,0\n1,1\n0,1\n")
    return tmp_path


def drawing(content: str) -> str:
    return f'<svg xmlns="http://www.w3.org/2000/svg">{content}</svg>'


# --- files ----------------------------------------------------------------------------------------


def changed(**fields) -> str:
    return json.dumps(SQUARE | fields)


LAYOUTS = {
    "nested": ('{"vertices":' + "[" * 5000, "nested"),
    "long number": (changed(degree=3).replace('"degree": 3', '"degree": ' + "9" * 5000), "5000 digits"),
    "NUL": (changed(boundary="a\0b"), "NUL"),
    "NaN": (changed().replace("[1, 1]", "[1, NaN]"), "NaN is not a number"),
    "infinite": (changed().replace("[1, 1]", "[1, 1e999]"), '"vertices": number 2'),
    "text": (changed(vertices=[["0", "0"], [1, 0], [1, 1], [0, 1]]), '"vertices": number 0'),
    "ragged": (changed(quads=[[0, [], 2, 3]]), '"quads": number 0'),
    "triangle": (changed(quads=[[0, 1, 2, 3], [0, 1, 2]]), '"quads": number 1'),
    "truth": (changed(quads=[[0, True, 2, 3]]), '"quads": number 0'),
    "degree": (changed(degree=100_000), "100000 as degree, at most 10"),
    "spans": (changed(spans=100_000_000), "more than 10.15 control points|10000.* control points, at most 50000"),
    "assignment": (changed(assignment={"0": [float("1e200"), 0]}), "assignment"),
    "assigned NaN": (changed(assignment={"0": ["nan", 0]}), "assignment"),
    "points coincide": (changed(vertices=[[0, 0], [1, 0], [1, 1], [0, 1e-200]]), r"edge \(3, 0\) has no length"),
    "far": (changed(vertices=[[0, 0], [1, 0], [1, -1e150], [0, 1]]), r"edge \(0, 1\) has no length"),
}


@pytest.mark.parametrize("case", LAYOUTS)
def test_layouts(files, case):
    text, message = LAYOUTS[case]
    (files / "layout.json").write_text(text)
    failed(run("build", files / "layout.json", "-o", files / "out.xml"), 2, rf"layout\.json: .*({message})")
    assert not (files / "out.xml").exists()


@pytest.mark.parametrize("field", ["vertices", "quads"])
def test_layouts_with_too_many_entries(files, field):
    many = {"vertices": [[0, 0]] * 5000, "quads": [[0, 1, 2, 3]] * 5000}[field]
    (files / "layout.json").write_text(changed(**{field: many}))
    failed(run("build", files / "layout.json", "-o", files / "out.xml"), 2, f"5000 {field}, at most")


def test_ragged_quads_from_python():
    with pytest.raises(pt.InputError, match="shape"):
        pt.QuadLayout([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, [], 2, 3]])


def test_groups_may_be_nested_thousands_deep(files):
    path = '<path d="M0 0h2v1h-2z"/>'
    (files / "deep.svg").write_text(drawing('<g transform="translate(1 0)">' * 3000 + path + "</g>" * 3000))
    boundary = pt.read_boundary(files / "deep.svg")
    assert boundary.loops[0][0].start.tolist() == [3000.0, 0.0]


def test_an_arc_without_radius_is_a_line_without_a_word(files):
    (files / "target.svg").write_text(drawing('<path d="M0 0h2a0 1 0 0 1 0 1h-2z"/>'))
    result = run("transfer", files / "a.xml", files / "target.svg", "-o", files / "out.xml")
    assert result.exit_code == 0, result.output
    assert "Arc" not in result.stderr


PICTURES = {
    "segments": ('<path d="M0 0' + "h1v1" * 30_000 + 'z"/>', "60000 path segments|6000[0-9] path segments"),
    "numbers": ('<path d="M0 0' + "h1" * 800_000 + 'z"/>', "80000[0-9] numbers in <path> number 1"),
    "shapes": ("<circle r='1'/>" * 1200, "1001 subpaths and shapes, at most 1000"),
    "tags": ("<g/>" * 1_000_001, "tags, at most 1000000"),
}


@pytest.mark.parametrize("case", PICTURES)
def test_pictures(files, case):
    content, message = PICTURES[case]
    (files / "target.svg").write_text(drawing(content))
    failed(run("transfer", files / "a.xml", files / "target.svg", "-o", files / "out.xml"), 2, message)


def test_a_scanned_outline_with_thousands_of_corners(files, monkeypatch):
    monkeypatch.setattr("patchtransfer.registration.register.MAX_CORNERS", 100)
    (files / "target.svg").write_text(drawing('<path d="M0 0' + "h1v1" * 60 + 'V-1H0z"/>'))
    result = run("transfer", files / "a.xml", files / "target.svg", "-o", files / "out.xml")
    failed(result, 2, "corners of loop 0 of the target boundary, at most 100")


def replaced(pattern: str, replacement: str):
    return lambda text: re.sub(pattern, replacement, text, count=1, flags=re.DOTALL)


MODELS = {
    "degree": (replaced('degree="2"', 'degree="100000"'), "100000 as degree of Geometry id=0"),
    "csize": (
        replaced("<KnotVector.*?</KnotVector>", '<KnotVector degree="2" mode="uniform" csize="99999999"/>'),
        "99999999 as csize of Geometry",
    ),
    "long degree": (replaced('degree="2"', f'degree="{"9" * 5000}"'), "is not a whole number"),
    "long id": (replaced('id="0"', f'id="{"9" * 400}"'), "is not a whole number"),
    "long name": (replaced('"TensorBSpline2"', f'"{"Tensor" * 100_000}"'), "not supported"),
}


@pytest.mark.parametrize("case", MODELS)
def test_models(files, case):
    change, message = MODELS[case]
    (files / "a.xml").write_text(change((files / "a.xml").read_text()))
    result = run("check", files / "a.xml")
    failed(result, 2, message)
    assert len(result.stderr) < 3000


@pytest.mark.parametrize(
    ("module", "name", "message"),
    [
        ("patchtransfer.io.gismo.splines", "MAX_PATCHES", "2 patches, at most 1"),
        ("patchtransfer.io.gismo.splines", "MAX_CONTROL_POINTS", "control points, at most 1"),
        ("patchtransfer.io.gismo.splines", "MAX_ALONG", "control points in one direction of Geometry id=0"),
        ("patchtransfer.io.safe_xml", "MAX_TAGS", "tags, at most 1"),
    ],
)
def test_bounds_of_models(files, monkeypatch, module, name, message):
    monkeypatch.setattr(f"{module}.{name}", 1)
    failed(run("check", files / "a.xml"), 2, message)


def test_bounds_of_curves(files, monkeypatch):
    monkeypatch.setattr("patchtransfer.io.gismo.splines.MAX_CURVES", 3)
    failed(run("transfer", files / "a.xml", files / "target.xml", "-o", files / "o.xml"), 2, "curves, at most 3")
    monkeypatch.undo()
    monkeypatch.setattr("patchtransfer.io.gismo.splines.MAX_BOUNDARY_POINTS", 5)
    failed(run("transfer", files / "a.xml", files / "target.xml", "-o", files / "o.xml"), 2, "points of the boundary")


def test_bounds_of_points(files):
    (files / "many.csv").write_text("\n".join(f"{i},{i * i}" for i in range(limits.MAX_CURVES + 1)))
    failed(run("transfer", files / "a.xml", files / "many.csv", "-o", files / "o.xml"), 2, "50001 points, at most")
    with pytest.raises(pt.InputError, match="line ends"):
        points.read_boundary(b"\n" * (2 * limits.MAX_LINES + 1))
    rows = "0,0,0,0\n" * (limits.MAX_LANDMARKS + 1)
    with pytest.raises(pt.InputError, match="1001 landmarks, at most 1000"):
        points.read_landmarks(b"xs,ys,xt,yt\n" + rows.encode())


def test_large_and_endless_files(files, monkeypatch):
    monkeypatch.setattr(whole_files, "MAX_FILE_BYTES", 2**20)
    (files / "large.xml").write_bytes(b"<" * (2**20 + 1))
    failed(run("check", files / "large.xml"), 2, r"large\.xml: larger than 1 MB")
    if os.path.exists("/dev/zero"):
        failed(run("check", "/dev/zero"), 2, "/dev/zero: larger than 1 MB")
    assert safe_xml.parse_xml(b"<xml/>").tag == "xml"


def test_thousands_of_curves_that_meet_in_a_point():
    """Neither all pairs of ends nor all pairs of curves are looked at."""
    lines = [pt.BSplineCurve([0, 0, 1, 1], 1, [[0, 0], [1, i]]) for i in range(20_000)]
    begin = time.perf_counter()
    with pytest.raises(pt.InputError, match=r"meet at|is open"):
        chain([f"curve {i}" for i in range(len(lines))], lines, 1e-6)
    same_ends = [pt.BSplineCurve([0] * 3 + [1] * 3, 2, [[0, 0], [1, i], [1, 0]]) for i in range(5_000)]
    with pytest.raises(pt.InputError, match="meet at"):
        chain([f"curve {i}" for i in range(len(same_ends))], same_ends, 1e-6)
    # All pairs took minutes.
    assert time.perf_counter() - begin < 20


def test_refining_stays_readable(files):
    for _ in range(3):
        result = run("refine", files / "a.xml", "-o", files / "b.xml", "--split", 64)
        if result.exit_code:
            break
        os.replace(files / "b.xml", files / "a.xml")
    failed(result, 2, "control points.*at most .*split less")
    failed(run("refine", files / "a.xml", "-o", files / "b.xml", "--elevate", 10, "--split", 64), 2, "split less|raise")


def test_too_many_frames(files, monkeypatch):
    monkeypatch.setattr("patchtransfer.limits.MAX_FRAME_POINTS", 100)
    failed(run("morph", files / "a.xml", files / "a.xml", "-o", files / "m"), 2, "of all frames, at most 100")
    assert not (files / "m").exists()


def test_numbers_that_json_has_not_are_null(files):
    text = (files / "a.xml").read_text()
    tiny = re.sub(r"(<KnotVector[^>]*>)[^<]*", r"\g<1>0 0 0 1e-200 1e-200 1e-200", text)
    mp = models.grid(1, 1, 2, 1, None)
    pt.write(mp, files / "b.xml")
    tiny = re.sub(r"(<KnotVector[^>]*>)[^<]*", r"\g<1>0 0 0 1e-200 1e-200 1e-200", (files / "b.xml").read_text())
    (files / "b.xml").write_text(tiny)
    result = run("check", files / "b.xml", "--json", files / "c.json")
    assert result.exit_code in (0, 1), result.output

    def refuse(name):
        raise AssertionError(name)

    json.loads((files / "c.json").read_text(), parse_constant=refuse)
    content = {"a": [float("nan"), (1.5, float("-inf"))], "b": {"c": np.float64("inf")}, "d": None}
    assert json.loads(json_text(content)) == {"a": [None, [1.5, None]], "b": {"c": None}, "d": None}


@pytest.mark.parametrize(("light", "status"), [(1e-16, 0), (1e-17, 2), (5e-324, 2)])
def test_weights_of_extreme_ratios(files, light, status):
    """The side is glued to the patch itself; slopes of weights beyond the bound once overflowed there."""
    knots = ([0, 0, 1, 1], [0, 0, 0.5, 1, 1])
    points = [[[0, 0], [0, 0.5], [0, 1]], [[1, 0], [1, 0.5], [1, 1]]]
    moved = np.array(points) + np.array([1, 0])
    weights = [[1, 1, 1], [1, 0.25, 1]], [[1, 0.25, 1], [1, 1, 1]]
    patches = [pt.Patch(knots, (1, 1), p, w) for p, w in zip((points, moved), weights, strict=True)]
    model = pt.MultiPatch(patches)
    assert len(model.interfaces) == 1
    pt.write(model, files / "b.xml")
    (files / "b.xml").write_text((files / "b.xml").read_text().replace("0.25", repr(light)))
    result = run("check", files / "b.xml", "--json", files / "c.json")
    if status:
        failed(result, status, "Geometry id=0 .*: weights from .* to 1; they may differ by a factor of 1e.16")
    else:
        assert result.exit_code in (0, 1), result.output
        assert np.isfinite(json.loads((files / "c.json").read_text())["continuity"]["as_g1_residual"])


def test_own_warnings_are_one_line_and_others_none(files, monkeypatch):
    text = (files / "a.xml").read_text()
    block = re.search("<MultiPatch.*</MultiPatch>", text, re.DOTALL)[0]
    (files / "a.xml").write_text(text.replace(block, block + block))
    real = pt.io.gismo.multipatch.parse_xml

    def noisy(data):
        import warnings

        warnings.warn("a library has something to say", DeprecationWarning, stacklevel=1)
        return real(data)

    monkeypatch.setattr(pt.io.gismo.multipatch, "parse_xml", noisy)
    result = run("check", files / "a.xml")
    assert result.exit_code == 0, result.output
    told = "the file holds 2 MultiPatch blocks; the first is read, the others are kept as they are"
    assert result.stderr == f"warning: {told}\n"


# --- errors that nobody thought of ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (RuntimeError("far from it"), "unexpected RuntimeError: far from it .please report"),
        (MemoryError(), "not enough memory"),
        (RecursionError("deep"), "unexpected RecursionError"),
        (OSError(28, "No space left on device", "x.png"), "x.png: No space left"),
    ],
)
def test_unexpected_errors(files, monkeypatch, error, message):
    def fail(_):
        raise error

    monkeypatch.setattr(pt.io, "read", fail)
    failed(run("check", files / "a.xml"), 2, message)
    result = run("check", files / "a.xml", "--json", "-")
    assert result.exit_code == 2
    assert re.search(message, json.loads(result.stdout)["error"])
    monkeypatch.setenv("PATCHTRANSFER_TRACEBACK", "1")
    assert run("check", files / "a.xml").exception is error


# --- outputs that take nothing --------------------------------------------------------------------

full = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device that is always full")


def to_full(*arguments):
    with open("/dev/full", "wb") as nowhere:
        return subprocess.run([*PROGRAM, *map(str, arguments)], stdout=nowhere, stderr=subprocess.PIPE, text=True)


@full
@pytest.mark.parametrize("options", [("check", "a.xml"), ("check", "a.xml", "--json", "-"), ("--help",), ("examples",)])
def test_a_full_disk_at_standard_output(files, monkeypatch, options):
    monkeypatch.chdir(files)
    done = to_full(*options)
    assert done.returncode == 2
    assert re.fullmatch(r"error: .*No space left on device.*\n", done.stderr), done.stderr


@full
def test_a_result_that_cannot_be_announced_is_not_written(files, monkeypatch):
    monkeypatch.chdir(files)
    (files / "old.xml").write_text("precious")
    for name in ("new.xml", "old.xml"):
        done = to_full("transfer", "a.xml", "target.xml", "-o", name)
        assert done.returncode == 2, done.stderr
    assert not (files / "new.xml").exists()
    assert (files / "old.xml").read_text() == "precious"


@full
@pytest.mark.parametrize(("name", "status"), [("a.xml", 0), ("none.xml", 2)])
def test_a_full_disk_at_standard_error_keeps_the_status(files, name, status):
    with open("/dev/full", "wb") as nowhere:
        done = subprocess.run([*PROGRAM, "check", str(files / name)], stdout=subprocess.PIPE, stderr=nowhere)
    assert done.returncode == status


def test_names_of_other_encodings_are_printed(files):
    source = os.fsencode(files / "a.xml")
    name = os.path.join(os.fsencode(files), b"\xff.xml")
    try:
        Path(os.fsdecode(name)).touch()
    except OSError:
        pytest.skip("this file system knows Unicode only")
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    for command in ([b"refine", source, b"-o", name], [b"check", name]):
        done = subprocess.run([*PROGRAM, *command], capture_output=True, env=environment)
        assert done.returncode == 0, done.stderr
        assert done.stderr == b""


# --- Ctrl-C ---------------------------------------------------------------------------------------


def interrupted(folder, seconds: float, *arguments) -> subprocess.CompletedProcess:
    """What is left of a command whose process group gets SIGINT after some seconds, as from a terminal."""
    process = subprocess.Popen(
        [*PROGRAM, *map(str, arguments)],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    time.sleep(seconds)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
    out, error = process.communicate(timeout=60)
    return subprocess.CompletedProcess(arguments, process.returncode, out, error)


posix = pytest.mark.skipif(os.name != "posix", reason="process groups")


@posix
@pytest.mark.parametrize("seconds", [0.15, 0.4, 0.8, 1.2, 1.8])
def test_ctrl_c_at_any_moment(files, seconds):
    pt.write(models.plate_with_hole(3, 12), files / "large.xml")
    done = interrupted(files, seconds, "transfer", "large.xml", "large.xml", "-o", "out.xml", "--plot", "p.png")
    assert done.returncode in (130, 0, 1), done.stderr
    if done.returncode == 130:
        assert re.fullmatch(r"(error: interrupted; nothing was written\n)?", done.stderr)
        assert not (files / "out.xml").exists()


@posix
@pytest.mark.parametrize("seconds", [0.3, 0.9, 1.5, 2.2, 3.0])
def test_ctrl_c_while_worker_processes_start_and_work(files, seconds):
    pt.write(models.plate_with_hole(3, 12), files / "large.xml")
    for k in range(6):
        (files / f"t{k}.xml").write_bytes((files / "large.xml").read_bytes())
    names = [f"t{k}.xml" for k in range(6)]
    done = interrupted(files, seconds, "batch", "large.xml", *names, "-o", "out", "--workers", "2")
    assert done.returncode in (130, 0, 1), done.stderr
    if done.returncode == 130:
        assert re.fullmatch(r"(error: interrupted; [^\n]*\n)?", done.stderr), done.stderr


def test_an_interruption_that_a_library_disguised(files, monkeypatch):
    def disguise(_):
        monkeypatch.setattr(interruption, "happened", True)
        raise ImportError("a module could not be loaded")

    monkeypatch.setattr(pt.io, "read", disguise)
    failed(run("check", files / "a.xml"), 130, "interrupted")


def test_a_library_that_closes_down_badly_does_not_change_the_status(files):
    code = f"""
import atexit, os, sys
import patchtransfer.io
from patchtransfer.cli import main

def interrupted(_):
    raise KeyboardInterrupt

atexit.register(os.abort)
patchtransfer.io.read = interrupted
sys.argv = ["patchtransfer", "check", {str(files / "a.xml")!r}]
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "error: interrupted; nothing was written\n")


@posix
def test_ctrl_c_is_held_back_not_lost():
    after = []
    with pytest.raises(KeyboardInterrupt), interruption.held_back():  # noqa: PT012
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.05)
        after.append("still here")
    assert after == ["still here"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interruption_that_a_library_has_swallowed_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(interruption, "happened", True)
    with pytest.raises(KeyboardInterrupt), all_or_nothing(str(tmp_path / "a")):
        (tmp_path / "a").write_text("written")
    assert not (tmp_path / "a").exists()


def test_programs_that_import_the_package_keep_their_ways():
    code = "import signal, patchtransfer; assert signal.getsignal(signal.SIGINT) is signal.default_int_handler"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
