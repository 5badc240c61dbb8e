"""The check of the built pages finds what is wrong with them."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("sphinx")
sys.path.append(str(Path(__file__).parents[2] / "docs" / "_ext"))
import checked_pages


def warnings(folder: Path, monkeypatch, **pages: str) -> list[str]:
    """What is said about these pages."""
    for name, text in pages.items():
        path = folder / f"{name.replace('__', '/')}.html"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"<html><body>{text}</body></html>")
    found: list[str] = []
    monkeypatch.setattr(checked_pages.LOGGER, "warning", lambda text, *values: found.append(text % values))
    config = SimpleNamespace(sphinx_gallery_conf={}, plot_gallery="True")
    app = SimpleNamespace(builder=SimpleNamespace(format="html"), outdir=str(folder), config=config)
    checked_pages.checked(app, None)
    return found


def test_what_is_right_passes(tmp_path, monkeypatch):
    for name in ("a picture.png", "sphx_glr_star_001.png"):
        (tmp_path / name).touch()
    assert not warnings(
        tmp_path,
        monkeypatch,
        index='<a href="#here">x</a><p id="here"><a href="other.html#there">x</a><a href="https://a.org/b">x</a>',
        other='<h1 id="there">x</h1><img src="a%20picture.png"><a href=".">x</a>',
        auto_gallery__star='<img src="../sphx_glr_star_001.png">',
        auto_gallery__index="",
    )


@pytest.mark.parametrize(
    ("page", "message"),
    [
        ('<a href="gone.html">x</a>', "no gone.html"),
        ('<a href="#gone">x</a>', "#gone has no such place"),
        ('<img src="gone.png">', "no gone.png"),
        ('<script src="https://a.org/x.js"></script>', "loads https://a.org/x.js"),
        ('<link rel="stylesheet" href="//a.org/x.css">', "loads //a.org/x.css"),
    ],
)
def test_what_is_wrong_is_named(page, message, tmp_path, monkeypatch):
    (found,) = warnings(tmp_path, monkeypatch, index=page)
    assert message in found
    assert found.startswith("index.html")


def test_an_example_without_a_picture_is_named(tmp_path, monkeypatch):
    assert warnings(tmp_path, monkeypatch, auto_gallery__star="<p>x</p>") == [
        "auto_gallery/star.html: the example has no picture"
    ]
