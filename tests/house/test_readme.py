"""README is true: its blocks run as they are written, its links lead somewhere, its list of commands is whole.

Needs the installed package alone, so that a wheel can be tested by it where there is no checkout.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import patchtransfer as pt

HERE = Path(__file__).resolve()
ROOT = next(folder for folder in HERE.parents if (folder / "README.md").exists())
README = (ROOT / "README.md").read_text()
CHECKOUT = pytest.mark.skipif(not (ROOT / "docs").exists(), reason="only README is here")
URLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]
FILES = f"{URLS['Source']}/blob/main/"
IMAGES = FILES.replace("//github.com/", "//raw.githubusercontent.com/").replace("/blob/", "/")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.DOTALL | re.MULTILINE)


def run(*command: str, folder: Path) -> subprocess.CompletedProcess:
    scripts = str(Path(sys.executable).parent)
    path = os.pathsep.join((scripts, os.environ.get("PATH", "")))
    return subprocess.run(command, cwd=folder, env=os.environ | {"PATH": path}, capture_output=True, text=True)


def test_the_blocks_of_python_run_as_written(tmp_path):
    assert blocks("python")
    for code in blocks("python"):
        done = run(sys.executable, "-c", code, folder=tmp_path)
        assert done.returncode == 0, done.stderr
    assert "certified" in done.stdout
    assert pt.certify(pt.read(tmp_path / "result.xml")).injective


def test_the_commands_run_as_written(tmp_path):
    lines = [line for block in blocks("sh") for line in block.splitlines() if line.startswith("patchtransfer ")]
    assert len(lines) == 3
    done = run("sh", "-ec", "\n".join(lines), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert pt.certify(pt.read(tmp_path / "variant.xml")).injective
    assert pt.certify(pt.read(tmp_path / "own.xml")).injective
    assert "<svg" in (tmp_path / "variant.html").read_text()


def commands(folder: Path) -> list[str]:
    told = run("patchtransfer", "--help", folder=folder).stdout
    return re.findall(r"^  ([a-z]+)  ", told.partition("Commands:")[2], re.MULTILINE)


def test_every_command_is_listed_and_has_its_help(tmp_path):
    names = commands(tmp_path)
    listed = set(re.findall(r"^patchtransfer ([a-z]+)", "".join(blocks("text")), re.MULTILINE))
    assert len(names) > 10
    assert set(names) == listed
    for name in names:
        done = run("patchtransfer", name, "--help", folder=tmp_path)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(f"Usage: patchtransfer {name}")


def links() -> list[str]:
    named = dict(re.findall(r"^\[([^]]+)\]: (\S+)$", README, re.MULTILINE))
    return re.findall(r"\]\(([^)]+)\)", README) + [named[name] for name in re.findall(r"\]\[([^]]+)\]", README)]


def test_links_are_absolute_so_that_an_index_of_packages_shows_them():
    assert [link for link in links() if not re.match(r"https://|#", link)] == []


@CHECKOUT
def test_links_to_files_lead_to_files():
    for prefix in (FILES, IMAGES):
        inside = [link.removeprefix(prefix) for link in links() if link.startswith(prefix)]
        assert inside
        for link in inside:
            name, _, place = link.partition("#")
            assert (ROOT / name).exists(), link
            assert not place or place in anchors(ROOT / name), link


def test_links_within_lead_to_headings():
    assert {link[1:] for link in links() if link.startswith("#")} <= anchors(ROOT / "README.md")


def anchors(page: Path) -> set[str]:
    titles = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
