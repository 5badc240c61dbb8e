"""Rational sources: weights stay, control points move; what weights rule out is said."""

from __future__ import annotations

import numpy as np
import pytest

import conics
import patchtransfer as pt
import targets
from patchtransfer import Boundary, BSplineCurve, InputError, MultiPatch, Patch, TransferPlan

TURN = np.array([[np.cos(0.6), np.sin(0.6)], [-np.sin(0.6), np.cos(0.6)]])
#: Affine images of the outer and the inner circle of an annulus.
IMAGES = {
    "eccentric": (lambda x: 1.2 * x, lambda x: 0.8 * x + [0.45, 0.2]),
    "ellipse": (lambda x: x * [1.8, 0.9], lambda x: 0.7 * x @ TURN + [0.5, 0.1]),
}


def given(mp: MultiPatch, images) -> np.ndarray:
    """Shared control points with the loops' images."""
    points = np.array(mp.topology.coordinates)
    for loop, image in zip(mp.topology.loops, images, strict=True):
        for side in loop:
            at = side.points(mp.topology.points[side.patch])
            points[at] = image(mp.topology.coordinates[at])
    return points


def kept(mp: MultiPatch, out: MultiPatch) -> None:
    for before, after in zip(mp, out, strict=True):
        assert before.weights is None if after.weights is None else np.array_equal(before.weights, after.weights)


def kink(mp: MultiPatch) -> float:
    return pt.check_continuity(mp).to_dict()["kink_deg"]["max"]


@pytest.mark.parametrize("name", IMAGES)
@pytest.mark.parametrize("spans", [2, 4])
def test_conics_stay_exact_and_patches_join_smoothly(name, spans):
    mp = conics.annulus(spans=spans)
    plain, smooth = (TransferPlan(mp, c).refill(given(mp, IMAGES[name])) for c in ("c0", "c1"))
    for found in (plain, smooth):
        assert found.certificate.status == "certified"
        kept(mp, found.multipatch)
        for k, loop in enumerate(found.multipatch.topology.loops):
            for side in loop:
                t = np.linspace(0, 1, 101)
                image = IMAGES[name][k](side.curve(mp.patches)(t))
                np.testing.assert_allclose(side.curve(found.multipatch.patches)(t), image, rtol=0, atol=1e-14)
    # Rows with the ratio of weights as a factor hold exactly; without them patches meet at angles.
    assert kink(smooth.multipatch) < 1e-10 < 1e-2 < kink(plain.multipatch)


@pytest.mark.parametrize("name", IMAGES)
def test_patches_join_smoothly_along_arcs_whose_weights_vary(name):
    # Two rings: from one to the other the ratio of weights is one number, along the arcs between them they differ.
    rings = [*conics.ring(0.5, 0.75), *conics.ring(0.75, 1.0)]
    mp = MultiPatch([patch.split_spans(3) for patch in rings])
    plain, smooth = (TransferPlan(mp, c).refill(given(mp, IMAGES[name])) for c in ("c0", "c1"))
    assert smooth.certificate.status == "certified"
    kept(mp, smooth.multipatch)
    assert kink(smooth.multipatch) < 1e-10 < 1e-2 < kink(plain.multipatch)


def test_rows_do_not_depend_on_the_sense_of_parameters():
    # A quarter of two rings whose arcs have other weights at one end than at the other.
    made, kinks = [], []
    for patch in [*conics.ring(0.5, 0.75, 2, np.pi / 2), *conics.ring(0.75, 1.0, 2, np.pi / 2)]:
        made.append(Patch(patch.knots, patch.degrees, patch.control_points, patch.weights * 1.5 ** np.arange(3)))
    mp = MultiPatch([patch.split_spans(2) for patch in made])
    turned = conics.spun(
        mp, [(True, False, True), (False, False, True), (False, True, False), (True, True, True)], [2, 0, 3, 1]
    )
    for model in (mp, turned):
        points = targets.bend(model, 25)(model.topology.coordinates)
        found = TransferPlan(model, "c1").refill(points)
        assert found.certificate.injective
        kinks.append(kink(found.multipatch))
    assert kinks[1] == pytest.approx(kinks[0], rel=1e-6)


def test_more_knots_lower_the_energy_of_the_same_map():
    # Spaces of refined NURBS contain one another, weights and all.
    mean = []
    for spans in (1, 2, 4):
        mp = conics.annulus(spans=spans)
        found = TransferPlan(mp, "c0").refill(given(mp, IMAGES["eccentric"]))
        mean.append(pt.similarity(mp, found.multipatch).rms)
    assert mean[0] > mean[1] > mean[2]


@pytest.mark.parametrize("continuity", ["c0", "c1"])
@pytest.mark.parametrize("degrees", [-40, 30])
def test_bent_plates_of_rational_and_polynomial_patches(continuity, degrees):
    mp = conics.plate(2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, degrees))
    result = pt.transfer(mp, target, landmarks, continuity)
    assert result.certificate.status == "certified"
    assert result.boundary_error < 2e-3
    if not result.refined:
        kept(mp, result.multipatch)
    if continuity == "c1":
        # Weights beside the arcs' common radius are in one ratio to those on it, beside the far side they are not.
        names = [result.multipatch.interfaces[i].name for i in result.rows.without]
        assert names
        assert any("C0 only" in text and names[0] in text for text in result.warnings)


def test_fits_are_as_near_as_those_without_weights():
    mp = conics.annulus(spans=2)
    net = MultiPatch([Patch(p.knots, p.degrees, p.control_points) for p in mp], mp.interfaces)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    rational, polynomial = (
        pt.transfer(x, target, landmarks, "c0", refine="never", fixed_correspondence=True) for x in (mp, net)
    )
    assert rational.certificate.injective
    assert rational.boundary_error < 1.3 * polynomial.boundary_error


def test_a_source_is_its_own_target():
    mp = conics.annulus(spans=2)
    loops = mp.boundary().loops
    rows = np.array([[*c.start, *c.start] for loop in loops for c in loop])
    result = pt.transfer(mp, Boundary(loops), rows, "c0", fixed_correspondence=True)
    np.testing.assert_allclose(result.multipatch.topology.coordinates, mp.topology.coordinates, atol=1e-8)


def test_morphs_and_drags_keep_weights():
    mp = conics.annulus(spans=2)
    other = TransferPlan(mp, "c0").refill(given(mp, IMAGES["eccentric"])).multipatch
    between = pt.morph(mp, other, 3)
    assert between.certified
    kept(mp, between.frames[1].multipatch)
    x = mp.boundary().loops[0][0](0.5)
    dragged = pt.deform(mp, [[*x, *(1.1 * x)]])
    assert dragged.certificate.injective
    kept(mp, dragged.multipatch)


@pytest.mark.parametrize("continuity", ["c0", "c1"])
@pytest.mark.parametrize("degrees", [-40, -20, 20, 40])
def test_straight_corners_inside_are_opened_where_they_would_fold(continuity, degrees):
    mp = conics.disc_in_a_square()
    assert pt.certify(mp).status == "degenerate"
    target, landmarks = targets.deformed(mp, targets.bend(mp, degrees))
    result = pt.transfer(mp, target, landmarks, continuity)
    assert result.certificate.status == "certified"
    assert result.quality.scaled_jacobian.min > 0.2
    assert any("with these corners open" in entry for entry in result.log)
    kept(mp, result.multipatch)


def test_straight_corners_inside_that_do_not_fold_stay():
    mp = conics.disc_in_a_square()
    found = TransferPlan(mp, "c0").refill(mp.topology.coordinates)
    np.testing.assert_allclose(found.multipatch.topology.coordinates, mp.topology.coordinates, atol=1e-5)
    assert found.certificate.injective


def test_what_takes_no_weights_offers_conversion():
    mp = conics.annulus(spans=2)
    with pytest.raises(InputError, match=r'patch 0 .*rational .*continuity="g1".*to_polynomial'):
        TransferPlan(mp, "g1")
    plan = TransferPlan(mp)
    with pytest.raises(InputError, match=r'rational .*method="paper".*to_polynomial'):
        plan.transfer(mp.boundary(), method="paper")


def test_layouts_take_rational_outlines():
    angle = np.pi / 2 * np.arange(4)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    quads = [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    loops = conics.annulus().boundary()
    result = pt.from_layout(np.concatenate([ring / 2, ring]), [q[::-1] for q in quads], loops, degree=3, spans=2)
    assert result.certificate.injective
    # Of a layout patches are polynomial: near a circle, not on it.
    assert 1e-9 < result.boundary_error < 1e-3
    assert all(patch.weights is None for patch in result.multipatch)


def drop(tip: float, outer: float = 1.0, inner: float = 0.5) -> Boundary:
    """An annulus whose rim has a corner, at 45 degrees."""
    at = tip * np.array([np.cos(np.pi / 4), np.sin(np.pi / 4)])
    from_centre = np.arccos(outer / tip)
    ends = [outer * np.array([np.cos(np.pi / 4 + a), np.sin(np.pi / 4 + a)]) for a in (from_centre, -from_centre)]
    turn = (2 * np.pi - 2 * from_centre) / 3
    arcs = [conics.arc(turn, np.pi / 4 + from_centre + k * turn) for k in range(3)]
    rim = [c.with_control_points(outer * c.control_points) for c in arcs]
    lines = [BSplineCurve([0, 0, 1, 1], 1, [ends[1], at]), BSplineCurve([0, 0, 1, 1], 1, [at, ends[0]])]
    return Boundary([[*rim, *lines], conics.annulus(inner, outer).boundary().loops[1]])


def test_split_sources_keep_weights_and_exact_holes():
    mp = conics.annulus(spans=2)
    rows = np.array([[*c.start, *c.start] for c in mp.boundary().loops[0]])
    result = pt.transfer(mp, drop(1.25), rows, continuity="c0", split="auto")
    assert result.certificate.injective
    assert result.split is not None
    assert len(result.multipatch) > len(mp)
    assert all(patch.weights is not None for patch in result.multipatch)
    assert result.boundary_error < 2e-3
    hole = [side.curve(result.multipatch.patches) for side in result.multipatch.topology.loops[1]]
    x = np.concatenate([curve(np.linspace(*curve.domain, 50)) for curve in hole])
    np.testing.assert_allclose(np.hypot(*x.T), 0.5, rtol=0, atol=1e-14)


@pytest.mark.parametrize("degrees", [20, 30])
def test_knots_that_would_follow_wiggles_across_themselves_are_not_inserted(degrees):
    # The target's splines overshoot where the plate's far side has a corner between its joints.
    mp = conics.cornered_plate()
    target, landmarks = targets.deformed(mp, targets.bend(mp, degrees))
    result = pt.transfer(mp, target, landmarks, "c0", on_failure="return")
    assert result.certificate.injective
    assert result.boundary_error < 3e-3
    assert any("with more knots the fitted boundary rules out" in text for text in result.warnings)


def test_references_have_the_source_s_weights():
    mp = conics.annulus()
    bare = [Patch(p.knots, p.degrees, p.control_points) for p in mp]
    plan = TransferPlan(mp, "c0", reference=bare)
    with pytest.raises(InputError, match="reference: patch 0 has other weights"):
        plan.refill(mp.topology.coordinates)


def test_curves_of_a_fit_keep_their_weights():
    mp = conics.annulus()
    result = pt.transfer(mp, conics.annulus(0.4, 1.3).boundary(), continuity="c0", fixed_correspondence=True)
    assert all(isinstance(side.curve, BSplineCurve) for loop in result.fitted.loops for side in loop)
    assert all(side.curve.weights is not None for loop in result.fitted.loops for side in loop)
