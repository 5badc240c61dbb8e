"""Knot insertion along strips of patches, and refinement of a source to the fit tolerance."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import targets
from patchtransfer.fitting.fit import fit_boundary
from patchtransfer.fitting.refinement import insert_in_strips, missed_spans, span_middles
from patchtransfer.geometry.strips import strips
from patchtransfer.registration.register import register


def inserted(mp: pt.MultiPatch, knots) -> pt.MultiPatch:
    return pt.MultiPatch(insert_in_strips(mp.topology, mp.patches, knots), mp.interfaces, mp.ids)


def same_geometry(a: pt.MultiPatch, b: pt.MultiPatch) -> None:
    t = np.linspace(0, 1, 7)
    for before, after in zip(a.patches, b.patches, strict=True):
        (u0, u1), (v0, v1) = (k[[0, -1]] for k in before.knots)
        u, v = u0 + t * (u1 - u0), v0 + t * (v1 - v0)
        np.testing.assert_allclose(after.grid(u, v), before.grid(u, v), atol=1e-13 * a.diameter)


@given(st.sampled_from(sorted(models.ALL)), st.data())
@settings(max_examples=30, deadline=None)
def test_knots_reach_the_whole_strip_and_interfaces_conform(name, data):
    mp = models.ALL[name]()
    knots = data.draw(
        st.lists(
            st.tuples(st.integers(0, len(mp) - 1), st.integers(0, 1), st.floats(0.01, 0.99)), min_size=1, max_size=4
        )
    )
    # MultiPatch checks that knots agree along all interfaces.
    finer = inserted(mp, knots)
    same_geometry(mp, finer)
    for k, axis, t in knots:
        members = next(strip.members for strip in strips(mp.topology) if (k, axis) in strip.members)
        for (other, along), against in members.items():
            x = 1 - t if against != members[k, axis] else t
            assert np.abs(finer.patches[other].knots[along] - x).min() < 1e-12


def test_a_strip_crosses_patches_and_ends_at_the_boundary():
    mp = models.grid(3, 2, 2, 2, seed=None)
    sizes = sorted(len(strip.members) for strip in strips(mp.topology))
    # Three columns of two patches and two rows of three.
    assert sizes == [2, 2, 2, 3, 3]


def test_uniform_refinement_halves_every_span():
    mp = models.o_grid(3, 3)
    patches = insert_in_strips(mp.topology, mp.patches, span_middles(mp.patches))
    finer = pt.MultiPatch(patches, mp.interfaces)
    same_geometry(mp, finer)
    for before, after in zip(mp.patches, finer.patches, strict=True):
        for a, b in zip(before.knots, after.knots, strict=True):
            assert len(np.unique(b)) == 2 * len(np.unique(a)) - 1


@pytest.mark.parametrize("name", ["grid p2", "plate with hole p3", "o-grid p2", "l-shape p3"])
def test_automatic_refinement_reaches_the_fit_tolerance(name):
    mp = models.ALL[name]()
    target, landmarks = targets.deformed(mp, targets.bump(mp, (0.8, 0.5), (0.15, 0.1), 0.15), seed=3, degree=3)
    coarse = pt.transfer(mp, target, landmarks, fit_tolerance=1e-5, refine="never", on_failure="return")
    assert coarse.boundary_error > 1e-5
    assert any("refine the source" in w for w in coarse.warnings)
    result = pt.transfer(mp, target, landmarks, fit_tolerance=1e-5, refine="tolerance")
    assert result.certificate.injective
    assert result.boundary_error <= 1e-5
    assert any("the source was refined" in w for w in result.warnings)
    assert result.multipatch.interfaces == mp.interfaces
    # Fewer points than uniform refinement to the same spans needs: only strips that need it are refined.
    needed = max(len(np.unique(k)) - 1 for p in result.multipatch.patches for k in p.knots)
    uniform, rounds = mp, 0
    while max(len(np.unique(k)) - 1 for p in uniform.patches for k in p.knots) < needed and rounds < 6:
        uniform, rounds = uniform.split_spans(2), rounds + 1
    assert result.multipatch.topology.n_points < uniform.topology.n_points


def test_refinement_keeps_the_room_that_exact_g1_needs():
    """Found by trial: simple knots made the plan refuse its own source."""
    mp = models.ALL["l-shape p3"]().split_spans().reduce_continuity(1)
    target, landmarks = targets.deformed(mp, targets.bump(mp, (0.8, 0.5), (0.15, 0.1), 0.15), seed=3, degree=3)
    result = pt.transfer(mp, target, landmarks, "g1", fit_tolerance=1e-5, refine="tolerance")
    assert result.certificate.injective
    assert result.boundary_error <= 1e-5
    assert any("the source was refined" in w for w in result.warnings)
    for patch in result.multipatch.patches:
        for p, knots in zip(patch.degrees, patch.knots, strict=True):
            assert np.unique(knots[p + 1 : -p - 1], return_counts=True)[1].min(initial=2) >= 2


def test_nothing_is_refined_within_the_tolerance():
    mp = models.grid(2, 2, 3, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 20))
    result = pt.transfer(mp, target, landmarks, refine="tolerance", fit_tolerance=1e-2)
    assert result.multipatch.topology.n_points == mp.topology.n_points
    assert not any("refined" in w for w in result.warnings)


def test_missed_spans_are_where_the_bump_is():
    mp = models.grid(2, 1, 2, 3)
    target, landmarks = targets.deformed(mp, targets.bump(mp, (1.0, 0.5), (0.1, 0.0), 0.12), seed=1)
    registration = register(mp.boundary().loops, target, landmarks)
    fitted = fit_boundary(registration)
    found = missed_spans(registration, fitted, mp.topology.loops, fitted.error / 2)
    assert found
    high = mp.topology.coordinates[:, 0].max()
    for k, axis, t in found:
        patch = mp.patches[k]
        (u0, u1), (v0, v1) = (knots[[0, -1]] for knots in patch.knots)
        on_sides = [patch(t, v) for v in (v0, v1)] if axis == 0 else [patch(u, t) for u in (u0, u1)]
        assert max(point[0] for point in on_sides) > high - 0.5
