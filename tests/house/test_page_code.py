"""Every block of Python on the pages runs; blocks of one page go on from each other."""

from __future__ import annotations

import re
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import patchtransfer as pt
from patchtransfer import examples

DOCS = Path(__file__).parents[2] / "docs"
#: Run by a test of its own in `test_docs`, which looks at what comes out.
ELSEWHERE = {"guide/hand-it-on.md", "guide/quickstart.md", "guide/studio.md"}
FENCE = re.compile(r"^```\{?(?:python|code-block\} python)\}?\n(.*?)^```", re.DOTALL | re.MULTILINE)
#: A page's built by Sphinx are not pages.
BUILT = ("_build", "auto_gallery", "generated")


def pages() -> dict[str, list[str]]:
    """Pages with Python on them, and their blocks."""
    found = {}
    for path in sorted(DOCS.rglob("*.md")):
        name = path.relative_to(DOCS).as_posix()
        if not name.startswith(BUILT) and (blocks := FENCE.findall(path.read_text())):
            found[name] = blocks
    return found


@pytest.fixture
def files(tmp_path, monkeypatch) -> Path:
    """A folder with what pages read: a source, a drawing, a model with weights, a folder of models."""
    monkeypatch.chdir(tmp_path)
    bundled = Path(examples.__file__).parent / "star"
    shutil.copy(bundled / "source.xml", "source.xml")
    shutil.copy(bundled / "target.svg", "drawing.svg")
    pt.write(examples.load("annulus")[0], "nurbs.xml")
    Path("models").mkdir()
    for name in ("star", "rabbit"):
        pt.write(examples.load(name)[0], f"models/{name}.xml")
    Path("drawings").mkdir()
    pt.write(examples.load("wrench")[0], "wrench.xml")
    shutil.copy(bundled.parent / "wrench" / "target.svg", "drawings/first.svg")
    return tmp_path


@pytest.fixture
def mpi(monkeypatch):
    """A stand-in for mpi4py, which needs MPI: its executor has the interface of all others."""
    futures = ModuleType("mpi4py.futures")
    futures.MPIPoolExecutor = ThreadPoolExecutor
    monkeypatch.setitem(sys.modules, "mpi4py", ModuleType("mpi4py"))
    monkeypatch.setitem(sys.modules, "mpi4py.futures", futures)


def test_no_block_is_left_out():
    # Indented blocks that look like Python would not be run.
    for path in DOCS.rglob("*.md"):
        if not path.relative_to(DOCS).as_posix().startswith(BUILT):
            assert "\n    >>>" not in path.read_text(), path
            assert "\n    import patchtransfer" not in path.read_text(), path
    assert set(pages()) > ELSEWHERE


def several_things() -> dict[str, object]:
    """What a reader of the front page has: targets, and for the last card a boundary and an objective's derivative."""
    source, target, landmarks = examples.load("star")
    frozen = pt.transfer(source, target).freeze()
    return {
        "pt": pt,
        "targets": [target, (target, landmarks)],
        "boundary": 1.01 * frozen.boundary,
        "derivative": np.ones((source.topology.n_points, 2)),
    }


@pytest.mark.parametrize("page", sorted(set(pages()) - ELSEWHERE))
def test_a_page_runs(page, files, mpi, capsys):
    known = {"__name__": "__main__"} | (several_things() if page == "index.md" else {})
    exec("".join(pages()[page]), known)
    if page == "index.md":
        assert known["result"].certificate.injective
        assert known["filled"].certificate.injective
        assert known["slope"].shape == known["boundary"].shape
        assert not known["polynomial"].is_rational
        assert pt.certify(pt.read("result.xml")).injective
    if page == "guide/many-targets.md":
        assert [row.status for row in known["rows"]] == ["certified"]
        assert pt.certify(pt.read("out/first.xml")).injective
    # Where a page shows in its next lines what is printed, that is what is printed.
    shown = re.search(r"print\([^\n]*\n```\n\n((?:    [^\n]*\n)+)", (DOCS / page).read_text())
    if shown and "models" not in shown[1]:
        expected = [line.strip() for line in shown[1].splitlines()]
        assert [line.strip() for line in capsys.readouterr().out.splitlines()][-len(expected) :] == expected
