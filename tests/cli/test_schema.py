"""Reports are what the published schema says, and it says everything."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import domains
import models
import patchtransfer as pt
import reports
import targets
from commands import run
from failing import eight, folded_source
from patchtransfer.cli import COMMANDS, main
from patchtransfer.cli.schema import REPORTING
from reports import SCHEMA

EXAMPLES = Path(pt.__file__).parent / "examples"
#: A report of each kind that a command can come to.
CASES = (
    "transfer c0",
    "transfer c1",
    "transfer g1",
    "transfer paper",
    "transfer polish",
    "transfer landmarks",
    "transfer mirrored",
    "transfer split",
    "transfer infeasible",
    "transfer uncertified",
    "parameterize",
    "library",
    "library ranking",
    "build",
    "refine",
    "refine conform",
    "check",
    "check folded",
    "check none",
    "quality",
    "quality proved",
    "quality folded",
    "compare",
    "poisson",
    "poisson labels",
    "morph",
    "examples",
    "batch",
)


def given(folder: Path, case: str) -> tuple:
    """Arguments of a command for a case, whose files are made."""
    wrench, target = EXAMPLES / "wrench/source.xml", EXAMPLES / "wrench/target.svg"
    out, report = folder / "out.xml", ("--json", folder / "r.json")
    if case.startswith("transfer"):
        source, kind = wrench, case.split()[1]
        more: tuple = ("--continuity", "c0")
        if kind in ("c1", "g1"):
            more = ("--continuity", kind)
            if kind == "g1":
                source = folder / "finer.xml"
                pt.write(pt.read(wrench).split_spans(2).reduce_continuity(1), source)
        elif kind == "paper":
            more = ("--method", "paper")
        elif kind == "polish":
            more = (*more, "--polish", "dilatation")
        elif kind == "landmarks":
            more = (*more, "--landmarks", EXAMPLES / "wrench/landmarks.csv")
        elif kind == "mirrored":
            more, target = (*more, "--mirror", "auto"), folder / "mirror.xml"
            pt.write(targets.deformed(pt.read(wrench), lambda p: p * [-1, 1])[0], target)
        elif kind == "split":
            more, source, target = (*more, "--split", "auto"), folder / "square.xml", folder / "L.xml"
            pt.write(models.grid(1, 1, 2, 4, seed=None), source)
            pt.write(domains.L, target)
        elif kind == "infeasible":
            target = folder / "eight.xml"
            pt.write(eight(), target)
        elif kind == "uncertified":
            more = *more, "--time-limit", 0.001, "--keep-uncertified"
            source, target = EXAMPLES / "rabbit/source.xml", EXAMPLES / "human/target.svg"
        return "transfer", source, target, "-o", out, *report, *more
    pt.write(domains.L, folder / "L.xml")
    pt.write(folded_source(), folder / "folded.xml")
    if case.startswith("library"):
        (folder / "shelf").mkdir()
        for name in ("wrench", "star", "two-hole-plate"):
            pt.write(pt.examples.load(name)[0], folder / "shelf" / f"{name}.xml")
        return "library", folder / "shelf", target, "--no-cache", *report, *(() if "ranking" in case else ("-o", out))
    if case == "build":
        (folder / "layout.json").write_text(
            '{"vertices": [[0, 0], [2, 0], [2, 1], [1, 1], [0, 1], [1, 2], [0, 2], [1, 0]],'
            ' "quads": [[0, 7, 3, 4], [7, 1, 2, 3], [4, 3, 5, 6]], "boundary": "L.xml"}'
        )
    if case in ("morph", "compare"):
        source = pt.read(wrench)
        pt.write(source.with_control_points([1.5 * patch.control_points for patch in source.patches]), folder / "b.xml")
    if case == "poisson labels":
        model = models.grid(2, 1, 2, 2)
        pt.write(model.with_labels({"left": [model.boundaries[0]]}), folder / "labels.xml")
    return {
        "parameterize": ("parameterize", folder / "L.xml", "-o", out, *report),
        "build": ("build", folder / "layout.json", "-o", out, *report),
        "refine": ("refine", wrench, "-o", out, "--split", 2, *report),
        "refine conform": ("refine", wrench, "-o", out, "--conform", *report),
        "check": ("check", wrench, *report),
        "check folded": ("check", folder / "folded.xml", *report),
        "check none": ("check", folder / "none.xml", "--json", "-"),
        "quality": ("quality", wrench, *report),
        "quality proved": ("quality", wrench, "--proved", *report),
        "quality folded": ("quality", folder / "folded.xml", "--proved", *report),
        "compare": ("compare", wrench, folder / "b.xml", *report),
        "poisson": ("poisson", wrench, *report),
        "poisson labels": ("poisson", folder / "labels.xml", "--dirichlet", "left=1", "--load", 2, *report),
        "morph": ("morph", wrench, folder / "b.xml", "-n", 3, "-o", folder / "frames"),
        "examples": ("examples", "star", "-o", folder / "star"),
        "batch": ("batch", wrench, target, folder / "L.xml", "-o", folder / "many", "--workers", 1),
    }[case]


def objects(content: Any, path: tuple = ()) -> Iterator[tuple]:
    """Paths of all objects in a report."""
    if isinstance(content, dict):
        yield path
    for key, item in content.items() if isinstance(content, dict) else enumerate(content):
        if isinstance(item, (dict, list)):
            yield from objects(item, (*path, key))


#: Objects with names of their own for keys: stages, labels, reasons.
NAMES = ("timings", "labels", "c1_obstacles")


@pytest.mark.parametrize("case", CASES)
def test_reports_are_described_and_nothing_else_passes(tmp_path, case):
    arguments = [str(argument) for argument in given(tmp_path, case)]
    result = run(*arguments)
    failing = {"check none": 2, "transfer infeasible": 2, "check folded": 1, "batch": 1, "transfer uncertified": 1}
    assert result.exit_code == failing.get(case, 0), result.output
    found = reports.written(arguments, result.stdout)
    assert found or case == "transfer infeasible"
    for content, names in found:
        assert reports.faults(content, *names) == []
        # Of a list the first entry stands for all.
        for path in objects(content):
            if (path and path[-1] in NAMES) or any(isinstance(step, int) and step > 0 for step in path):
                continue
            wrong = copy.deepcopy(content)
            inner = wrong
            for step in path:
                inner = inner[step]
            inner["undescribed"] = 1
            assert reports.faults(wrong, *names), path


def test_every_command_with_a_report_has_a_case():
    assert {case.split()[0] for case in CASES} == set(REPORTING)
    writing = {
        name for name in COMMANDS if any(option.name == "json_path" for option in main.get_command(None, name).params)
    }
    assert writing | {"batch", "examples", "morph"} == set(REPORTING)
    assert set(REPORTING) | {"batch_target", "failure"} == {part["$ref"].rpartition("/")[2] for part in SCHEMA["anyOf"]}


def parts(schema: Any) -> Iterator[dict]:
    """All schemas in a schema."""
    if isinstance(schema, dict):
        yield schema
    for item in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        yield from parts(item)


def test_the_schema_is_one_and_every_key_is_described():
    Draft202012Validator.check_schema(SCHEMA)
    for part in parts(SCHEMA):
        for name, entry in part.get("properties", {}).items() if isinstance(part.get("properties"), dict) else ():
            text = entry.get("description") or SCHEMA["$defs"][entry["$ref"].rpartition("/")[2]]["description"]
            assert text.endswith("."), (name, text)
            assert len(text) >= len("x, y."), name
        if part.get("type") == "object" and isinstance(part.get("properties"), dict) and part is not result():
            assert part.get("additionalProperties") is False or part.get("unevaluatedProperties") is False, part
    named = {part["$ref"] for part in parts(SCHEMA) if isinstance(part.get("$ref"), str)}
    assert named == {f"#/$defs/{name}" for name in SCHEMA["$defs"]}


def result() -> dict:
    """What transfers have in common; it is closed where it is used."""
    return SCHEMA["$defs"]["result"]


def test_the_command_writes_it():
    assert json.loads(run("schema").stdout) == SCHEMA
    for name in REPORTING:
        own = json.loads(run("schema", name).stdout)
        Draft202012Validator.check_schema(own)
        names = {part["$ref"].rpartition("/")[2] for part in parts(own) if isinstance(part.get("$ref"), str)}
        assert names == set(own["$defs"])
    quality = Draft202012Validator(json.loads(run("schema", "quality").stdout))
    report = json.loads(run("quality", EXAMPLES / "star/source.xml", "--json", "-").stdout)
    assert quality.is_valid(report)
    assert not quality.is_valid(report | {"more": 1})
    assert run("schema", "plot").exit_code == 2
