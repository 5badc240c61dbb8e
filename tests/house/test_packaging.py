"""What a release is made from says the same everywhere: version, requirements, addresses; its actions are pinned."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

import patchtransfer as pt

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def test_the_version_stands_in_one_place_and_is_repeated_truly():
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    assert PROJECT["dynamic"] == ["version"]
    assert pt.__version__ == version
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f'\n  version: "{version}"\n' in (ROOT / "packaging" / "conda" / "recipe.yaml").read_text()


def test_the_conda_recipe_asks_for_what_the_package_does():
    recipe = pytest.importorskip("yaml").safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text())
    wanted = {*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"}
    assert {line.replace(" ", "") for line in recipe["requirements"]["run"]} == wanted
    command = re.fullmatch(r"(\S+) = (\S+)", recipe["build"]["python"]["entry_points"][0])
    assert command is not None
    assert {command[1]: command[2]} == PROJECT["scripts"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_actions_are_pinned_to_a_commit_and_say_which_version_it_is(path):
    used = re.findall(r"uses: (.*)", path.read_text())
    assert used
    assert [line for line in used if not re.fullmatch(r"[\w.-]+/[\w.-]+@[0-9a-f]{40} # v[\d.]+", line)] == []


def test_the_changelog_is_of_the_known_form():
    headings = re.findall(r"^##+ (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert headings[0] == "[Unreleased]"
    assert all(line in kinds or re.fullmatch(r"\[[\d.]+\] - \d{4}-\d\d-\d\d", line) for line in headings[1:])


@pytest.mark.parametrize(
    ("ref", "repository", "complaint"),
    [
        ("refs/heads/main", "patchtransfer/patchtransfer", None),
        ("refs/heads/main", "somebody/fork", "mend the addresses"),
        ("refs/tags/v99.0.0", "patchtransfer/patchtransfer", "the tag is v99.0.0"),
    ],
)
def test_a_release_is_refused_that_contradicts_itself(ref, repository, complaint):
    script = ROOT / "scripts" / "check_release"
    done = subprocess.run([str(script), ref, repository], capture_output=True, text=True)
    assert (done.returncode == 0) is (complaint is None)
    assert complaint is None or complaint in done.stderr


def test_no_file_holds_the_marks_of_a_merge():
    """Where a page holds both sides of a conflict, it still builds."""
    texts = [path for kind in ("*.md", "*.rst", "*.toml", "*.yml", "*.yaml") for path in ROOT.rglob(kind)]
    mine = [path for path in texts if not {"target", ".venv", "_build", "auto_gallery", "generated"} & set(path.parts)]
    assert len(mine) > 60
    marks = re.compile(r"^(<{7}|>{7}) ", re.MULTILINE)
    assert [path for path in mine if marks.search(path.read_text(encoding="utf-8"))] == []
