"""Without matplotlib, an extra of the package: all else works, and what draws says so before any work is lost."""

import subprocess
import sys

import pytest

import patchtransfer as pt

#: The import of matplotlib fails as where it is not installed.
BLOCKED = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "matplotlib":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
"""
REMEDY = "pip install 'patchtransfer[plot]'"


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", BLOCKED + code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def command(*arguments: str) -> subprocess.CompletedProcess:
    run = f"from patchtransfer.cli import main\nmain({list(arguments)!r})"
    return subprocess.run([sys.executable, "-c", BLOCKED + run], capture_output=True, text=True)


def test_results_and_their_pages_need_no_matplotlib():
    said = python("""
import patchtransfer as pt
result = pt.transfer(*pt.examples.load("star"))
assert "<svg" in result.to_html() and "<img" in result._repr_html_()
print(result.certificate.injective, pt.iga.poisson(result.multipatch).errors.l2 < 1)
""")
    assert said.split() == ["True", "True"]


def test_every_picture_says_what_to_install():
    said = python("""
import warnings
import patchtransfer as pt
source, target, _ = pt.examples.load("star")
boundary = source.boundary()
given = {
    "boundary": (boundary,),
    "c1_spans": (source,),
    "dilatation": (source, source),
    "kinks": ({"source": source},),
    "multipatch": (source,),
    "png": (source,),
    "registration": (boundary, boundary, [[0, 0, 0, 0]]),
    "slope_difference": (source, source),
    "solution": (pt.iga.poisson(source),),
    "transfer": (source, boundary, source),
}
assert {*given, "savefig"} == set(pt.plot.__all__)
for name, arguments in given.items():
    try:
        getattr(pt.plot, name)(*arguments)
    except pt.InputError as error:
        print(error)
""")
    lines = said.splitlines()
    assert len(lines) == len(pt.plot.__all__) - 1
    assert all("needs matplotlib" in line and REMEDY in line for line in lines)


@pytest.mark.parametrize("picture", ["--plot", "--plot-registration"])
def test_a_command_refuses_a_picture_before_it_works(picture, tmp_path):
    output, drawn = tmp_path / "out.xml", tmp_path / "picture.png"
    done = command("transfer", "no-such-source.xml", "no-such-target.svg", "-o", str(output), picture, str(drawn))
    assert done.returncode == 2
    assert f"{drawn}: the picture needs matplotlib" in done.stderr
    assert REMEDY in done.stderr


def test_an_example_is_run_without_its_pictures_and_says_so(tmp_path):
    done = command("examples", "star", "-o", str(tmp_path / "star"))
    assert done.returncode == 0, done.stderr
    assert "no pictures are made" in done.stderr
    assert REMEDY in done.stderr
    assert {"result.xml", "report.json"} <= {path.name for path in (tmp_path / "star").iterdir()}
    assert not list((tmp_path / "star").glob("*.png"))


def test_an_animation_is_refused_before_its_models_are_made(tmp_path):
    done = command("morph", "no-a.xml", "no-b.xml", "-o", str(tmp_path / "frames"), "--gif")
    assert done.returncode == 2
    assert "the animation needs matplotlib" in done.stderr
    assert not (tmp_path / "frames").exists()
