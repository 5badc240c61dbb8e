"""Reports as documents: what they say, and that nothing in them reaches out or is taken for markup."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

import commands
import models
import patchtransfer as pt
import targets
from patchtransfer import examples
from patchtransfer.web import report

VOID = {"meta", "input", "br"}


class Document(HTMLParser):
    """Elements of a page, with what is wrong with its nesting."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.ids, self.words = [], [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.elements.append((tag, attributes))
        if "id" in attributes:
            self.ids.append(attributes["id"])
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self.open, tag
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join("".join(self.words).split())


def self_contained(page):
    """The document, if nothing in it is loaded from anywhere."""
    document = Document(page)
    for tag, attributes in document.elements:
        assert tag not in {"link", "img", "iframe", "object", "embed"}
        assert "src" not in attributes
        address = attributes.get("href", "#")
        assert address.startswith(("#", ".")), address
        assert not any(name.startswith("on") for name in attributes)
    assert "url(" not in page
    assert "fetch(" not in page
    assert "//" not in re.sub(r"^\s*//.*$", "", page, flags=re.M).replace("</", ""), "an address"
    assert len(set(document.ids)) == len(document.ids)
    for _, attributes in document.elements:
        if attributes.get("href", "").startswith("#"):
            assert attributes["href"][1:] in document.ids
    return document


@pytest.fixture(scope="module")
def human():
    return pt.transfer(*examples.load("human"))


def test_a_page_is_self_contained_and_small(human):
    page = human.to_html()
    document = self_contained(page)
    assert len(page.encode()) < 1_500_000
    for figure in ("source", "target", "result"):
        assert f"picture-{figure}" in document.ids
    for text in (
        "Transfer: certified",
        str(human.quality.proved).split(";")[0],
        f"det J > 0 everywhere in all {len(human.multipatch)} patches",
        human.multipatch.interfaces[0].name,
    ):
        assert text in document.text


def test_corresponding_points_have_one_key_in_all_pictures(human):
    document = Document(human.to_html())
    keys = [a["data-key"] for tag, a in document.elements if tag == "path" and "data-key" in a]
    assert sorted(set(keys)) == sorted(keys[: len(keys) // 3])
    hues = {}
    for tag, a in document.elements:
        if tag == "path" and "data-key" in a:
            hues.setdefault(a["data-key"], set()).add(a["style"])
    assert all(len(styles) == 1 for styles in hues.values())


def test_the_histogram_counts_all_samples(human):
    parts = [float(p) for p in re.findall(r": ([\d.]+) % of the samples", human.to_html())]
    assert sum(parts) == pytest.approx(100, abs=0.1)


def test_texts_of_strangers_are_texts(human):
    hostile = '<script>alert(1)</script>"><img src=x onerror=alert(1)>'
    page = report.transfer_page(human, hostile, [hostile])
    document = self_contained(page)
    assert page.count("<script>") == 1
    assert hostile in "".join(document.words)


def test_a_result_that_is_not_certified_says_so():
    mp = models.grid(2, 2, 2, 2, None)
    points = mp.topology.coordinates.copy()
    points[mp.topology.interior_points[0]] += 9
    folded = mp.with_shared_points(points)
    certificate = pt.certify(folded)
    page = report.model_page(folded, certificate, pt.quality(folded), pt.check_continuity(folded))
    document = self_contained(page)
    assert "Check: folded" in document.text
    assert certificate.reasons[0] in document.text
    assert re.search(r"not positive: [\d.]+ % of the samples", page)


def test_a_polish_is_told():
    mp = models.plate_with_hole(3, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 60))
    result = pt.transfer(mp, target, landmarks, polish="scaled_jacobian")
    assert result.polish.words.replace(">", "&gt;") in result.to_html()


def test_a_mirrored_transfer_matches_points_of_the_picture(tmp_path):
    # A key's bit: no rotation takes it to its mirror image.
    corners = np.array([(0, 0), (6, 0), (6, 2), (4, 2), (4, 1), (0, 1)], float)
    source = pt.parameterize(pt.Boundary.from_points(corners)).multipatch
    result = pt.transfer(source, pt.Boundary.from_points(corners * [-1, 1]), mirror="auto", on_failure="return")
    assert result.mirrored
    assert "source (mirrored)" in self_contained(result.to_html()).text


def test_commands_write_pages(tmp_path):
    folder = commands.inputs_of_transfer(tmp_path)
    source, target, out = folder / "source.xml", folder / "target.xml", folder / "out.xml"
    done = commands.run("transfer", source, target, "-o", out, "--html", folder / "r.html", "--json", folder / "r.json")
    assert done.exit_code == 0, done.output
    text = self_contained((folder / "r.html").read_text("utf-8")).text
    assert f"patchtransfer transfer {source} {target}" in text
    status = json.loads((folder / "r.json").read_text())["certificate"]["status"]
    assert f"Transfer: {status}" in text
    assert commands.run("check", out, "--html", folder / "c.html").exit_code == 0
    assert "Check: certified" in self_contained((folder / "c.html").read_text("utf-8")).text
    (folder / "triangle.csv").write_text("0,0\n1,0\n0,1\n")
    done = commands.run("parameterize", folder / "triangle.csv", "-o", folder / "p.xml", "--html", folder / "p.html")
    assert done.exit_code == 0, done.output
    assert "Parameterization:" in self_contained((folder / "p.html").read_text("utf-8")).text


def test_pages_replace_no_input_and_need_their_suffix(tmp_path):
    folder = commands.inputs_of_transfer(tmp_path)
    given = folder / "source.xml", folder / "target.xml", "-o", folder / "out.xml"
    wrong = {"r.txt": "unknown format for a page", "no/r.html": "does not exist"}
    for page, message in wrong.items():
        done = commands.run("transfer", *given, "--html", folder / page)
        assert done.exit_code == 2
        assert message in done.stderr
    assert not (folder / "out.xml").exists()


def test_the_page_of_a_batch_has_failures_first_and_links_to_what_is_there(tmp_path):
    folder = commands.inputs_of_transfer(tmp_path)
    (folder / "a & b.xml").write_bytes((folder / "target.xml").read_bytes())
    (folder / "bow.csv").write_text("0,0\n1,1\n1,0\n0,1\n")
    (folder / "bad.csv").write_text("nothing")
    names = [folder / name for name in ("a & b.xml", "bow.csv", "bad.csv")]
    page = folder / "index.html"
    done = commands.run("batch", folder / "source.xml", *names, "-o", folder / "out", "--html", page, "--workers", "1")
    assert done.exit_code == 1, done.output
    document = self_contained(page.read_text("utf-8"))
    assert "1 of 3 certified" in document.text
    cells = [a.get("data-value", "") for tag, a in document.elements if tag == "td"]
    targets = [value for value in cells if value.endswith((".xml", ".csv"))]
    assert targets == ["bow.csv", "bad.csv", "a & b.xml"]
    links = [a["href"] for tag, a in document.elements if tag == "a"]
    assert links == ["./out/a%20%26%20b.xml", "./out/a%20%26%20b.report.json"]
    # The target without a model has the picture of its outline, the unreadable one none.
    assert [i for i in document.ids if i.startswith("picture")] == ["picture-target-0", "picture-target-2"]


def luminance(colour):
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))


def contrast(a, b):
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_colours_are_legible(scheme):
    """Lines at 3 : 1 and words at 4.5 : 1, as the guidelines for web content have it."""
    colours = {}
    for part in ("palette_css", "picture_css"):
        blocks = re.findall(r":root(?:, ?:host)? ?\{(.*?)\}", report._environment().globals[part], re.DOTALL)
        colours |= dict(re.findall(r"--([\w-]+): ?(#[0-9a-f]{6})", blocks[scheme]))
    for ground in (colours["ground"], colours["panel"]):
        for name in ("ink", "quiet", "accent", "good", "bad"):
            assert contrast(colours[name], ground) >= 4.5, name
        for k in range(len(report._legend())):
            assert contrast(colours[f"q{k}"], ground) >= 3, k
    for k in range(6):
        assert contrast(colours["ink"], colours[f"p{k}"]) >= 4.5
    # Folded or poor against good is told apart without hue: by lightness, or the hues are blue and red, which all see.
    assert contrast(colours["q8"], colours["q5"]) > 1.5
