"""What an import loads: users pay for what they work with."""

import inspect
import os
import subprocess
import sys

import click
import pytest

from patchtransfer.cli import COMMANDS, main

HEAVY = ("dask", "distributed", "matplotlib", "scipy.interpolate", "scipy.optimize", "scipy.special", "scipy.spatial")


def loaded_after(code: str) -> set[str]:
    report = f"{code}\nimport sys; print('\\n'.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", report], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_the_package_itself_loads_no_numerics():
    assert loaded_after("import patchtransfer").isdisjoint({"numpy", "scipy", *HEAVY})


#: What neither help, version nor completion has a use for: each costs from 5 to 450 ms.
UNASKED = {
    "numpy",
    "scipy",
    "rich",
    "jinja2",
    "matplotlib",
    "asyncio",
    "importlib.metadata",
    "logging",
    "platformdirs",
    "subprocess",
    "concurrent",
    "xml",
    "defusedxml",
    "svg",
}
#: Modules of the command line that commands share.
SHARED = {"group", "options", "outlines", "transfer_options", "streams", "support", "watch", "delivery"}
#: Most modules that are loaded for help: a bare interpreter has 33 to 40, click and what it needs 90 more, and one of
#: ours costs from 1 to 3 ms. Now there are 150 at most.
MODULES = 165


def answered(*arguments: str, **environment: str) -> tuple[str, set[str]]:
    """What the command line writes to standard output, and the modules that it has loaded for that."""
    code = f"""
import sys
sys.argv = ["patchtransfer", *{arguments!r}]
from patchtransfer.cli import main
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print("\\n".join(["", "LOADED", *sys.modules]))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={**os.environ, **environment}
    )
    text, _, names = done.stdout.partition("\nLOADED\n")
    return text, set(names.split())


def modules_of_commands(names: set[str]) -> set[str]:
    """The commands whose modules are loaded."""
    return {name.split(".")[2] for name in names if name.startswith("patchtransfer.cli.")} - SHARED


@pytest.mark.parametrize("arguments", [("--version",), ("--help",), *((name, "--help") for name in COMMANDS)])
def test_help_and_version_load_their_command_only(arguments):
    text, names = answered(*arguments)
    assert text.startswith("Usage: patchtransfer" if "--help" in arguments else "patchtransfer, version ")
    assert names.isdisjoint(UNASKED)
    assert modules_of_commands(names) == ({arguments[0]} if arguments[0] in COMMANDS else set())
    assert len(names) <= MODULES


@pytest.mark.parametrize("words", ["patchtransfer tr", "patchtransfer transfer --ref", "patchtransfer batch a b --ref"])
def test_completion_loads_its_command_only(words):
    typed = words.split()
    text, names = answered(_PATCHTRANSFER_COMPLETE="bash_complete", COMP_WORDS=words, COMP_CWORD=str(len(typed) - 1))
    assert text.splitlines() == ["plain,transfer" if typed[1] == "tr" else "plain,--refine"]
    assert names.isdisjoint(UNASKED)
    assert modules_of_commands(names) == (set() if typed[1] == "tr" else {typed[1]})
    assert len(names) <= MODULES


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_of_commands_says_what_their_help_says(name):
    command = main.get_command(click.Context(main), name)
    first = inspect.cleandoc(command.help).split("\n\n")[0]
    assert " ".join(first.split()) == COMMANDS[name]
    assert command.name == name


def test_reading_and_checking_a_model_needs_no_scipy():
    code = """
import pathlib
import patchtransfer as pt
mp = pt.read(pathlib.Path(pt.__file__).parent / "examples/wrench/source.xml")
assert pt.certify(mp).injective
pt.quality(mp), pt.check_continuity(mp)
"""
    names = loaded_after(code)
    assert names.isdisjoint({"scipy", "matplotlib"})


def test_a_transfer_loads_none_of_the_slow_libraries():
    names = loaded_after("import patchtransfer as pt; pt.transfer, pt.TransferPlan, pt.write")
    assert names.isdisjoint(HEAVY)


@pytest.mark.parametrize("continuity", ["c0", "c1", "g1"])
def test_a_transfer_with_landmarks_needs_no_scipy(continuity):
    code = f"""
import pathlib
import patchtransfer as pt
folder = pathlib.Path(pt.__file__).parent / "examples/wrench"
source, target = pt.read(folder / "source.xml"), pt.read_boundary(folder / "target.svg")
landmarks = pt.read_landmarks(folder / "landmarks.csv")
if {continuity!r} == "g1":
    source = source.elevate(3 - min(min(p.degrees) for p in source.patches)).split_spans(2).reduce_continuity(1)
result = pt.TransferPlan(source, {continuity!r}).transfer(target, landmarks, on_failure="return")
assert result.certificate.injective
assert result.rows is None if {continuity!r} == "c0" else result.rows.active > 0
"""
    assert loaded_after(code).isdisjoint({"scipy", "matplotlib"})


#: What a transfer has no use for: each takes from 10 to 450 ms to load, the transfer of the wrench 150.
UNUSED = {
    "scipy",
    "matplotlib",
    "rich",
    "numpy.ma",
    "numpy.polynomial",
    "numpy.random",
    "numpy.testing",
    "numpy.fft",
    "logging",
    "subprocess",
    "zipfile",
    "concurrent",
    "ezdxf",
    "rhino3dm",
    "shapely",
    "PIL",
}
#: Rooms and formats of the package that it does not enter.
ROOMS = ("batch", "iga", "library", "mesh", "motion", "paper", "plot", "sources")
UNENTERED = (*ROOMS, "io.dxf", "io.mask", "io.npz", "io.vtu")


@pytest.mark.parametrize("options", [[], ["--continuity", "c0"], ["-v", "--json", "-"]])
def test_the_command_transfer_loads_what_it_uses_only(options, tmp_path):
    """Of an example: its source in XML, its target in SVG and its landmarks, with all the progress and messages."""
    code = f"""
import pathlib
import patchtransfer as pt
from patchtransfer.cli import main
example = pathlib.Path(pt.__file__).parent / "examples/wrench"
given = [str(example / name) for name in ("source.xml", "target.svg")] + ["--landmarks", str(example / "landmarks.csv")]
try:
    main(["transfer", *given, "-o", {str(tmp_path / "out.xml")!r}, *{options!r}])
except SystemExit as end:
    assert end.code == 0
"""
    names = loaded_after(code)
    assert "patchtransfer.io.svg" in names
    # Who asks for the log listens to the logger.
    assert names.isdisjoint(UNUSED - {"logging"} if "-v" in options else UNUSED)
    assert names.isdisjoint(f"patchtransfer.{room}" for room in UNENTERED)
    assert (tmp_path / "out.xml").exists()
