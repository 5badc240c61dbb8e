"""Which format, which errors, and that writing is all or nothing."""

from __future__ import annotations

import os
import stat
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import patchtransfer as pt
from patchtransfer import InputError, MultiPatch, Patch
from patchtransfer.io import geopdes, gismo, mfem, points, svg

SQUARE = MultiPatch([Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])])
SVG = '<?xml version="1.0"?><!-- <xml> --><svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0h1v1z"/></svg>'


def test_content_decides_and_the_extension_where_it_does_not(tmp_path):
    for name in ("a.svg", "a.xml", "a", "a.dat"):
        (tmp_path / name).write_text(SVG)
        assert len(pt.read_boundary(tmp_path / name).loops[0]) == 3
    for name in ("a.csv", "a.txt", "a.pts"):
        (tmp_path / name).write_text("0,0\n1,0\n0,1\n")
        assert len(pt.read_boundary(str(tmp_path / name)).loops[0]) == 3
    pt.write(SQUARE, tmp_path / "b.xml")
    (tmp_path / "b.xml").rename(tmp_path / "b.txt")
    assert pt.read(tmp_path / "b.txt") == SQUARE
    assert len(pt.read_boundary(tmp_path / "b.txt").loops[0]) == 4


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.xml", None, "no such file"),
        ("folder", "folder", "this is a folder"),
        ("empty.xml", "", "empty"),
        ("blank.xml", "\n \n", "empty"),
        ("model.step", "ISO-10303-21;", "unknown format; supported are .xml"),
        ("outline.csv", "0,0\n1,0\n0,1", "holds no patches; use read_boundary"),
        ("picture.svg", SVG, "holds no patches; use read_boundary"),
        ("broken.xml", "not XML", "malformed XML at line 1"),
    ],
)
def test_what_cannot_be_read_as_a_multipatch(tmp_path, name, content, message):
    path = tmp_path / name
    if content == "folder":
        path.mkdir()
    elif content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        pt.read(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_files_that_may_not_be_opened(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", refuse)
    with pytest.raises(InputError, match="Permission denied"):
        pt.read(tmp_path / "a.xml")


def test_writing_replaces_follows_links_and_obeys_the_umask(tmp_path):
    target, link = tmp_path / "real.xml", tmp_path / "link.xml"
    target.write_text("old")
    link.symlink_to(target)
    old = os.umask(0o027)
    try:
        pt.write(SQUARE, link)
    finally:
        os.umask(old)
    assert link.is_symlink()
    assert pt.read(target) == SQUARE
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    assert sorted(os.listdir(tmp_path)) == ["link.xml", "real.xml"]


def test_what_cannot_be_written_leaves_nothing_behind(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="does not exist; create it"):
        pt.write(SQUARE, tmp_path / "no" / "a.xml")
    with pytest.raises(InputError, match=r"cannot write \.svg; use \.xml"):
        pt.write(SQUARE, tmp_path / "a.svg")
    with pytest.raises(InputError, match="cannot write a Patch"):
        pt.write(SQUARE.patches[0], tmp_path / "a.xml")
    (tmp_path / "folder.xml").mkdir()
    with pytest.raises(InputError, match="this is a folder"):
        pt.write(SQUARE, tmp_path / "folder.xml")
    assert os.listdir(tmp_path) == ["folder.xml"]


@pytest.mark.parametrize("step", ["open", "fsync", "replace"])
def test_a_failure_at_any_step_keeps_the_old_file(tmp_path, monkeypatch, step):
    path = tmp_path / "a.xml"
    path.write_text("old")

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(f"os.{step}", refuse)
    with pytest.raises(InputError, match="No space left"):
        pt.write(SQUARE, path)
    monkeypatch.undo()
    assert os.listdir(tmp_path) == ["a.xml"]
    assert path.read_text() == "old"


SEEDS = [
    (gismo.read_multipatch, gismo.format_multipatch(SQUARE)),
    (gismo.read_boundary, gismo.format_boundary(SQUARE.boundary())),
    (geopdes.read_multipatch, geopdes.format_multipatch(SQUARE)),
    (mfem.read_multipatch, mfem.format_multipatch(SQUARE)),
    (
        svg.read_boundary,
        SVG.replace("h1v1z", "h3 A2 1 30 0 1 2 5 Q1 1 0 1z").replace("<path", '<g/><path transform="scale(2)"'),
    ),
    (points.read_boundary, "x,y\n0,0\n1,0\n1,1\n\n3,3\n4,3\n4.5,4\n3,5\n"),
    (points.read_landmarks, "xs,ys,xt,yt\n1,2,3,4\n5,6,7,8\n"),
]
SNIPPETS = st.sampled_from(
    [
        "",
        "-1",
        "0",
        "1e308",
        "-1e-320",
        "nan",
        "inf",
        "/",
        "<",
        ">",
        '"',
        "&",
        "\n",
        "\0",
        "A",
        "Z",
        "1 1",
        ",",
    ]
)


@settings(max_examples=500, deadline=None)
@given(
    st.sampled_from(SEEDS),
    st.lists(st.tuples(st.floats(0, 1), st.integers(0, 12), SNIPPETS), min_size=1, max_size=3),
)
def test_mangled_files_are_read_or_refused_never_worse(seed, edits):
    reader, text = seed
    for place, cut, snippet in edits:
        i = int(place * len(text))
        text = text[:i] + snippet + text[i + cut :]
    with suppress(InputError):
        reader(text.encode())
