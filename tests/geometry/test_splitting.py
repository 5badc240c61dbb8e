"""Models split through whole strips: the same geometry, certificates, loops and names, whatever is cut."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import strategies
from patchtransfer import Interface, MultiPatch, Side, certify
from patchtransfer.geometry.conformity.strip_cuts import along_strips
from patchtransfer.geometry.splitting import Origin, split_model, split_patches
from shapes import quad, turned

quick = settings(max_examples=40, deadline=None)

#: Distance of points that are the same after insertions into models a few units wide.
SAME = 1e-12


def through_strips(mp: MultiPatch, wanted: dict) -> dict:
    """Cuts at these fractions of (patch, axis), and what they ask of the strips."""
    asked = {member: [(None, t) for t in at] for member, at in wanted.items()}
    return along_strips(mp.patches, mp.interfaces, asked, lambda own, knots: sorted({t for _, t in own}))


@st.composite
def models_with_cuts(draw):
    """A valid model, its patches turned at random and its boundary sides named, and cuts through its strips."""
    mp = draw(
        st.one_of(
            strategies.multipatches(),
            st.sampled_from([models.o_grid(), models.annulus(), models.l_shape(), loop_that_crosses_itself()]),
        )
    )
    mp = mp.with_labels({f"{k} {side.name}": [(k, side)] for k, side in mp.boundaries})
    wanted: dict = {}
    for _ in range(draw(st.integers(1, 3))):
        member = draw(st.integers(0, len(mp) - 1)), draw(st.integers(0, 1))
        wanted.setdefault(member, []).append(draw(st.floats(0.05, 0.95)).__round__(2))
    return mp, through_strips(mp, wanted)


def loop_that_crosses_itself(seed: int = 3) -> MultiPatch:
    """A ribbon round a hole, and over itself in the first patch, its patches turned at random."""
    inner, outer = [(1, 1), (2, 1), (2, 2), (1, 2), (1, 1)], [(1, 0), (3, 0), (3, 3), (0, 3), (0, 1)]
    corners = [[(0, 0), (1, 0), (1, 1), (0, 1)]]
    corners += [[outer[i], outer[i + 1], inner[i + 1], inner[i]] for i in range(4)]
    random = np.random.default_rng(seed)
    return MultiPatch([turned(quad(*c).elevate(2), *(random.random(3) < 0.5)) for c in corners])


@quick
@given(models_with_cuts())
def test_a_split_model_is_the_same_domain(case):
    mp, cuts = case
    split = split_model(mp, cuts)
    pieces = split.multipatch
    assert len(pieces) == sum((1 + len(cuts.get((k, 0), ()))) * (1 + len(cuts.get((k, 1), ()))) for k in range(len(mp)))
    for piece, origin in zip(pieces, split.origin, strict=True):
        own = [np.linspace(*knots[[0, -1]], 6) for knots in piece.knots]
        there = [np.linspace(*ends, 6) for ends in (origin.u, origin.v)]
        assert np.abs(piece.grid(*own) - mp.patches[origin.patch].grid(*there)).max() < SAME
    assert certify(pieces).injective
    assert len(pieces.loops) == len(mp.loops)
    # Every interface is conforming to the bit, and nothing that belongs together was left apart.
    assert max(pieces.topology.knot_gaps, default=0.0) <= 4 * np.finfo(float).eps
    assert {frozenset([(f.patch_a, f.side_a), (f.patch_b, f.side_b)]) for f in pieces.interfaces} == {
        frozenset([(f.patch_a, f.side_a), (f.patch_b, f.side_b)]) for f in MultiPatch(pieces.patches).interfaces
    }
    # Names go to all pieces of a side, and to no other.
    named = {side for own in pieces.sides.values() for side in own}
    assert named == set(pieces.boundaries)
    for name, own in pieces.sides.items():
        (before,) = mp.sides[name]
        assert {(split.origin[k].patch, side) for k, side in own} == {before}
    assert pieces.ids[: len(mp)] == mp.ids


@quick
@given(models_with_cuts())
def test_other_patches_on_the_same_knots_are_split_alike(case):
    mp, cuts = case
    split = split_model(mp, cuts)
    moved = [patch.with_control_points(2 * patch.control_points + 1) for patch in mp.patches]
    for a, b in zip(split_patches(moved, mp.interfaces, cuts), split.multipatch, strict=True):
        assert a.shape == b.shape
        assert all(np.array_equal(x, y) for x, y in zip(a.knots, b.knots, strict=True))
        assert np.abs(a.control_points - 2 * b.control_points - 1).max() < 10 * SAME


@quick
@given(models_with_cuts(), st.floats(0.1, 0.9))
def test_origins_compose(case, at):
    mp, cuts = case
    first = split_model(mp, cuts)
    again = split_model(first.multipatch, through_strips(first.multipatch, {(0, 0): [at]}))
    for piece, origin in zip(again.multipatch, again.origin, strict=True):
        oldest = origin.within(first.multipatch.patches[origin.patch], first.origin[origin.patch])
        own = [np.linspace(*knots[[0, -1]], 5) for knots in piece.knots]
        there = [np.linspace(*ends, 5) for ends in (oldest.u, oldest.v)]
        assert np.abs(piece.grid(*own) - mp.patches[oldest.patch].grid(*there)).max() < SAME


def test_a_strip_that_crosses_itself_is_cut_both_ways():
    mp = loop_that_crosses_itself()
    cuts = through_strips(mp, {(0, 0): [0.25]})
    assert {(0, 0), (0, 1)} <= cuts.keys()
    split = split_model(mp, cuts)
    assert len(split.multipatch) == 4 + 4 * 2
    assert [origin.patch for origin in split.origin].count(0) == 4
    assert certify(split.multipatch).injective


def test_a_strip_that_closes_is_cut_all_round():
    mp = models.annulus(5)
    around = next(axis for axis in (0, 1) if len(through_strips(mp, {(2, axis): [0.5]})) == 5)
    split = split_model(mp, through_strips(mp, {(2, around): [0.5, 0.25]}))
    assert len(split.multipatch) == 15
    assert len(split.multipatch.loops) == 2


def test_a_cut_at_a_knot_needs_no_other():
    mp = models.grid(2, 1, 3, 2, None)
    split = split_model(mp, through_strips(mp, {(0, 0): [0.5]}))
    assert split.origin[0] == Origin(0, (0.0, 0.5), (0.0, 1.0))
    assert split.multipatch.patches[0].shape[0] == 4


def test_a_side_against_itself_is_cut_at_both_places():
    """A Möbius band is no plane domain, but its strip runs against itself."""
    mp = models.grid(1, 1, 1, 1, None)
    band = [Interface(0, Side.WEST, 0, Side.EAST, True)]
    cuts = along_strips(mp.patches, band, {(0, 1): [(None, 0.25)]}, lambda own, knots: sorted(t for _, t in own))
    assert cuts == {(0, 1): pytest.approx([0.25, 0.75])}
