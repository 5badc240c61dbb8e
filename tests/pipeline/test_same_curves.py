"""Targets whose curves have the sides' degree, knots and weights are kept exactly."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import conics
import patchtransfer as pt
from patchtransfer import Boundary, BSplineCurve, MultiPatch, Patch, TransferPlan
from patchtransfer.pipeline import source_boundary

LINE = [0.0, 0, 1, 1]


def turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def redrawn(loop, start: int, backwards: bool, speed: float) -> list[BSplineCurve]:
    """The same loop from another start, in the other sense, on another domain, at another speed."""
    loop = list(loop[start:]) + list(loop[:start])
    if backwards:
        loop = [c.reversed() for c in reversed(loop)]
    powers = [3.0 * speed ** np.arange(len(c.control_points)) for c in loop]
    return [
        BSplineCurve(2 * c.knots - 1, c.degree, c.control_points, (1 if c.weights is None else c.weights) * p)
        for c, p in zip(loop, powers, strict=True)
    ]


def ring(inner: float, outer: float, patches: int, angle: float, shift) -> list[list[BSplineCurve]]:
    """Loops of an annulus, the hole moved."""
    loops = conics.annulus(inner, outer, patches).boundary().loops
    turned = [[c.with_control_points(c.control_points @ turn(angle)) for c in loop] for loop in loops]
    return [turned[0], [c.with_control_points(c.control_points + shift) for c in turned[1]]]


def off_circles(result, circles) -> float:
    """Largest distance of the result's loops from circles, in diameters."""
    found = []
    for (centre, radius), loop in zip(circles, result.multipatch.topology.loops, strict=True):
        for side in loop:
            x = side.curve(result.multipatch.patches)(np.linspace(0, 1, 101)) - centre
            found.append(abs(np.hypot(*x.T) - radius).max())
    return max(found) / (2 * circles[0][1])


@settings(max_examples=12, deadline=None)
@given(
    st.integers(3, 6),
    st.sampled_from([1, 2]),
    st.floats(0.3, 0.6),
    st.floats(0.9, 1.4),
    st.floats(0, 6),
    st.integers(0, 2),
    st.booleans(),
    st.floats(0.7, 1.4),
)
def test_eccentric_annuli_are_exact(patches, spans, inner, outer, angle, start, backwards, speed):
    shift = 0.4 * (outer - inner) * np.array([np.cos(3 * angle), np.sin(3 * angle)])
    loops = [redrawn(loop, start, backwards, speed) for loop in ring(inner, outer, patches, angle, shift)]
    source = conics.annulus(patches=patches, spans=spans)
    result = pt.transfer(source, Boundary(loops))
    assert result.certificate.status == "certified"
    assert result.boundary_error < 1e-12
    assert off_circles(result, [((0, 0), outer), (shift, inner)]) < 1e-12
    assert f"{2 * patches} of {2 * patches} boundary sides are the target's own curves" in result.log[0]
    for before, after in zip(source, result.multipatch, strict=True):
        assert np.array_equal(before.weights, after.weights)


def test_a_circle_in_one_curve_is_its_four_arcs():
    loops = ring(0.4, 1.3, 4, 0.2, [0.2, 0.1])
    whole = []
    for loop in loops:
        h = np.concatenate([[loop[0].homogeneous()[0]], *(c.homogeneous()[1:] for c in loop)])
        knots = np.r_[0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
        whole.append([BSplineCurve(knots, 2, h[:, :2] / h[:, 2:], h[:, 2])])
    result = pt.transfer(conics.annulus(spans=2), Boundary(whole))
    assert off_circles(result, [((0, 0), 1.3), ((0.2, 0.1), 0.4)]) < 1e-12


def circle(arcs: int, axes, shift=(0.0, 0.0), start: float = 0.0) -> list[BSplineCurve]:
    """An ellipse in equal arcs of its circle."""
    angle = 2 * np.pi / arcs
    made = [conics.arc(angle, start + k * angle) for k in range(arcs)]
    return [c.with_control_points(c.control_points * axes + shift) for c in made]


@settings(max_examples=12, deadline=None)
@given(st.integers(3, 6), st.integers(3, 6), st.sampled_from([1, 2]), st.floats(0.8, 1.3), st.floats(0, 6))
def test_ellipses_are_exact_however_they_are_cut(rim, hole, spans, wide, start):
    shift = np.array([0.15, 0.1])
    loops = [circle(rim, [1.3 * wide, 1.3], start=start), circle(hole, [0.4, 0.4 * wide], shift)]
    result = pt.transfer(conics.annulus(spans=spans), Boundary(loops))
    assert result.certificate.status == "certified"
    assert result.boundary_error < 1e-12
    assert "8 of 8 boundary sides" in result.log[0]
    assert result.quality.scaled_jacobian.mean > 0.9
    for centre, axes, loop in zip(
        [(0, 0), shift], [[1.3 * wide, 1.3], [0.4, 0.4 * wide]], result.fitted.loops, strict=True
    ):
        x = np.concatenate([side.curve(np.linspace(*side.curve.domain, 50)) for side in loop])
        np.testing.assert_allclose(np.hypot(*((x - centre) / axes).T), 1, rtol=0, atol=1e-13)


def test_a_disc_becomes_an_ellipse():
    result = pt.transfer(MultiPatch([conics.disc()]), Boundary([circle(3, [2.0, 1.0])]))
    assert result.certificate.injective
    assert result.boundary_error < 1e-12


def test_the_map_is_near_the_best_of_the_same_knots():
    scipy = pytest.importorskip("scipy.optimize")
    result = pt.transfer(conics.annulus(), Boundary(ring(0.4, 1.3, 4, 0.0, [0.2, 0.0])), continuity="c0")
    mp, start = result.multipatch, np.array(result.multipatch.topology.coordinates)
    inside = np.setdiff1d(np.arange(len(start)), mp.topology.boundary_points)

    def loss(flat):
        points = start.copy()
        points[inside] = flat.reshape(-1, 2)
        return -pt.quality(mp.with_shared_points(points)).scaled_jacobian.mean

    best = -scipy.minimize(loss, start[inside].ravel(), method="BFGS", options={"maxiter": 40}).fun
    assert result.quality.scaled_jacobian.mean > best - 0.02


def quarter(mp: MultiPatch, radius: float, far: float) -> Boundary:
    """The outline of the quarter plate of `conics.plate` with another hole and width, straight lines of degree 1."""
    arcs = [c for c in mp.boundary().loops[0] if abs(np.hypot(*c(0.5)) - 1) < 1e-12]
    # With the domain on the left they run from the top to the right.
    hole = [c.with_control_points(radius * c.control_points) for c in sorted(arcs, key=lambda c: c.start[0])]
    at = np.array([hole[-1].end, (far, 0), (far, 4.6), (far - 2, 4.0), (0, 4), hole[0].start])
    return Boundary([[*hole, *(BSplineCurve(LINE, 1, [a, b]) for a, b in pairwise(at))]])


@pytest.mark.parametrize("continuity", ["c0", "c1"])
def test_arcs_between_corners_are_kept_where_other_sides_are_fitted(continuity):
    mp = conics.plate(2)
    target = quarter(mp, 1.4, 6.5)
    result = pt.transfer(mp, target, continuity=continuity)
    assert result.certificate.injective
    # The two arcs of the hole, and the straight sides with weights beside them.
    assert result.log[0].startswith("4 of 8 boundary sides")
    loop = result.registration.loops[0]
    for side, own in zip(result.multipatch.topology.loops[0], loop.own, strict=True):
        if own is not None:
            curve = side.curve(result.multipatch.patches)
            np.testing.assert_allclose(curve.control_points[[0, -1]], own.control_points[[0, -1]], rtol=0, atol=1e-14)
            if abs(np.hypot(*own(0.5)) - 1.4) < 1e-6:
                np.testing.assert_allclose(np.hypot(*curve(np.linspace(0, 1, 101)).T), 1.4, rtol=0, atol=1e-14)


def test_what_is_refined_for_other_sides_stays_exact():
    angle = 2 * np.pi * np.arange(48) / 48
    outer = (1.3 + 0.1 * np.cos(5 * angle))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    wavy = Boundary.from_points([outer], smooth=True).loops[0]
    result = pt.transfer(conics.annulus(), Boundary([wavy, ring(0.4, 1.3, 4, 0.2, [0.1, 0.1])[1]]))
    assert result.refined
    assert result.certificate.injective
    for side in result.multipatch.topology.loops[1]:
        x = side.curve(result.multipatch.patches)(np.linspace(0, 1, 101)) - [0.1, 0.1]
        np.testing.assert_allclose(np.hypot(*x.T), 0.4, rtol=0, atol=1e-14)


def test_landmarks_have_the_last_word():
    mp, loops = conics.annulus(spans=2), ring(0.4, 1.3, 4, 0.0, [0.1, 0.0])
    x, y = mp.boundary().loops[0][0].start
    agreeing, other = (
        pt.transfer(mp, Boundary(loops), [[x, y, 1.3 * np.cos(a), 1.3 * np.sin(a)]], "c0") for a in (np.pi / 2, 0.3)
    )
    assert off_circles(agreeing, [((0, 0), 1.3), ((0.1, 0), 0.4)]) < 1e-12
    assert not other.registration.loops[0].own
    assert other.certificate.injective


def test_one_turn_by_a_side_is_a_turn_of_both_loops():
    # Outlines without a start of their own: what the outer one is turned by, the hole is as well.
    for angle in np.linspace(0, np.pi / 2, 7):
        result = pt.transfer(conics.annulus(), Boundary(ring(0.4, 1.3, 4, angle, [0.05, 0.0])), continuity="c0")
        assert result.quality.scaled_jacobian.min > 0.95


def test_polynomial_sides_are_fitted_as_ever():
    mp = conics.annulus()
    net = MultiPatch([Patch(p.knots, p.degrees, p.control_points) for p in mp], mp.interfaces)
    result = pt.transfer(net, net.boundary(), continuity="c0")
    assert not any(loop.own for loop in result.registration.loops)


@pytest.mark.parametrize("options", [{"mirror": "auto"}, {"split": "auto"}, {"correspondence": "runner-up"}])
def test_other_ways_of_a_transfer_keep_them(options):
    loops = ring(0.4, 1.3, 4, 0.3, [0.2, 0.1])
    result = pt.transfer(conics.annulus(spans=2), Boundary(loops), continuity="c0", **options)
    assert result.certificate.injective
    assert off_circles(result, [((0, 0), 1.3), ((0.2, 0.1), 0.4)]) < 1e-12


@pytest.mark.parametrize("patches", [3, 4])
def test_a_round_hole_that_is_cut_elsewhere_is_not_twisted(patches):
    outer, inner = ring(0.8, 1.0, patches, 0.0, [0.0, 0.0])
    inner = [c.with_control_points(c.control_points @ turn(np.pi / patches)) for c in inner]
    result = pt.transfer(conics.annulus(0.8, 1.0, patches), Boundary([outer, inner]), continuity="c0")
    assert off_circles(result, [((0, 0), 1.0), ((0, 0), 0.8)]) < 1e-12
    assert result.quality.scaled_jacobian.min > 0.99


def test_curves_that_allow_no_map_are_given_up(monkeypatch):
    mp, target = conics.annulus(), Boundary(ring(0.4, 1.3, 4, 0.3, [0.2, 0.1]))
    keep = source_boundary.with_same_curves

    def crossed(registration, landmarks=None):
        """The hole's curves, moved across the rim."""
        loops = list(keep(registration, landmarks).loops)
        own = tuple(c.with_control_points(c.control_points + np.array([1.2, 0.0])) for c in loops[1].own)
        loops[1] = replace(loops[1], own=own)
        return replace(registration, loops=tuple(loops))

    monkeypatch.setattr(source_boundary, "with_same_curves", crossed)
    result = pt.transfer(mp, target, continuity="c0")
    assert result.certificate.injective
    assert not any(loop.own for loop in result.registration.loops)
    assert any("with joints at the curves' ends no certified map was found" in text for text in result.warnings)


def test_plans_for_many_targets_and_registrations_know_them():
    plan = TransferPlan(conics.annulus(), "c0")
    targets = [Boundary(ring(0.4, outer, 4, 0.1, [0.1, 0.0])) for outer in (1.0, 1.2)]
    for result in plan.map(targets):
        assert result.boundary_error < 1e-12
    registration = plan.register(targets[0])
    assert all(curve is not None for loop in registration.loops for curve in loop.own)
