"""Every stage has a picture, drawn from the bundled examples by one script, and words that say what is to be seen."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
STAGES = ROOT / "docs" / "stages"
PICTURES = ROOT / "docs" / "images" / "stages"
SHOWN = re.compile(r"!\[([^\]]+)\]\(\.\./images/([\w./]+)\)")
PAGES = sorted(path for path in STAGES.glob("*.md") if path.name != "index.md")


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_a_page_shows_a_picture_and_says_what_is_on_it(page):
    found = SHOWN.findall(page.read_text())
    assert found
    for words, name in found:
        assert len(words.split()) > 8
        assert "\n" not in words
        assert (ROOT / "docs" / "images" / name).exists()


def test_pictures_are_small_and_all_are_shown():
    shown = {name for page in PAGES for _, name in SHOWN.findall(page.read_text()) if name.startswith("stages/")}
    sizes = {f"stages/{path.name}": path.stat().st_size for path in PICTURES.iterdir()}
    assert set(sizes) == shown
    assert max(sizes.values()) <= 60_000
    assert sum(sizes.values()) <= 1_000_000


def test_the_script_draws_what_is_kept(tmp_path):
    # Those that take least; the others are drawn by the same code.
    names = ["certificate", "feasibility", "refinement", "bounded_distortion"]
    subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "stage_figures.py"), "-o", str(tmp_path), *names], check=True
    )
    for name in names:
        kept, drawn = (Image.open(folder / f"{name}.png").convert("RGB") for folder in (PICTURES, tmp_path))
        # Fonts differ from machine to machine, and with them widths.
        assert np.abs(np.subtract(kept.size, drawn.size)).max() <= 0.05 * max(kept.size), name
        grounds = [(np.asarray(picture) == 255).all(axis=-1).mean() for picture in (kept, drawn)]
        assert abs(grounds[0] - grounds[1]) < 0.05, name
        assert 0.3 < grounds[1] < 0.98, name


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_what_is_cited_has_a_link(page):
    text = page.read_text()
    if re.search(r"Paper[^ ]*,? (§|Eq|end)", text):
        assert "10.32604/cmes.2023.028665" in text
    _, _, sources = text.partition("**Sources.**")
    # One link for every title; what the paper says is linked above.
    titles = re.findall(r"(?<!\*)\*[^*]{12,}?\*(?!\*)", sources.partition("\n\n")[0])
    assert len(re.findall(r"\{doi\}`", sources.partition("\n\n")[0])) >= len(titles)
