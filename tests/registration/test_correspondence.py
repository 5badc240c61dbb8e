"""Correspondence by shape, without landmarks and between them, on shapes whose true correspondence is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import real
import targets
from patchtransfer import Boundary, BSplineCurve, examples, transfer
from patchtransfer.registration.register import register
from shapes import SQUARE, circle, loop, polygon

quick = settings(max_examples=10, deadline=None)


def correspondence_error(registration, target, truth) -> float:
    """Mean distance of the joints' images from the true ones, relative to the diagonal of the target's box."""
    found = np.array([b for _, b in registration.joints])
    return float(np.linalg.norm(found - truth[:, 2:], axis=1).mean() / target.diameter)


EAR = ((0.12, 0.62), (0.25, 1), 30, 0.2, lambda x: (x[:, 0] > 0) & (x[:, 1] > 0.45))
SHAPES = {
    "bend": lambda mp: targets.bend(mp, 60),
    "bend back": lambda mp: targets.bend(mp, -40),
    "articulation": lambda mp: targets.articulation(mp, 20, 0.6),
    "bump": lambda mp: targets.bump(mp, (0.2, 0.7), (0.1, 0.1), 0.4),
    "waves": lambda mp: targets.waves(mp, 0.08, 3),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["l-shape p2", "rabbit", "human"])
def test_deformed_shapes_are_matched_without_landmarks(name, shape):
    mp = examples.load(name)[0] if name in examples.EXAMPLES else models.ALL[name]()
    target, truth = targets.deformed(mp, SHAPES[shape](mp), seed=11, degree=2)
    registration = register(mp.boundary().loops, target)
    assert correspondence_error(registration, target, truth) < 0.02
    assert registration.confidence > 0.2


@pytest.mark.parametrize("degrees", [-40, 40])
def test_a_turned_ear_is_matched_without_landmarks(degrees):
    mp = examples.load("rabbit")[0]
    neck, direction, _, blend, inside = EAR
    target, truth = targets.deformed(mp, targets.limb(neck, direction, degrees, blend, inside), seed=2)
    assert correspondence_error(register(mp.boundary().loops, target), target, truth) < 0.01


@real.needed
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["yeti", "turtle"])
def test_real_models_are_matched_without_landmarks(name, shape):
    mp = real.model(name)
    target, truth = targets.deformed(mp, SHAPES[shape](mp), seed=5)
    assert correspondence_error(register(mp.boundary().loops, target), target, truth) < 0.02


@quick
@given(angle=st.floats(-180, 180), scale=st.floats(0.01, 100), seed=st.integers(0, 1000), reverse=st.booleans())
def test_matching_by_shape_does_not_depend_on_the_frame(angle, scale, seed, reverse):
    """A bent target turned, scaled, started elsewhere: the same correspondence."""
    mp = examples.load("wrench")[0]
    bend, move = targets.bend(mp, 40), targets.similarity(angle, scale, (3, 4))
    target, truth = targets.deformed(mp, lambda x: move(bend(x)), seed=seed, reverse=reverse)
    assert correspondence_error(register(mp.boundary().loops, target), target, truth) < 0.012


def test_landmarks_found_can_be_given_back():
    """What the report lists as landmarks fixes the correspondence that it came with."""
    mp = examples.load("two-hole-plate")[0]
    target, _ = targets.deformed(mp, targets.waves(mp, 0.05, 2), seed=4)
    source = mp.boundary().loops
    found = register(source, target)
    again = register(source, target, found.landmarks)
    assert again.confidence == 1
    moved = [np.linalg.norm(b - c) for (_, b), (_, c) in zip(found.joints, again.joints, strict=True)]
    assert max(moved) < 0.005 * target.diameter


def test_the_runner_up_of_a_symmetric_outline_is_as_good():
    """A square fits in four ways; given as landmarks, the runner-up is what comes out."""
    source, target = [polygon(SQUARE)], loop(2.0 * SQUARE)
    registration = register(source, target)
    (best,) = registration.loops
    assert registration.runner_up.score == pytest.approx(best.score, abs=1e-6)
    other = register(source, target, registration.runner_up.landmarks)
    images = np.array([b for _, b in other.joints])
    steps = [np.abs(images - 2 * np.roll(SQUARE, k, axis=0)).max() for k in range(4)]
    assert min(steps[1:]) < 1e-6 < steps[0]


def test_mirrored_shapes_are_not_matched_by_reflection():
    mp = models.l_shape()
    target, _ = targets.deformed(mp, lambda x: x * [-1, 1] + 0.1 * x**2, seed=1)
    (r,) = register(mp.boundary().loops, target).loops
    assert r.source.area > 0
    assert r.target.area > 0
    assert (np.diff(r.anchors, axis=0) > 0).all()


@pytest.mark.parametrize("rows", [1, 3])
def test_landmarks_are_kept_by_the_matching_by_shape(rows):
    """Hard constraints, also where shape says otherwise; in between shape decides, better than arc length."""
    mp = examples.load("human")[0]
    f = targets.articulation(mp, 30, 0.6)
    target, truth = targets.deformed(mp, f, seed=3)
    picked = truth[:: len(truth) // rows][:rows]
    (r,) = register(mp.boundary().loops, target, picked).loops
    at = r.source.nearest(picked[:, :2])[0]
    np.testing.assert_allclose(r.target.point(r.to_target(at)), picked[:, 2:], atol=1e-6 * target.diameter)
    assert np.linalg.norm(np.array([r.target.point(s) for s in r.joints[:-1]]) - truth[:, 2:], axis=1).mean() < 0.02
    wrong = picked.copy()
    wrong[:, 2:] = r.target.point(r.target.nearest(picked[:, 2:])[0] + 0.013 * r.target.length)
    (w,) = register(mp.boundary().loops, target, wrong).loops
    np.testing.assert_allclose(w.target.point(w.to_target(at)), wrong[:, 2:], atol=1e-6 * target.diameter)


def test_landmarks_that_shape_cannot_follow_fall_back_to_arc_length_with_a_warning():
    """Arcs of 1 % and 99 % for two halves: no path is that steep."""
    rows = [[0.5, 0, 0.5, 0], [0.5, 1, 0.54, 0]]
    registration = register([polygon(SQUARE)], loop(SQUARE), rows)
    assert any("no matching by shape" in warning for warning in registration.warnings)
    (r,) = registration.loops
    assert (np.diff(r.anchors, axis=0) > 0).all()


def ellipse(centre, axes, hole=False):
    c = circle().reversed() if hole else circle()
    return BSplineCurve(c.knots, 2, c.control_points * axes + centre, c.weights)


#: Loops without corners; the outer one alone fits itself in two ways or in any.
ROUND = {
    "ellipse, round hole": [ellipse((0, 0), (2, 1)), ellipse((1.1, 0.2), (0.3, 0.3), True)],
    "disc, round hole": [ellipse((0, 0), (1, 1)), ellipse((0.3, 0.1), (0.3, 0.3), True)],
    "disc, two round holes": [
        ellipse((0, 0), (1, 1)),
        *(ellipse(centre, (0.2, 0.2), True) for centre in ((0.4, 0.1), (-0.1, -0.5))),
    ],
}


@pytest.mark.parametrize("angle", [0, 100, -120])
@pytest.mark.parametrize("name", ROUND)
def test_holes_tell_how_a_symmetric_outline_is_turned(name, angle):
    """All loops together say where each starts, also a round one: its distances to the others do."""
    move = targets.similarity(angle, 1.5, (3, 1))
    target = []
    for k, curve in enumerate(ROUND[name]):
        moved = BSplineCurve(curve.knots, 2, move(curve.control_points), curve.weights)
        a, b = moved.domain
        middle = a + (0.3 + 0.1 * k) * (b - a)
        cut = [moved.restrict(middle, b), moved.restrict(a, middle)]
        target.append([c.reversed() for c in reversed(cut)] if k == 1 else cut)
    target = Boundary(target[::-1])
    registration = register([[curve] for curve in ROUND[name]], target)
    for r in registration.loops:
        s = np.linspace(0, r.source.length, 50, endpoint=False)
        error = np.linalg.norm(r.target.point(r.to_target(s)) - move(r.source.point(s)), axis=1)
        assert error.max() < 1e-3 * target.diameter
        assert r.margin > 0.3


def test_a_ring_has_no_start():
    """Circle in a circle: any turn fits; the least is taken, and the margin of the outer loop says so."""
    source = [[ellipse((0, 0), (1, 1))], [ellipse((0, 0), (0.5, 0.5), True)]]
    registration = register(source, Boundary([loop[::-1] for loop in source]))
    for a, b in registration.joints:
        np.testing.assert_allclose(b, a, atol=1e-3)
    assert registration.margin < 0.05


def across(mp, degrees, direction):
    """Bend the line through the middle of the box in this direction (degrees) into an arc of the same length."""
    axis, middle = np.exp(1j * np.radians(direction)), np.mean(targets.box(mp), axis=0)
    extent = np.ptp(((mp.topology.coordinates - middle) @ [1, 1j] / axis).real)
    k = np.radians(degrees) / extent

    def f(x):
        z = ((x - middle) @ [1, 1j]) / axis
        bent = axis * (1j / k * (1 - np.exp(1j * k * z.real)) + 1j * z.imag * np.exp(1j * k * z.real))
        return np.column_stack([bent.real, bent.imag])

    return f


@real.needed
@pytest.mark.parametrize("direction", [0, 50, 170])
@pytest.mark.parametrize("degrees", [-60, 60])
def test_a_bend_across_stretches_one_side_and_compresses_the_other(degrees, direction):
    """By half each; distances change with it, but the map is smooth. The outline alone fits better turned by half."""
    mp = real.model("yeti")
    target, truth = targets.deformed(mp, across(mp, degrees, direction), seed=4)
    assert correspondence_error(register(mp.boundary().loops, target), target, truth) < 0.015


def test_a_wrench_bent_across_its_length_is_certified():
    """With joints 0.01 of the diagonal off, two sides cross at a corner, and no injective map exists."""
    mp = examples.load("wrench")[0]
    target, truth = targets.deformed(mp, across(mp, 30, 0), seed=3)
    result = transfer(mp, target, fixed_correspondence=True)
    assert result.certificate.status == "certified"
    assert correspondence_error(result.registration, target, truth) < 0.005


@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("name", models.EXAMPLES)
def test_examples_need_no_landmarks(name, fixed):
    """Ears and hands: places that go a little beside fold the map there, though all corners are right."""
    source, target, _ = examples.load(name)
    result = transfer(source, target, continuity="c0", fixed_correspondence=fixed)
    assert result.certificate.injective
    assert result.quality.scaled_jacobian.mean > (0.93 if fixed else 0.95)
