"""Figures show themselves, and keep their text as text."""

import subprocess
import sys
from io import BytesIO
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest

import patchtransfer as pt
from patchtransfer import plot
from patchtransfer.plot.animation import animate

KNOTS = [0, 0, 1, 1]


def box(x: float = 0.0, y: float = 0.0, width: float = 1.0) -> pt.MultiPatch:
    return pt.MultiPatch([pt.Patch((KNOTS,) * 2, (1, 1), [[[x, y], [x, y + 1]], [[x + width, y], [x + width, y + 1]]])])


def test_figures_have_pictures_for_notebooks():
    mp = box()
    shown = [
        plot.multipatch(mp),
        plot.boundary(mp.boundary()),
        plot.transfer(mp, mp.boundary(), mp),
        plot.dilatation(mp, mp),
        plot.registration(mp.boundary(), mp.boundary(), [[0, 0, 0, 0]]),
    ]
    for figure in shown:
        assert figure._repr_png_().startswith(b"\x89PNG")
        assert ElementTree.fromstring(figure._repr_svg_()).tag.endswith("svg")


def test_large_pictures_are_left_to_png(monkeypatch):
    figure = plot.multipatch(box(), iso_lines=3)
    monkeypatch.setattr("patchtransfer.plot.picture.LARGEST_SVG", 100)
    assert figure._repr_svg_() is None
    assert figure._repr_png_()


def test_text_stays_text(tmp_path):
    figure = plot.multipatch(box(), title="Ein Würfel", ids=True)
    plot.savefig(figure, tmp_path / "a.svg")
    texts = [e.text for e in ElementTree.parse(tmp_path / "a.svg").iter("{http://www.w3.org/2000/svg}text")]
    assert {"Ein Würfel", "scaled Jacobian", "0.95", "0"} <= set(texts)
    plot.savefig(figure, tmp_path / "a.pdf")
    # TrueType (42), whose letters can be searched for and edited, and not outlines of glyphs (3).
    data = (tmp_path / "a.pdf").read_bytes()
    assert b"/FontFile2" in data
    assert b"/Type3" not in data


def test_pictures_leave_the_settings_alone():
    before = {name: matplotlib.rcParams[name] for name in ("svg.fonttype", "pdf.fonttype", "svg.hashsalt")}
    plot.multipatch(box())._repr_svg_()
    assert {name: matplotlib.rcParams[name] for name in before} == before


def test_without_windows_it_is_said_how_to_look():
    code = """
import matplotlib; matplotlib.use("agg")
import patchtransfer as pt
mp = pt.MultiPatch([pt.Patch(([0, 0, 1, 1],) * 2, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])])
try:
    pt.plot.multipatch(mp).show()
except pt.InputError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "'agg' has no windows" in done.stdout
    assert "pt.plot.savefig" in done.stdout


def test_animations_are_cropped_to_the_motion(tmp_path):
    """A square that goes right by three and up by one: a frame of four to two, filled to its margins."""
    from PIL import Image

    path = tmp_path / "a.gif"
    animate([box(3 * t, t) for t in (0, 0.5, 1)], path, dpi=50)
    with Image.open(path) as film:
        frames = []
        for k in range(film.n_frames):
            film.seek(k)
            frames.append(np.asarray(film.convert("L")) < 128)
    height, width = frames[0].shape
    assert width == 320
    assert height == pytest.approx(320 * 2.16 / 4.16, abs=2)
    dark = np.any(frames, axis=0)
    for axis, size in ((0, width), (1, height)):
        (at,) = np.nonzero(dark.any(axis=axis))
        assert at[0] < 0.04 * 320
        assert at[-1] > size - 1 - 0.04 * 320


def test_savefig_writes_what_png_gives(tmp_path):
    mp = box()
    plot.savefig(plot.multipatch(mp), tmp_path / "a.png", dpi=110)
    assert (tmp_path / "a.png").read_bytes() == plot.png(mp)
    assert BytesIO(plot.png(mp)).read(4) == b"\x89PNG"
