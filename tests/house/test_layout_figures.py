"""The pictures of the automatic layout come from its stages by one script, and the documentation shows them."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "images" / "automatic_layout"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("figures")
    subprocess.run([sys.executable, str(ROOT / "scripts" / "layout_figures.py"), "-o", str(folder)], check=True)
    return {path.name: path for path in folder.iterdir()}


def test_the_script_draws_the_pictures_that_are_kept(drawn):
    kept = {path.name: path for path in PICTURES.iterdir()}
    assert set(drawn) == set(kept)
    for name, path in kept.items():
        # Fonts differ from machine to machine, and with them widths.
        size, drawn_size = (np.array(Image.open(p).size) for p in (path, drawn[name]))
        assert abs(size - drawn_size).max() <= 0.05 * size.max(), name
        assert path.stat().st_size < 150_000, name


@pytest.mark.parametrize("name", sorted(path.name for path in PICTURES.iterdir()))
def test_a_picture_shows_what_its_page_says(name, drawn):
    """Singularities of valence 3 or 5 in their colours, lines, and mostly paper."""
    pixels = np.asarray(Image.open(drawn[name]).convert("RGB")).astype(int)
    paper = (pixels == 255).all(axis=-1).mean()
    assert 0.3 < paper < 0.95
    if name != "portfolio.png":
        for colour in ((0xEE, 0x8A, 0x1D), (0x24, 0x68, 0xB4)):
            assert (abs(pixels - colour).max(axis=-1) < 8).sum() > 100, colour


def test_every_picture_is_on_a_page_of_the_stages_with_its_words():
    pages = "".join(path.read_text() for path in (ROOT / "docs" / "stages").glob("*.md"))
    shown = dict(
        reversed(pair) for pair in re.findall(r"!\[([^\]]+)\]\(\.\./images/automatic_layout/([\w.]+)\)", pages)
    )
    assert set(shown) == {path.name for path in PICTURES.iterdir()}
    # Sphinx joins lines of such words without a space.
    assert all(len(words.split()) > 8 and "\n" not in words for words in shown.values())
