"""The command line: exit status, one line of error, nothing written in failures, JSON reports."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import models
import patchtransfer as pt
from commands import arguments, failed, inputs_of_transfer, listing, run
from failing import SLOT, eight, folded_source, moved_hole, notched, plate, rational_source
from patchtransfer.interior.solver import InteriorSolver

PNG = b"\x89PNG\r\n\x1a\n"
KEYS = {
    "certificate": {"injective", "status", "lower_bound", "cells"},
    "quality": {"scaled_jacobian", "condition_number"},
    "continuity": {"c0_gap", "c1_residual", "kink_deg", "as_g1_residual"},
    "registration": {"joints", "confidence", "landmarks", "runner_up"},
}


@pytest.fixture
def files(tmp_path):
    return inputs_of_transfer(tmp_path)


def shaped(data: dict) -> None:
    for key, inner in KEYS.items():
        if key in data:
            assert inner <= set(data[key])
    for name in ("scaled_jacobian", "condition_number"):
        assert set(data["quality"][name]) == {"min", "mean", "max"}
    assert {"mean", "max"} <= set(data["continuity"]["kink_deg"])


# --- success --------------------------------------------------------------------------------------


def test_transfer_writes_everything_that_was_asked_for(files):
    outputs = [files / name for name in ("plot.png", "registration.png", "report.json")]
    result = run(
        *arguments(files, "--landmarks", files / "landmarks.csv"),
        *("--plot", outputs[0], "--plot-registration", outputs[1], "--json", outputs[2]),
    )
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    assert "certified" in result.stdout
    assert "scaled jacobian" in result.stdout
    assert outputs[0].read_bytes().startswith(PNG)
    assert outputs[1].read_bytes().startswith(PNG)
    data = json.loads(outputs[2].read_text())
    shaped(data)
    assert set(KEYS) | {"boundary_error", "timings", "warnings", "error"} <= set(data)
    assert data["certificate"]["injective"] is True
    assert data["error"] is None
    assert data["registration"]["confidence"] == 1
    assert len(data["registration"]["joints"]) == 16
    assert set(data["registration"]["joints"][0]) == {"source", "target"}
    written = pt.read(files / "out.xml")
    rows = pt.read_landmarks(files / "landmarks.csv")
    source, target = pt.read(files / "source.xml"), pt.read_boundary(files / "target.xml")
    assert written == pt.transfer(source, target, rows).multipatch
    assert data["boundary_error"] == pt.transfer(source, target, rows).boundary_error


def test_json_on_standard_output_is_all_there(files):
    result = run(*arguments(files, "--landmarks", files / "landmarks.csv", "--json", "-"))
    assert result.exit_code == 0
    shaped(json.loads(result.stdout))
    assert listing(files) == {"source.xml", "target.xml", "landmarks.csv", "out.xml"}


PAPER = ("--method", "paper")


@pytest.mark.parametrize(
    "options",
    [
        PAPER,
        (*PAPER, "--paper-options", "initial=dirichlet,literal_rows=yes"),
        ("--refine", "auto"),
        ("--fixed-correspondence",),
    ],
)
def test_options_are_accepted(files, options):
    result = run(*arguments(files, "--landmarks", files / "landmarks.csv", *options))
    assert result.exit_code == 0, result.output
    assert (files / "out.xml").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((*PAPER, "--paper-options", "magic=1"), "no option 'magic'"),
        ((*PAPER, "--paper-options", "initial=magic"), "initial must be one of"),
        (("--paper-options", "initial=dirichlet"), 'go with method="paper" only'),
    ],
)
def test_options_of_the_papers_method_are_checked(files, options, message):
    result = run(*arguments(files, "--landmarks", files / "landmarks.csv", *options))
    assert result.exit_code == 2
    assert message in " ".join(result.output.replace("│", " ").split())
    assert not (files / "out.xml").exists()


def test_targets_may_be_points_or_pictures(files):
    mp = models.grid(2, 1, 2, 3)
    pt.write(mp, files / "sheet.xml")
    outline = [(0, 0), (2, 0), (2, 1), (0, 1)]
    (files / "target.csv").write_text("\n".join(f"{x},{y}" for x, y in outline))
    path = "M 0 0 L 2 0 L 2 1 L 0 1 Z"
    (files / "target.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg"><path d="{path}"/></svg>')
    for name in ("target.csv", "target.svg"):
        result = run("transfer", files / "sheet.xml", files / name, "-o", files / "out.xml")
        assert result.exit_code == 0, result.output


def test_warnings_go_to_standard_error(files):
    result = run(*arguments(files))
    assert result.exit_code == 0
    assert "warning: boundary loop 0" in result.stderr
    assert "ambiguous" in result.stderr
    assert "ambiguous" not in result.stdout


def test_plot_has_the_options_of_the_function(files):
    picture, model = files / "p.svg", files / "source.xml"
    options = ("--color", "dilatation", "--source", model, "--ids", "--control-net")
    result = run("plot", model, "-o", picture, *options)
    assert result.exit_code == 0, result.output
    assert ">dilatation<" in picture.read_text()
    assert ">0<" in picture.read_text()
    assert run("plot", model, "-o", picture, "--color", "none").exit_code == 0
    wrong = run("plot", model, "-o", picture, "--color", "dilatation")
    assert wrong.exit_code != 0
    assert "--source" in wrong.output


def test_check_and_plot(files):
    result = run("check", files / "source.xml")
    assert result.exit_code == 0
    assert "8 patches, 8 interfaces, 2 boundary loops" in result.stdout
    result = run("check", files / "source.xml", "--json", "-")
    assert result.exit_code == 0
    data = json.loads(result.stdout)
    shaped(data)
    assert data["topology"]["patches"] == 8
    result = run("check", files / "source.xml", "--json", files / "check.json")
    assert json.loads((files / "check.json").read_text())["certificate"] == data["certificate"]
    result = run("plot", files / "source.xml", "-o", files / "p.png")
    assert result.exit_code == 0, result.output
    assert (files / "p.png").read_bytes().startswith(PNG)


def test_check_tells_extraordinary_vertices(files):
    pt.write(models.o_grid(2, 2), files / "disc.xml")
    data = json.loads(run("check", files / "disc.xml", "--json", "-").stdout)
    assert [v["valence"] for v in data["topology"]["extraordinary_vertices"]] == [3, 3, 3, 3]


def test_help_and_version():
    result = run("--version")
    assert (result.exit_code, result.stdout.strip()) == (0, f"patchtransfer, version {pt.__version__}")
    for command in ([], ["transfer"], ["refine"], ["check"], ["plot"]):
        result = run(*command, "--help")
        assert result.exit_code == 0
        assert "Usage:" in result.stdout


def test_in_a_process_of_its_own(files):
    """Also --threads, which a process can set only once, and standard output that is piped."""
    command = [sys.executable, "-m", "patchtransfer.cli"]
    environment = os.environ | {"COLUMNS": "40"}
    done = subprocess.run(
        [*command, *map(str, arguments(files)), "--threads", "1", "--json", "-"],
        capture_output=True, text=True, env=environment, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"(warning: .*\n)*", done.stderr)
    shaped(json.loads(done.stdout))
    (files / "broken.xml").write_text("<xml><Geometry")
    done = subprocess.run(
        [*command, "check", str(files / "broken.xml")], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 2
    assert done.stdout == ""
    # One line, also where the terminal is narrow.
    assert re.fullmatch(r"error: .*broken\.xml: malformed XML at line 1.*\n", done.stderr)


def test_threads_may_be_given_again_in_the_same_process(files):
    for _ in range(2):
        result = run(*arguments(files, "--landmarks", files / "landmarks.csv", "--threads", "2"))
        assert result.exit_code in (0, 2), repr(result.exception)
        if result.exit_code:
            failed(result, 2, "threads")


# --- status 1 -------------------------------------------------------------------------------------


@pytest.fixture
def doubt(monkeypatch):
    """The optimiser proves all feasible sample targets, so results (not sources) are made doubtful here."""
    real = InteriorSolver.certify

    def doubtful(self, *arguments, **options):
        found = real(self, *arguments, **options)
        return replace(found, injective=False, status="undecided", reasons=("patch 0 is undecided",))

    monkeypatch.setattr(InteriorSolver, "certify", doubtful)


@pytest.mark.usefixtures("doubt")
def test_an_uncertified_result_is_not_written(files):
    before = listing(files)
    outputs = ("--plot", files / "p.png", "--plot-registration", files / "r.png", "--json", files / "r.json")
    result = run(*arguments(files, "--landmarks", files / "landmarks.csv", *outputs))
    failed(result, 1, "no certified map was found .undecided.: patch 0 is undecided")
    assert listing(files) == before
    result = run(*arguments(files, "--landmarks", files / "landmarks.csv", "--json", "-"))
    assert result.exit_code == 1
    data = json.loads(result.stdout)
    shaped(data)
    assert data["certificate"]["injective"] is False
    assert "patch 0" in data["error"]
    assert listing(files) == before


@pytest.mark.usefixtures("doubt")
def test_an_uncertified_result_is_kept_on_demand(files):
    outputs = ("--plot", files / "p.png", "--json", files / "r.json")
    result = run(*arguments(files, "--landmarks", files / "landmarks.csv", "--keep-uncertified", *outputs))
    assert result.exit_code == 1
    assert len(pt.read(files / "out.xml")) == 8
    assert (files / "p.png").exists()
    data = json.loads((files / "r.json").read_text())
    shaped(data)
    assert "undecided" in data["error"]


def test_check_of_a_folded_model(files):
    pt.write(folded_source(), files / "folded.xml")
    result = run("check", files / "folded.xml", "--json", "-")
    assert result.exit_code == 1
    data = json.loads(result.stdout)
    shaped(data)
    assert data["certificate"]["status"] == "folded"
    assert data["certificate"]["cells"][0]["patch"] == 1
    assert data["quality"]["condition_number"]["max"] is None
    result = run("check", files / "folded.xml")
    assert result.exit_code == 1
    assert "patch 1 folds" in result.stdout
    assert run("plot", files / "folded.xml", "-o", files / "p.png").exit_code == 0


@pytest.mark.parametrize("collapse", ["area", "side", "everything"])
def test_check_of_a_collapsed_patch(files, collapse):
    """Numbers without meaning must not break the report."""
    points = models.grid(1, 1, 2, 1, None).patches[0].control_points.copy()
    if collapse == "area":
        points[..., 1] = 0
    elif collapse == "side":
        points[0] = points[0, 0]
    else:
        points[:] = 1.0
    patch = models.grid(1, 1, 2, 1, None).patches[0].with_control_points(points)
    pt.write(pt.MultiPatch([patch], interfaces=[]), files / "flat.xml")
    for extra in ((), ("--json", "-")):
        result = run("check", files / "flat.xml", *extra)
        assert result.exit_code in (1, 2), repr(result.exception)
        assert result.exception is None or isinstance(result.exception, SystemExit), repr(result.exception)
        if extra:
            assert json.loads(result.stdout)["certificate"]["injective"] is False


# --- status 2 -------------------------------------------------------------------------------------


def sub(pattern: str, replacement: str):
    return lambda text: re.sub(pattern, replacement, text, count=1, flags=re.DOTALL)


BROKEN = {
    "malformed": (sub("</xml>", ""), "malformed XML at line"),
    "empty": (lambda _: "", "empty"),
    "nothing": (lambda _: "<xml></xml>", "no Geometry"),
    "nan": (sub(r"(<coefs[^>]*>\s*)[-+.\de]+", r"\1nan"), r"Geometry .*number 1 .nan."),
    "inf": (sub(r"(<coefs[^>]*>\s*)[-+.\de]+", r"\1-inf"), "number 1"),
    "word": (sub(r"(<coefs[^>]*>\s*)[-+.\de]+", r"\1one"), "'one'.*not a number"),
    "truncated": (sub(r"\s[-+.\de]+\s*</coefs>", "</coefs>"), r"\d+ numbers.*need"),
    "decreasing knots": (sub(r"(<KnotVector[^>]*>)[^<]*", r"\g<1>0 0 0 .7 .5 1 1 1"), "decrease"),
    "degree 0": (sub('degree="2"', 'degree="0"'), "degree 0"),
    "too few knots": (sub(r"(<KnotVector[^>]*>)[^<]*", r"\g<1>0 0 1"), "knot"),
    "doctype": (lambda text: text.replace("<xml>", "<!DOCTYPE xml><xml>"), "DOCTYPE"),
    "3-D": (sub('geoDim="2"', 'geoDim="3"'), "need|space|geoDim"),
    "THB": (lambda text: text.replace("TensorBSpline2", "THBSpline2"), "hierarchical"),
    "volumes": (lambda text: text.replace('"TensorBSpline2"', '"TensorBSpline3"'), "volumes"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_sources(files, case):
    change, message = BROKEN[case]
    path = files / "source.xml"
    path.write_text(change(path.read_text()))
    before = listing(files)
    outputs = ("--plot", files / "p.png", "--plot-registration", files / "r.png", "--json", files / "r.json")
    for command in (
        arguments(files, *outputs),
        ("check", path),
        ("check", path, "--json", files / "r.json"),
        ("plot", path, "-o", files / "p.png"),
    ):
        failed(run(*command), 2, f"source.xml: .*({message})")
    assert listing(files) == before
    result = run("check", path, "--json", "-")
    assert result.exit_code == 2
    assert re.search(message, json.loads(result.stdout)["error"])


def test_weights_must_be_positive(files):
    pt.write(rational_source(), files / "source.xml")
    text = (files / "source.xml").read_text()
    assert run("check", files / "source.xml").exit_code in (0, 1)
    failed(run(*arguments(files), "--continuity", "g1"), 2, "patch 1 of the source is rational")
    for weight in ("0", "-1"):
        (files / "source.xml").write_text(re.sub(r"(<weights>\s*)[-+.\de]+", rf"\g<1>{weight}", text, count=1))
        failed(run("check", files / "source.xml"), 2, rf"source\.xml: .*weight {weight} is not positive")


def open_loop(files):
    text = (files / "target.xml").read_text()
    (files / "target.xml").write_text(sub(r"(<coefs[^>]*>\s*)[-+.\de]+", r"\g<1>-0.77")(text))


def write_target(boundary):
    return lambda files: pt.write(boundary(), files / "target.xml")


def both(source, target):
    def change(files):
        pt.write(source(), files / "source.xml")
        pt.write(target(), files / "target.xml")

    return change


BAD_TARGETS = {
    "open": (open_loop, r"target\.xml: .*open"),
    "missing": (lambda files: (files / "target.xml").unlink(), r"target\.xml: no such file"),
    "a folder": (lambda files: ((files / "target.xml").unlink(), (files / "target.xml").mkdir()), r"this is a folder"),
    "crossing itself": (both(lambda: models.grid(1, 1), eight), r"target boundary: .*crosses itself at \("),
    "hole outside": (both(plate, lambda: moved_hole([5, 0])), "lies outside the outer loop"),
    "no hole": (write_target(lambda: models.grid().boundary()), "1 holes and the target 0"),
    "folded source": (lambda files: pt.write(folded_source(), files / "source.xml"), "not an injective.*patch 1"),
}


def test_a_fit_too_coarse_is_not_called_infeasible(files):
    """The target is feasible, so this is "no certified result", not "bad input"."""
    mp, target, landmarks = notched(*SLOT, spans=3)
    both(lambda: mp, lambda: target)(files)
    np.savetxt(files / "landmarks.csv", landmarks, delimiter=",", header="xs,ys,xt,yt", comments="")
    before = listing(files)
    options = "--landmarks", files / "landmarks.csv", "--refine", "never"
    failed(run(*arguments(files, *options)), 1, "source's knots cannot represent")
    assert listing(files) == before


@pytest.mark.parametrize("case", BAD_TARGETS)
def test_bad_input_leaves_nothing_behind(files, case):
    change, message = BAD_TARGETS[case]
    change(files)
    before = listing(files)
    outputs = ("--plot", files / "p.png", "--plot-registration", files / "r.png", "--json", files / "r.json")
    for extra in ((), ("--keep-uncertified",), ("--method", "paper")):
        failed(run(*arguments(files, *outputs, *extra)), 2, message)
    assert listing(files) == before
    result = run(*arguments(files, "--json", "-"))
    assert result.exit_code == 2
    assert re.search(message, json.loads(result.stdout)["error"])
    assert listing(files) == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("xs,ys,xt,yt\n9,9,0,0\n", "landmark row 1: .* off the source boundary"),
        ("xs,ys,xt\n0,0,0\n", r"landmarks\.csv: .*yt"),
        ("xs,ys,xt,yt\n0,nan,0,0\n", r"landmarks\.csv: line 2: NaN"),
        ("xs,ys,xt,yt\n0,a,0,0\n", r"landmarks\.csv: line 2: .*0, a, 0, 0"),
        ("", r"landmarks\.csv: .*empty"),
    ],
)
def test_bad_landmarks(files, text, message):
    (files / "landmarks.csv").write_text(text)
    before = listing(files)
    failed(run(*arguments(files, "--landmarks", files / "landmarks.csv", "--json", files / "r.json")), 2, message)
    assert listing(files) == before


def test_g1_is_refused_with_the_remedy_and_works_after_it(files):
    before = listing(files)
    failed(run(*arguments(files, "--continuity", "g1")), 2, "patchtransfer refine --elevate 1")
    assert listing(files) == before
    done = run("refine", files / "source.xml", "-o", files / "fine.xml", "--elevate", 1, "--smoothness", 1)
    assert done.exit_code == 0
    assert "fine.xml" in done.output
    where = [files / name for name in ("fine.xml", "target.xml", "out.xml", "landmarks.csv")]
    given = [
        "transfer",
        where[0],
        where[1],
        "-o",
        where[2],
        "--landmarks",
        where[3],
        "--continuity",
        "g1",
        "--json",
        "-",
    ]
    data = json.loads(run(*given).stdout)
    assert data["continuity"]["as_g1_residual"] < 1e-11
    assert data["continuity"]["rows"]["active"] > 0
    assert data["continuity"]["rows"]["residual"] < 1e-10


def test_refine_keeps_the_geometry(files):
    options = ("--elevate", 1, "--split", 2, "--smoothness", 0)
    assert run("refine", files / "source.xml", "-o", files / "fine.xml", *options).exit_code == 0
    coarse, fine = pt.read(files / "source.xml"), pt.read(files / "fine.xml")
    assert fine.patches[0].degrees == (3, 3)
    for a, b in zip(coarse.patches, fine.patches, strict=True):
        assert np.unique(b.knots[0], return_counts=True)[1].tolist() == [4, 3, 3, 3, 4]
        np.testing.assert_allclose(a.grid([0.1, 0.7], [0.3, 0.9]), b.grid([0.1, 0.7], [0.3, 0.9]), atol=1e-12)
    failed(run("refine", files / "nothing.xml", "-o", files / "x.xml"), 2, "nothing.xml")
    failed(run("refine", files / "source.xml", "-o", files / "x.dwg"), 2, "cannot write .dwg|unknown format")


@pytest.mark.parametrize("tolerance", ["0", "-1", "2", "nan"])
def test_bad_tolerances(files, tolerance):
    failed(run(*arguments(files, "--fit-tolerance", tolerance)), 2, "fit_tolerance must lie between 0 and 1")


@pytest.mark.parametrize(
    "options",
    [
        ["--continuity", "c7"],
        ["--method", "x"],
        ["--threads", "0"],
        ["--threads", "x"],
        ["--no-such"],
        ["--refine", "x"],
    ],
)
def test_bad_usage(files, options):
    before = listing(files)
    result = run(*arguments(files, *options))
    assert result.exit_code == 2
    assert "Usage:" in result.stderr
    assert options[0] in result.stderr
    assert listing(files) == before


OUTPUTS = ["-o", "--plot", "--plot-registration", "--json"]


def with_output(files, option: str, path):
    given = {"-o": files / "out.xml", "--plot": files / "p.png", "--json": files / "r.json"} | {option: path}
    flat = [x for pair in given.items() for x in pair]
    return "transfer", files / "source.xml", files / "target.xml", "--landmarks", files / "landmarks.csv", *flat


@pytest.mark.parametrize("option", OUTPUTS)
def test_output_folders_that_do_not_exist(files, option):
    before = listing(files)
    suffix = {"-o": "xml", "--json": "json"}.get(option, "png")
    failed(run(*with_output(files, option, files / "no" / f"x.{suffix}")), 2, "folder .*no does not exist")
    assert listing(files) == before


@pytest.mark.parametrize("option", OUTPUTS)
def test_outputs_that_cannot_be_written(files, option, monkeypatch):
    locked = files / "locked"
    locked.mkdir()
    before = listing(files)
    suffix = {"-o": "xml", "--json": "json"}.get(option, "png")
    # The super-user may write anywhere, so permissions are told, not set.
    real = os.access
    monkeypatch.setattr(os, "access", lambda p, mode: "locked" not in str(p) and real(p, mode))
    failed(run(*with_output(files, option, locked / f"x.{suffix}")), 2, "cannot be written")
    (files / f"folder.{suffix}").mkdir()
    failed(run(*with_output(files, option, files / f"folder.{suffix}")), 2, "cannot be written|is a folder")
    assert listing(files) == before | {f"folder.{suffix}"}
    assert listing(locked) == set()


@pytest.mark.parametrize("option", ["-o", "--plot", "--plot-registration"])
def test_wrong_extensions_leave_nothing_behind(files, option):
    before = listing(files)
    failed(run(*with_output(files, option, files / "x.foo")), 2, r"x\.foo")
    assert listing(files) == before


def test_an_existing_output_survives_a_failure(files):
    (files / "out.xml").write_text("precious")
    (files / "landmarks.csv").write_text("xs,ys,xt,yt\n9,9,0,0\n")
    assert run(*arguments(files, "--landmarks", files / "landmarks.csv")).exit_code == 2
    assert (files / "out.xml").read_text() == "precious"


def test_paths_are_printed_as_they_are(files):
    """Square brackets mean something to the library that prints."""
    failed(run("check", files / "a[bold]b.xml"), 2, r"a\[bold\]b\.xml: no such file")


def test_ctrl_c(files, monkeypatch):
    def interrupt(_, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr(pt.io, "read_boundary", interrupt)
    failed(run(*arguments(files)), 130, "interrupted; nothing was written")


def test_landmarks_that_are_written_give_the_same_correspondence(tmp_path):
    folder = inputs_of_transfer(tmp_path)
    given = folder / "source.xml", folder / "target.xml"
    found = folder / "found.csv"
    done = run("transfer", *given, "-o", folder / "a.xml", "--write-landmarks", found, "--json", folder / "a.json")
    assert done.exit_code == 0, done.output
    rows = pt.read_landmarks(found)
    joints = json.loads((folder / "a.json").read_text())["registration"]["joints"]
    lines = found.read_text().splitlines()
    assert lines[0] == "name,xs,ys,xt,yt"
    for line, row in zip(lines[1:], rows, strict=True):
        joint = joints[int(line.split(",")[0])]
        np.testing.assert_allclose([*joint["source"], *joint["target"]], row, atol=1e-9)
    done = run("transfer", *given, "-o", folder / "b.xml", "--landmarks", found, "--json", folder / "b.json")
    assert done.exit_code == 0, done.output
    again = json.loads((folder / "b.json").read_text())["registration"]["joints"]
    for a, b in zip(joints, again, strict=True):
        np.testing.assert_allclose(a["target"], b["target"], atol=0.02)
    assert run("transfer", *given, "-o", folder / "c.xml", "--write-landmarks", folder / "c.txt").exit_code == 2
