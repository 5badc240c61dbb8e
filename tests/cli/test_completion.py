"""Completion in shells: of commands, options, choices, names, files and folders."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from patchtransfer import examples
from patchtransfer.cli import COMMANDS, main
from patchtransfer.cli.plot import COLORS


def script(folder, name: str = "patchtransfer"):
    """The command as an installation has it, in a folder."""
    path = folder / name
    path.write_text(f"#!{sys.executable}\nimport sys\nfrom patchtransfer.cli import main\nsys.exit(main())\n")
    path.chmod(0o755)
    return path


def completed(monkeypatch, capsys, words: str) -> list[tuple[str, str]]:
    """Kind and text of what bash is offered for the last of the words."""
    monkeypatch.setattr(sys, "argv", ["patchtransfer"])
    monkeypatch.setenv("_PATCHTRANSFER_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split(" ")) - 1))
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code
    lines = capsys.readouterr().out.splitlines()
    return [tuple(line.split(",", 1)) for line in lines]


@pytest.fixture
def offered(monkeypatch, capsys):
    return lambda words: completed(monkeypatch, capsys, words)


def plain(*texts: str) -> list[tuple[str, str]]:
    return [("plain", text) for text in texts]


def test_commands_and_options(offered):
    assert offered("patchtransfer ") == plain(*sorted(COMMANDS))
    assert offered("patchtransfer co") == plain("compare", "convert")
    assert offered("patchtransfer --v") == plain("--version")
    assert offered("patchtransfer refine --s") == plain("--split", "--smoothness")


def test_choices_and_names(offered):
    assert offered("patchtransfer transfer --continuity ") == plain("c0", "c1", "g1")
    assert offered("patchtransfer batch --refine t") == plain("tolerance")
    assert offered("patchtransfer parameterize --polish ") == plain("scaled_jacobian", "none")
    assert offered("patchtransfer plot m.xml --color s") == plain("scaled_jacobian", "stretch")
    assert offered("patchtransfer examples ") == plain(*sorted(examples.EXAMPLES))


@pytest.mark.parametrize(
    "words",
    [
        "transfer ",
        "transfer s.xml ",
        "transfer s.xml t.svg -o ",
        "transfer s.xml t.svg --landmarks ",
        "batch s.xml a.svg b.svg ",
        "check m.xml --json ",
        "convert m.xml ",
        "library models ",
        "plot m.xml --source ",
    ],
)
def test_files(offered, words):
    assert [kind for kind, _ in offered(f"patchtransfer {words}")] == ["file"]


@pytest.mark.parametrize(
    "words", ["batch s.xml t.svg -o ", "library ", "library models t.svg --cache ", "morph a b -o "]
)
def test_folders(offered, words):
    assert [kind for kind, _ in offered(f"patchtransfer {words}")] == ["dir"]


def test_all_files_and_folders_are_known_as_such():
    """A path that is a text would be completed by nothing."""
    for name in COMMANDS:
        for option in main.get_command(None, name).params:
            shown = option.metavar or ""
            if shown.endswith((".xml", ".png", ".csv", ".html", ".json", ".vtu")) or shown in ("DIR", "FOLDER"):
                assert type(option.type).__name__ in ("Path", "_Folder"), (name, option.name)


def test_colours_are_those_of_plot():
    from patchtransfer.plot.quantities import COLORS as KNOWN

    assert set(COLORS) == {*KNOWN, "none"}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_scripts_of_the_shells(tmp_path, shell):
    environment = {**os.environ, "_PATCHTRANSFER_COMPLETE": f"{shell}_source"}
    done = subprocess.run([script(tmp_path)], capture_output=True, text=True, env=environment, check=True)
    assert f"_PATCHTRANSFER_COMPLETE={shell}_complete" in done.stdout
    if found := shutil.which(shell):
        (tmp_path / "completion").write_text(done.stdout)
        flag = "--no-execute" if shell == "fish" else "-n"
        subprocess.run([found, flag, str(tmp_path / "completion")], check=True)


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_bash_completes(tmp_path):
    script(tmp_path)
    typed = """
eval "$(_PATCHTRANSFER_COMPLETE=bash_source patchtransfer)"
COMP_WORDS=(patchtransfer transfer s.xml t.svg --method p) COMP_CWORD=5
_patchtransfer_completion patchtransfer
echo "${COMPREPLY[@]}"
"""
    environment = {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-c", typed], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout == "paper\n", done.stderr
