"""Slivers that cleaning did not take away attract no joints."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
from commands import run
from patchtransfer.geometry.outline import CORNER, Outline
from patchtransfer.geometry.slivers import drawn_corners
from patchtransfer.registration.register import register
from shapes import polygon

HOUSE = np.array([(0, 0), (0.8, 0), (0.8, 0.4), (0.4, 0.6), (0, 0.4)])


def with_sliver(at: int, size: float, angle: float) -> np.ndarray:
    """The house with corner `at` doubled."""
    return np.insert(HOUSE, at + 1, HOUSE[at] + size * np.array([np.cos(angle), np.sin(angle)]), axis=0)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4), st.floats(1e-8, 3e-4), st.floats(0, 6), st.floats(1e-6, 1e6), st.integers(0, 5))
def test_the_corners_of_a_sliver_are_the_one_that_was_drawn(at, size, angle, scale, first):
    points = np.roll(scale * with_sliver(at, size, angle), first, axis=0)
    clean, outline = Outline(polygon(scale * HOUSE)), Outline(polygon(points))
    s, turn = drawn_corners(outline)
    assert len(s) == 5
    assert (np.diff(s) > 0).all()
    order = [np.linalg.norm(outline.point(s) - p, axis=1).argmin() for p in scale * HOUSE]
    assert np.linalg.norm(outline.point(s[order]) - scale * HOUSE, axis=1).max() <= 1.01 * size * scale
    # One end may turn too little to be a corner.
    np.testing.assert_allclose(turn[order], clean.corners[1], atol=CORNER + 0.01)


def test_a_sliver_on_a_side_is_no_corner():
    points = [*HOUSE[:2], (0.8, 0.2), (0.8002, 0.2001), *HOUSE[2:]]
    outline = Outline(polygon(points))
    assert len(outline.corners[0]) == 7
    assert len(drawn_corners(outline)[0]) == 5


@pytest.mark.parametrize(
    "points", [[*HOUSE[:2], (0.8, 0.2), (0.79, 0.201), *HOUSE[2:]], [(0, 0), (1, 0), (1, 2e-4), (0, 2e-4)]]
)
def test_what_was_drawn_stays(points):
    """A step of 1 % of the size, and a needle's ends, where the outline turns back."""
    outline = Outline(polygon(points))
    for a, b in zip(drawn_corners(outline), outline.corners, strict=True):
        np.testing.assert_array_equal(a, b)


def fish(sliver: float) -> str:
    """A smooth body with a tail of corners; the last curve ends beside the first one's start."""
    return (
        '<svg xmlns="http://www.w3.org/2000/svg"><path d="M180 140 C220 110 270 80 336 80 C440 80 540 150 572 256 '
        "C540 362 440 432 336 432 C270 432 220 402 180 372 L138 327 L0 382 L50 256 L0 130 L138 185 "
        f'C150 170 165 154 {180 + sliver} {140 + sliver} Z"/></svg>'
    )


@pytest.mark.parametrize("clean", [True, False])
def test_slivers_attract_no_joints(tmp_path, clean):
    mp = models.strip(3, 3, 2)
    (tmp_path / "clean.svg").write_text(fish(0))
    (tmp_path / "sliver.svg").write_text(fish(0.1))
    drawn = [pt.read_boundary(tmp_path / f"{name}.svg", clean=clean) for name in ("clean", "sliver")]
    source = [[curve.reversed() for curve in reversed(loop)] for loop in drawn[0].loops]
    best, other = (register(source, target) for target in drawn)
    assert other.confidence == pytest.approx(best.confidence, abs=0.02)
    places = [np.array([b for _, b in found.joints]) for found in (best, other)]
    assert np.linalg.norm(places[1] - places[0], axis=1).max() < 2e-3 * drawn[0].diameter
    assert len(other.missed_corners) == len(best.missed_corners)
    pt.write(mp, tmp_path / "source.xml")
    corners = []
    for name in ("clean", "sliver"):
        out = tmp_path / f"{name}.json"
        options = [] if clean else ["--no-clean"]
        inputs = (tmp_path / "source.xml", tmp_path / f"{name}.svg", "-o", tmp_path / "out.xml")
        run("transfer", *inputs, "--json", out, "--keep-uncertified", "--refine", "never", *options)
        joints = json.loads(out.read_text())["registration"]["joints"]
        corners.append(np.array([joint["target"] for joint in joints]))
    assert np.linalg.norm(corners[1] - corners[0], axis=1).max() < 2e-2 * drawn[0].diameter
