"""What an import loads: users pay for what they work with."""

import subprocess
import sys

import pytest

HEAVY = ("dask", "distributed", "matplotlib", "scipy.interpolate", "scipy.optimize", "scipy.special", "scipy.spatial")


def loaded_after(code: str) -> set[str]:
    report = f"{code}\nimport sys; print('\\n'.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", report], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_the_package_itself_loads_no_numerics():
    assert loaded_after("import patchtransfer").isdisjoint({"numpy", "scipy", *HEAVY})


@pytest.mark.parametrize("arguments", [["--version"], ["--help"], ["transfer", "--help"], ["batch", "--help"]])
def test_help_and_version_answer_without_numerics(arguments):
    code = f"""
from patchtransfer.cli import main
try:
    main({arguments!r})
except SystemExit as end:
    assert end.code == 0
"""
    assert loaded_after(code).isdisjoint({"numpy", "scipy", *HEAVY})


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
    assert names.isdisjoint(UNUSED)
    assert names.isdisjoint(f"patchtransfer.{room}" for room in UNENTERED)
    assert (tmp_path / "out.xml").exists()
