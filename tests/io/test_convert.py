"""From one format to another: what is kept, and what is said about the rest."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import models
import patchtransfer as pt
from commands import failed, listing, run
from patchtransfer import Boundary, InputError, InputWarning, MultiPatch
from patchtransfer.geometry.blocks import Block
from shapes import loop

MODEL = models.grid(2, 1, 2, 2)
LABELLED = MultiPatch(
    MODEL.patches, None, [7, 3], {"inlet": [MODEL.boundaries[0]]}, [Block("G+Smo XML", "boundaryConditions", "<x/>")]
)
OUTLINE = loop([[0, 0], [2, 0], [1, 1]])
LAYOUT = {"vertices": [[0, 0], [1, 0], [1, 1], [0, 1]], "quads": [[0, 1, 2, 3]], "boundary": "square.csv"}
#: Formats that are read and written.
SUFFIXES = (".xml", ".npz", ".json")


@pytest.mark.parametrize("to", SUFFIXES)
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_models_go_from_any_format_to_any_other(tmp_path, suffix, to):
    pt.write(MODEL, tmp_path / f"a{suffix}")
    # Not the name: the content tells the format.
    (tmp_path / f"a{suffix}").rename(tmp_path / "a.txt")
    assert pt.convert(tmp_path / "a.txt", tmp_path / f"b{to}") == MODEL
    assert pt.read(tmp_path / f"b{to}") == MODEL


@pytest.mark.parametrize("to", [".xml", ".npz"])
@pytest.mark.parametrize("text", ["0,0\n2,0\n1,1\n", '<svg><path d="M0 0H2L1-1Z"/></svg>'])
def test_outlines_stay_outlines(tmp_path, text, to):
    (tmp_path / "a").write_text(text)
    converted = pt.convert(tmp_path / "a", tmp_path / f"b{to}")
    assert isinstance(converted, Boundary)
    assert pt.read_boundary(tmp_path / f"b{to}") == converted == pt.read_boundary(tmp_path / "a")
    with pytest.raises(InputError, match=r"written of a MultiPatch, not of a Boundary; use \.xml, \.npz"):
        pt.convert(tmp_path / f"b{to}", tmp_path / "c.vtu")


def test_a_model_with_a_fault_is_not_taken_for_an_outline(tmp_path):
    pt.write(MODEL, tmp_path / "a.xml")
    (tmp_path / "a.xml").write_text((tmp_path / "a.xml").read_text().replace('degree="2"', 'degree="20"'))
    with pytest.raises(InputError, match=r"a\.xml: 20 as degree of Geometry"):
        pt.convert(tmp_path / "a.xml", tmp_path / "b.npz")
    assert listing(tmp_path) == {"a.xml"}


def test_what_a_format_cannot_hold_is_named(tmp_path):
    with pytest.warns(InputWarning) as told:
        pt.write(LABELLED, tmp_path / "a.json")
    assert [str(w.message).removeprefix(str(tmp_path)) for w in told] == [
        "/a.json: splinepy JSON holds no labels of sides (inlet); left out",
        "/a.json: splinepy JSON holds no boundaryConditions of G+Smo XML; left out",
        "/a.json: splinepy JSON holds no ids of patches: they are numbered from 0; left out",
    ]
    apart = MultiPatch(MODEL.patches, ())
    with pytest.warns(InputWarning, match="interfaces: reading finds other ones"):
        pt.write(apart, tmp_path / "b.json")
    pt.write(LABELLED, tmp_path / "c.npz")
    assert pt.read(tmp_path / "c.npz") == LABELLED
    with pytest.warns(InputWarning) as told:
        pt.convert(tmp_path / "c.npz", tmp_path / "d.vtu")
    assert any("VTU holds no boundaryConditions of G+Smo XML" in str(w.message) for w in told)


def test_blocks_of_another_format_are_named_in_gismo_files(tmp_path):
    mp = MultiPatch(MODEL.patches, blocks=[Block("splinepy JSON", "fields", "{}")])
    with pytest.warns(InputWarning, match="G.Smo XML holds no fields of splinepy JSON"):
        pt.write(mp, tmp_path / "a.xml")


def test_json_is_told_apart_by_content(tmp_path):
    (tmp_path / "layout.json").write_text(json.dumps(LAYOUT))
    for function in (pt.read, pt.read_boundary):
        with pytest.raises(InputError, match=r"a layout JSON file holds no .*the command build makes patches"):
            function(tmp_path / "layout.json")
    (tmp_path / "other.json").write_text('{"type": "something"}')
    with pytest.raises(InputError, match="not a list of splines"):
        pt.read(tmp_path / "other.json")


# --- command line ---------------------------------------------------------------------------------


def test_the_command_says_what_it_wrote_and_what_is_left_out(tmp_path):
    pt.write(LABELLED, tmp_path / "a.npz")
    result = run("convert", tmp_path / "a.npz", tmp_path / "b.json")
    assert result.exit_code == 0
    assert re.fullmatch(r"<MultiPatch: 2 patches, .*> written to \S*/b\.json\n", result.stdout)
    lines = result.stderr.splitlines()
    assert len(lines) == 3
    assert all(line.startswith("warning: ") for line in lines)
    assert pt.read(tmp_path / "b.json").patches == MODEL.patches


def test_the_command_refuses_with_one_line_and_writes_nothing(tmp_path):
    pt.write(MODEL, tmp_path / "a.xml")
    for arguments, message in (
        (("a.xml", "a.xml"), "would replace the input"),
        (("a.xml", "b.step"), r"unknown format for a model; use \.xml, \.npz, \.json"),
        (("no.xml", "b.npz"), "no such file"),
        (("a.xml", "no/b.npz"), "does not exist; create it"),
    ):
        failed(run("convert", *(tmp_path / name for name in arguments)), 2, message)
    assert listing(tmp_path) == {"a.xml"}


def test_outlines_on_the_command_line(tmp_path):
    np.savetxt(tmp_path / "a.csv", [[0, 0], [2, 0], [1, 1]], delimiter=",")
    result = run("convert", tmp_path / "a.csv", tmp_path / "b.npz")
    assert result.stdout.startswith("<Boundary: 1 loop of 3 curves> written to")
    assert pt.read_boundary(tmp_path / "b.npz").loops[0][0].start.tolist() == OUTLINE.loops[0][0].start.tolist()
    failed(run("convert", tmp_path / "b.npz", tmp_path / "c.json"), 2, r"not of a Boundary; use \.xml, \.npz")
