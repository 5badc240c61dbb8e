"""Corners of the target inside sides of the source are named before the fit, with what they cost."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import targets
from commands import run
from patchtransfer.pipeline.source_boundary import SourceBoundary
from patchtransfer.registration.missed_corners import rounding_error
from patchtransfer.registration.register import register
from shapes import SQUARE, identity, loop

FIXED = np.column_stack([SQUARE, SQUARE])


def roofed(share: float, degrees: float) -> tuple[pt.Boundary, np.ndarray]:
    """The unit square with a roof that turns by so many degrees at this share of its length, counter-clockwise."""
    turn, legs = np.radians(degrees), np.array([share, 1 - share])
    legs /= np.sqrt((legs**2).sum() + 2 * legs.prod() * np.cos(turn))
    slope = np.arcsin(legs[1] * np.sin(turn))
    apex = np.array([1 - legs[0] * np.cos(slope), 1 + legs[0] * np.sin(slope)])
    return loop([*SQUARE[:3], apex, SQUARE[3]]), apex


def square(degree: int, spans: int) -> pt.MultiPatch:
    return models.build([models.bilinear(*SQUARE)], degree, spans, None)


@pytest.mark.parametrize(("degree", "spans"), [(2, 1), (3, 1), (3, 3), (3, 8), (4, 2), (4, 8)])
def test_a_missed_corner_is_named_with_its_place_and_cost(degree, spans):
    mp = square(degree, spans)
    target, apex = roofed(0.62, 75)
    registration = register(mp.boundary().loops, target, FIXED)
    (corner,) = registration.missed_corners
    np.testing.assert_allclose([corner.x, corner.y], apex, atol=1e-9)
    top = mp.boundary().loops[corner.loop][corner.side]
    np.testing.assert_allclose([top.start, top.end], SQUARE[2:], atol=1e-12)
    assert corner.turn == pytest.approx(75)
    assert corner.parameter == pytest.approx(0.62, abs=1e-3)
    (warning,) = registration.warnings
    assert "no joint of the source is matched" in warning
    assert f"{corner.cost:.1e} of the diameter" in warning


@pytest.mark.parametrize("degree", [3, 4])
def test_the_cost_is_about_what_the_fit_misses(degree):
    """The fit does much better only where its control points happen to meet in the corner."""
    ratios = []
    for spans in (1, 3, 5, 8):
        mp = square(degree, spans)
        boundary = SourceBoundary(mp.boundary().loops, mp.topology)
        for share, angle in itertools.product((0.55, 0.62, 0.69, 0.8), (30, 75)):
            registration = register(mp.boundary().loops, roofed(share, angle)[0], FIXED)
            ratios.append(boundary.free_fit(registration, 1e-3).error / registration.missed_corners[0].cost)
    low, middle, high = np.quantile(ratios, (0.1, 0.5, 1.0))
    assert low > 1 / 4
    assert 1 / 2 < middle < 2
    assert high < 4


def test_knots_of_full_multiplicity_at_the_corner_cost_nothing():
    knots = np.r_[[0.0] * 4, [0.4] * 3, [1.0] * 4]
    patch = pt.Patch((knots, knots), (3, 3), identity((knots, knots), (3, 3)))
    mp = pt.MultiPatch([patch])
    target, apex = roofed(0.53, 60)
    registration = register(mp.boundary().loops, target, FIXED)
    (corner,) = registration.missed_corners
    assert corner.cost > 1e-4
    at_knot = [0.4, 1.0, *apex]
    registration = register(mp.boundary().loops, target, np.vstack([FIXED, at_knot]))
    assert registration.missed_corners == ()
    assert not any("no joint" in text for text in registration.warnings)
    assert SourceBoundary(mp.boundary().loops, mp.topology).free_fit(registration, 1e-3).error < 1e-9


@settings(max_examples=20, deadline=None)
@given(st.floats(0.1, 10), st.floats(0.02, 0.98), st.integers(2, 5), st.integers(0, 999))
def test_the_rounding_error_scales_and_ends_where_the_curve_may_turn(scale, at, degree, seed):
    """A part of the curve's length; none at a knot of full multiplicity, which any knot of a polygon is."""
    inner = np.sort(np.random.default_rng(seed).uniform(0, 1, 3))

    def error(knots, p, scale=1.0):
        curve = pt.BSplineCurve(knots, p, np.zeros((len(knots) - p - 1, 2)))
        return rounding_error(curve, at, lambda t: scale * (t - at))

    knots = np.r_[[0.0] * (degree + 1), inner, [1.0] * (degree + 1)]
    found = error(knots, degree)
    assert error(knots, degree, scale) == pytest.approx(scale * found, rel=1e-6)
    assert 0 < found < 0.2
    assert error(np.sort(np.r_[knots, [at] * degree]), degree) < 1e-12
    assert error([0.0, 0.0, at, 1.0, 1.0], 1) < 1e-12


def test_refinement_halves_the_cost():
    target, _ = roofed(0.62, 60)
    costs = []
    for spans in (8, 16, 32):
        (corner,) = register(square(3, spans).boundary().loops, target, FIXED).missed_corners
        costs.append(corner.cost)
    assert 0.3 < costs[1] / costs[0] < 0.9
    assert 0.3 < costs[2] / costs[1] < 0.9


def test_the_report_has_them_and_a_landmark_ends_them(tmp_path):
    mp = models.strip(2, 3, 4)
    corners = mp.topology.coordinates[mp.topology.boundary_points]
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = (low + high) / 2
    apex = (low[0] + 0.3 * (high[0] - low[0]), high[1] + 0.15 * (high[0] - low[0]))
    target = loop([low, (high[0], low[1]), high, apex, (low[0], high[1])])
    rows = [[*p, *p] for p in (low, (high[0], low[1]), high, (low[0], high[1]))]
    held = [middle[0], high[1], middle[0] + 0.05, high[1] + 0.1]
    held[2:] = pt.Boundary(target.loops).loops[0][2](np.array([0.6])).ravel()
    result = pt.transfer(mp, target, np.array([*rows, held]), refine="never", on_failure="return")
    (corner,) = json.loads(json.dumps(result.to_dict()))["registration"]["missed_corners"]
    assert corner == result.registration.missed_corners[0].to_dict()
    assert (corner["x"], corner["y"]) == pytest.approx(apex)
    assert sum("no joint of the source" in text for text in result.warnings) == 1
    taken = pt.transfer(mp, target, np.array([*rows, [*held[:2], *apex]]), refine="never", on_failure="return")
    assert taken.registration.missed_corners == ()
    assert taken.boundary_error < result.boundary_error
    pt.write(mp, tmp_path / "source.xml")
    pt.write(target, tmp_path / "target.xml")
    np.savetxt(tmp_path / "l.csv", [*rows, held], delimiter=",", header="xs,ys,xt,yt", comments="")
    inputs = (tmp_path / "source.xml", tmp_path / "target.xml", "-o", tmp_path / "out.xml")
    shown = run("transfer", *inputs, "--landmarks", tmp_path / "l.csv", "--refine", "never", "--keep-uncertified")
    assert f"1, rounded off by about {corner['cost']:.1e} at most" in shown.output


def test_many_are_summed_up():
    """A saw: those that cost most are named, the others counted."""
    teeth = [(1 - k / 20, 1 + 0.03 * (k % 2)) for k in range(1, 20)]
    registration = register(square(3, 4).boundary().loops, loop([*SQUARE[:3], *teeth, SQUARE[3]]), FIXED)
    assert len(registration.missed_corners) == 19
    named = [text for text in registration.warnings if "no joint" in text]
    (counted,) = [text for text in registration.warnings if "14 more such corners" in text]
    assert len(named) == 5
    worst = sorted((corner.cost for corner in registration.missed_corners), reverse=True)
    assert f"by {worst[5]:.1e} of the diameter or less" in counted


@pytest.mark.parametrize("name", ["wrench", "human"])
def test_corners_that_joints_take_are_not_named(name):
    mp = pt.examples.load(name)[0]
    target, truth = targets.deformed(mp, targets.waves(mp, 0.05, 3), seed=1)
    assert register(mp.boundary().loops, target, truth).missed_corners == ()
