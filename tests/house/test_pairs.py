"""The benchmark of real pairs measures what it says, by one command, and its page is its own."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from itertools import repeat
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import patchtransfer as pt
from patchtransfer.geometry.outline import Outline
from patchtransfer.proof.certificate import check_boundary
from shapes import polygon

# Last: outlines of other names lie in tests/support.
sys.path.append(str(Path(__file__).parents[2] / "benches" / "python"))
sys.path.append(str(Path(__file__).parents[2] / "scripts"))
import pair_report
import pair_sheet
import pairs
from curves import bulged, ellipse, naca
from glyphs import font, glyph
from icons import ICONS
from pair_families import FAMILIES
from pair_judgement import Direction, corners, distance, judge, measure

DOCS = Path(__file__).parents[2] / "docs"
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.fixture(scope="module")
def square() -> pt.MultiPatch:
    knots = [0.0, 0.0, 1.0, 1.0]
    return pt.MultiPatch([pt.Patch((knots, knots), (1, 1), np.array([[(0, 0), (0, 1)], [(1, 0), (1, 1)]], float))])


@pytest.mark.parametrize("name", ["DejaVuSans", "STIXGeneral", "cmr10"])
@pytest.mark.parametrize("character", "aR5")
def test_glyphs_are_those_of_the_font_s_table(character, name):
    """The table's points, to the bit, and midpoints that it leaves to the reader."""
    boundary, file = glyph(character, name), font(name)
    points = {
        tuple(x) for loop in boundary.loops for curve in loop for x in curve.control_points * file["head"].unitsPerEm
    }
    table, _, _ = file["glyf"][file.getBestCmap()[ord(character)]].getCoordinates(file["glyf"])
    assert {tuple(map(float, x)) for x in table} <= points
    assert all((np.array(x) * 2).round(6).tolist() == (np.array(x) * 2).tolist() for x in points)


def test_glyphs_of_several_parts_are_none():
    assert glyph("i", "DejaVuSans") is None
    assert glyph("o", "DejaVuSans") is not None


@pytest.mark.parametrize("bulge", [0.2, 1.0, -0.5, 2.4])
def test_arcs_turn_by_four_times_the_angle_of_their_bulge(bulge):
    arc, line = bulged([(1.0, 2.0, bulge), (4.0, 6.0, 0.0)])
    assert (arc.start == [1, 2]).all()
    assert (arc.end == line.start).all()
    middle = arc(np.linspace(*arc.domain, 3))[1]
    # The sagitta is the bulge times half the chord, to the right of the way for positive ones.
    assert middle == pytest.approx([2.5 + bulge * 2.0, 4.0 - bulge * 1.5])


def test_airfoils_have_the_thickness_and_camber_of_their_digits():
    (curve,) = naca("2412")
    x, y = curve(np.linspace(*curve.domain, 4001)).T
    nose = int(np.argmin(x))
    at = np.linspace(-0.45, 0.45, 200)
    upper, lower = np.interp(at, x[nose::-1], y[nose::-1]), np.interp(at, x[nose:], y[nose:])
    assert (upper - lower).max() == pytest.approx(0.12, abs=1e-3)
    assert (upper + lower).max() / 2 == pytest.approx(0.02, abs=1e-3)
    assert at[np.argmax(upper + lower)] + 0.5 == pytest.approx(0.4, abs=0.05)


@pytest.mark.parametrize("kind", ICONS)
def test_icons_bound_a_domain(kind):
    for variant in ICONS[kind]:
        boundary = pt.Boundary(variant)
        outline, *holes = (Outline(loop) for loop in boundary.loops)
        assert outline.area > 2 * sum(abs(hole.area) for hole in holes)
        # The domain lies on the left of all loops.
        inner = [[curve.reversed() for curve in reversed(loop)] for loop in boundary.loops[1:]]
        assert check_boundary([boundary.loops[0], *inner]).simple


@pytest.mark.parametrize("name", ["wrench", "rabbit", "star", "frame"])
def test_corners_are_those_of_the_library(name):
    """Chords and the core's derivatives tell the same, but for the least turn that counts."""
    boundary = pt.examples.load(name)[1]
    found = corners(boundary)
    for loop in boundary.loops:
        outline = Outline(loop)
        at, turn = outline.corners
        for point in outline.point(at[abs(turn) > np.radians(26)]):
            assert np.hypot(*(found[:, :2] - point).T).min() < 1e-9 * boundary.diameter


@pytest.mark.parametrize("shift", [0.0, 1e-4, 0.03])
def test_distances_of_moved_outlines(shift):
    a, b = pt.Boundary([ellipse(1, 1)]), pt.Boundary([ellipse(1, 1, (shift, 0))])
    assert distance(a, b) == pytest.approx(shift / np.sqrt(8), rel=1e-3, abs=1e-7)


def test_a_corner_off_the_joints_is_lost(square):
    tab = polygon([(0, 0), (1, 0), (1, 0.4), (1.2, 0.4), (1.2, 0.6), (1, 0.6), (1, 1), (0, 1)])
    o = Direction("", "", "")
    measure(o, square, square, pt.Boundary([tab]))
    assert o.corners == 8
    assert sorted(o.lost) == [[1, 0.4], [1, 0.6], [1.2, 0.4], [1.2, 0.6]]
    assert o.smoothed == []
    assert not o.clean
    assert o.boundary_error == pytest.approx(0.2 / np.hypot(1.2, 1), rel=1e-2)


def test_a_corner_on_a_smooth_place_is_told(square):
    round_top = bulged([(0, 0, 0), (1, 0, 0), (1, 0.5, np.tan(np.pi / 8)), (0.5, 1, 0), (0, 1, 0)])
    o = Direction("", "", "")
    measure(o, square, square, pt.Boundary([round_top]))
    assert (o.corners, o.lost) == (3, [])
    assert o.smoothed == [[1, 1]]


def test_a_joint_that_does_not_turn_keeps_no_corner(square):
    target = pt.Boundary([polygon(SQUARE)])
    sharp, rounded = Direction("", "", ""), Direction("", "", "")
    measure(sharp, square, square, target)
    assert (sharp.corners, sharp.lost, sharp.boundary_error) == (4, [], 0)
    knots = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    x = np.stack(np.meshgrid([0, 0.5, 1], [0, 0.5, 1], indexing="ij"), axis=-1)
    # Both sides at (1, 1) run along the diagonal there.
    x[2, 1], x[1, 2] = (1.25, 0.75), (0.75, 1.25)
    measure(rounded, square, pt.MultiPatch([pt.Patch((knots, knots), (2, 2), x)]), target)
    assert rounded.lost == [[1, 1]]


def pair(family: str, first: str) -> pairs.Pair:
    return next(p for p in pairs.pairs(family) if p.first.name == first)


@pytest.fixture(scope="module")
def outcomes() -> list[pair_sheet.Drawn]:
    """Both directions of two pairs: one that is easy, one of which a drawing has more corners than the other."""
    chosen = [pair("regular to oblique", "7 DejaVuSans"), pair("icons", "bottle 2")]
    return pairs.run(chosen, {}, 1, 60.0)


def test_both_directions_of_a_pair_are_judged(outcomes):
    judged = {o.name: o for o, *_ in outcomes}
    assert len(judged) == 4
    for name in ("7 DejaVuSans → 7 DejaVuSans-Oblique", "7 DejaVuSans-Oblique → 7 DejaVuSans"):
        assert judged[name].clean
        assert judged[name].corners == 6
        assert not list(judged[name].causes())
    onto_lip = judged["bottle 2 → bottle 3"]
    assert len(onto_lip.lost) >= 4
    assert "corner without joint" in onto_lip.causes()
    assert not onto_lip.clean


def test_measured_twice_the_boundary_error_is_the_same(outcomes):
    for o, *_ in outcomes:
        assert o.boundary_error == pytest.approx(o.reported_error, rel=0.05, abs=1e-6), o.name


def test_every_outcome_is_ready_for_json_and_the_table(outcomes, tmp_path):
    directions = [o for o, *_ in outcomes]
    assert json.loads(json.dumps([asdict(o) for o in directions]))[0]["status"] == "certified"
    rows = pair_report.table(directions).splitlines()
    assert [row.split(" | ")[0][2:] for row in rows[2:]] == ["regular to oblique", "icons", "all"]
    assert rows[2].split(" | ")[1:4] == ["2", "100 %", "100 %"]
    (sheet,) = pair_sheet.draw(outcomes, tmp_path / "sheet.png")
    assert np.asarray(Image.open(sheet).convert("L")).std() > 10
    assert [p.name for p in pair_sheet.draw(outcomes * 3, tmp_path / "s.png", rows=1)] == ["s-1.png", "s-2.png"]


def test_one_command_writes_everything(outcomes, tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr(pairs, "run", lambda *arguments: given.append(arguments) or outcomes)
    names = [tmp_path / name for name in ("pairs.json", "sheet.png", "pairs.md")]
    options = ["--families", "icons", "-n", "2", "--options", "split=auto", "--workers", "3", "--limit", "7"]
    files = [str(x) for pair in zip(("--json", "--sheet", "--table"), names, strict=True) for x in pair]
    monkeypatch.setattr(sys, "argv", ["pairs.py", *options, *files])
    pairs.main()
    ((chosen, handed, workers, limit),) = given
    assert ({p.family for p in chosen}, len(chosen), handed, workers, limit) == ({"icons"}, 2, {"split": "auto"}, 3, 7)
    rows = json.loads(names[0].read_text())
    assert [row["clean"] for row in rows] == [o.clean for o, *_ in outcomes]
    page = names[2].read_text()
    assert "pairs.py -n 2 --families icons --options split=auto`" in page
    assert "bottle 2 → bottle 3" in page.partition(pair_report.CAUSES)[2]
    assert (tmp_path / "images" / "pairs.png").exists()


def test_errors_that_are_documented_are_refusals_and_others_are_exceptions(square, monkeypatch):
    target = pt.Boundary([polygon(SQUARE)])
    refused, mapped = judge(Direction("", "", ""), square, target, {"refine": "nonsense"})
    assert (refused.status, mapped) == ("refused", None)
    assert refused.reason.startswith("InputError")

    def broken(*_, **__):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(pt, "transfer", broken)
    failed, _ = judge(Direction("", "", ""), square, target, {})
    assert (failed.status, failed.reason) == ("exception", "ZeroDivisionError: division by zero")
    assert list(failed.causes()) == ["exception"]


def test_processor_time_is_limited():
    assert pairs.limited(sum, ([1, 2],), 5.0) == 3
    assert pairs.limited(sum, (repeat(1),), 0.5) is None


def test_the_page_is_written_by_the_script():
    page = (DOCS / "pairs.md").read_text()
    assert page.startswith(
        pair_report.page([], " --options split=auto,mirror=auto", None).partition(pair_report.CAUSES)[0]
    )
    rows = [line.split(" | ")[0][2:] for line in page.splitlines() if line.startswith("| ")]
    # Models are there where PATCHTRANSFER_MODELS was when the page was made.
    assert rows[1:-1] == [family for family in FAMILIES if family != "models" or "models" in rows]


def test_options_are_read_as_they_are_written():
    assert pairs.option("split=auto,mirror=auto") == {"split": "auto", "mirror": "auto"}
    assert [len([p for p in pairs.chosen_pairs(FAMILIES, n, False) if p.family == "icons"]) for n in (1, 3)] == [1, 3]
