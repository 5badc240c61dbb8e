"""Corners of one patch opened for a second one, and patches left out: the rest of the model stays."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import models
import strategies
from patchtransfer import Interface, MultiPatch, Side, certify
from patchtransfer.geometry.ears import ears, nothing_lost, without_patches
from patchtransfer.geometry.opened_corner import open_corners
from patchtransfer.geometry.outline import Outline, hausdorff
from patchtransfer.geometry.splitting import SplitModel
from patchtransfer.pipeline.opening import opened
from shapes import quad, turned

quick = settings(max_examples=30, deadline=None)
SAME = 1e-12


def lone_corners(mp: MultiPatch) -> list[tuple[int, int]]:
    """Corners (patch, corner) of the boundary that one patch fills."""
    return [vertex.corners[0] for vertex in mp.topology.vertices if vertex.valence == 1]


@st.composite
def models_with_a_corner(draw):
    mp = draw(
        st.one_of(
            strategies.multipatches(),
            st.sampled_from([models.l_shape(), models.star(3), models.star(6), models.grid(3, 2, 3, 3)]),
        )
    )
    corners = lone_corners(mp)
    # Sources are polynomial.
    assume(corners and not mp.is_rational)
    mp = mp.with_labels({f"{k} {side.name}": [(k, side)] for k, side in mp.boundaries})
    return mp, draw(st.sampled_from(corners))


@quick
@given(models_with_a_corner(), st.booleans())
def test_an_opened_corner_changes_nothing_else(case, cutting):
    mp, (patch, corner) = case
    made = open_corners(mp, patch, [corner], cutting=cutting)
    assume(made is not None)
    opened = made.multipatch
    assert certify(opened).injective
    # Two patches meet at the corner now, and three around M inside, or around each of four.
    at = opened.topology.coordinates
    place = mp.patches[patch].control_points[-(corner & 1), -(corner >> 1)]
    (there,) = (vertex for vertex in opened.topology.vertices if np.array_equal(at[vertex.point], place))
    assert there.valence == 2
    inside = [v.valence for v in opened.topology.vertices if v.interior and v.valence == 3]
    assert len(inside) - sum(v.interior and v.valence == 3 for v in mp.topology.vertices) in (
        (1,) if cutting else (3, 4)
    )
    # All that is not of the patch is what it was.
    for piece, origin in zip(opened, made.origin, strict=True):
        if origin.patch != patch:
            own = [np.linspace(*knots[[0, -1]], 6) for knots in piece.knots]
            ends = [np.linspace(*ends, 6) for ends in (origin.u, origin.v)]
            assert np.abs(piece.grid(*own) - mp.patches[origin.patch].grid(*ends)).max() < SAME
    assert sum(origin.patch == patch for origin in made.origin) == (3 if cutting else 5)
    if not cutting:
        assert len(opened) == len(mp) + 4
    the_outline_is_as_it_was(mp, made)
    assert made.piece_at(patch, corner)[1] == corner


def the_outline_is_as_it_was(mp: MultiPatch, made: SplitModel) -> None:
    """With its names, and every side is the chain of its parts."""
    opened = made.multipatch
    for old, new in zip(mp.boundary().loops, opened.boundary().loops, strict=True):
        assert hausdorff(Outline(old), Outline(new)) < 1e-7
    assert {side for own in opened.sides.values() for side in own} == set(opened.boundaries)
    for (k, side), own in made.parts.items():
        ends = side.of(mp.patches[k].control_points)[[0, -1]]
        chain = [name.of(opened.patches[j].control_points)[[0, -1]] for j, name in own]
        assert np.abs(np.array([chain[0][0], chain[-1][1]]) - ends).max() < SAME
        assert all(np.array_equal(a[1], b[0]) for a, b in itertools.pairwise(chain))
        for j, name in own if (k, side) in mp.boundaries else ():
            low, high = (made.origin[j].u, made.origin[j].v)[side.axis]
            t, t_old = np.linspace(*opened.patches[j].domain[side.axis], 9), np.linspace(low, high, 9)
            across, there = (p.domain[1 - side.axis][side.at_end] for p in (opened.patches[j], mp.patches[k]))
            new = opened.patches[j](t, across) if side.axis == 0 else opened.patches[j](across, t)
            old = mp.patches[k](t_old, there) if side.axis == 0 else mp.patches[k](there, t_old)
            assert name == side
            assert np.abs(new - old).max() < 100 * SAME
    assert max(opened.topology.knot_gaps, default=0.0) <= 4 * np.finfo(float).eps


@quick
@given(models_with_a_corner())
def test_all_corners(case):
    """Patch after patch, each on what the last has made, seen from the model as it was."""
    mp, _ = case
    model = opened(mp, lone_corners(mp))
    assume(model is not None)
    assert lone_corners(model.multipatch) == []
    assert certify(model.multipatch).injective
    assert {origin.patch for origin in model.origin} == set(range(len(mp)))
    assert {side for side in mp.boundaries for side in model.parts[side]} == set(model.multipatch.boundaries)
    the_outline_is_as_it_was(mp, model)


@pytest.mark.parametrize("ends", [(0, 1), (0, 2), (1, 3), (2, 3)])
def test_two_corners_of_one_side(ends):
    """The last patch of a row: its two free corners, wherever its parameters begin."""
    side = {(0, 1): Side.NORTH, (0, 2): Side.EAST, (1, 3): Side.WEST, (2, 3): Side.SOUTH}[ends]
    tip = quad((0, 0), (1, 0), (1.2, 1), (0, 1.1)).elevate(2).split_spans(3)
    ends_of = {Side.NORTH: (3, 2), Side.EAST: (1, 2), Side.WEST: (0, 3), Side.SOUTH: (0, 1)}[side]
    corners = [(0, 0), (1, 0), (1.2, 1), (0, 1.1)]
    a, b = (np.array(corners[i], float) for i in ends_of)
    out = np.array([b[1] - a[1], a[0] - b[0]]) * (1 if side in (Side.EAST, Side.SOUTH) else -1)
    beside = quad(a, a + out, b + out, b)
    mp = MultiPatch([tip, beside.elevate(2).split_spans(3)])
    assert len(mp.interfaces) == 1
    mp = mp.with_labels({f"{k} {s.name}": [(k, s)] for k, s in mp.boundaries})
    made = open_corners(mp, 0, ends)
    assert certify(made.multipatch).status == "certified"
    assert len(made.multipatch) == 4 + 3
    assert len(lone_corners(made.multipatch)) == len(lone_corners(mp)) - 2
    the_outline_is_as_it_was(mp, made)


def test_patches_of_other_degrees_in_u_and_v():
    mp = MultiPatch([quad((0, 0), (3, 0), (3, 1), (0, 1)).elevate(1)])
    patch = mp.patches[0]._along(1, lambda k, p, c: (k, c, p))
    tall = MultiPatch([patch, quad((3, 0), (4, 0), (4, 1), (3, 1)).elevate(1)])
    made = open_corners(tall, 0, [0])
    assert certify(made.multipatch).status == "certified"
    assert made.multipatch.topology.n_components == 1


def test_where_a_strip_comes_back_there_is_no_room():
    """A ribbon over itself in the first patch, with a tail that has the corner."""
    inner, outer = [(1, 1), (2, 1), (2, 2), (1, 2), (1, 1)], [(1, 0), (3, 0), (3, 3), (0, 3), (0, 1)]
    corners = [[(0, 0), (1, 0), (1, 1), (0, 1)]]
    corners += [[outer[i], outer[i + 1], inner[i + 1], inner[i]] for i in range(4)]
    mp = MultiPatch([quad(*c).elevate(1) for c in corners])
    assert (0, 0) in lone_corners(mp)
    assert open_corners(mp, 0, [0]) is None
    around = open_corners(mp, 0, [0], cutting=False)
    assert certify(around.multipatch).status == "certified"
    assert len(around.multipatch) == len(mp) + 4


def serif() -> MultiPatch:
    """A stem with two ears, all patches turned."""
    cells = [((0, 0), (1, 3)), ((-1, 0), (0, 1)), ((1, 0), (2, 1))]
    quads = [quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((0, 1), (1, 1), (1, 3), (0, 3))]
    quads += [quad((a[0], a[1]), (b[0], a[1]), (b[0], b[1]), (a[0], b[1])) for a, b in cells[1:]]
    flags = [(False, True, False), (True, False, True), (True, True, True), (False, False, True)]
    return MultiPatch([turned(patch.elevate(1), *how) for patch, how in zip(quads, flags, strict=True)])


def test_ears():
    mp = serif()
    assert {ear.patch for ear in ears(mp.topology)} == {1, 2, 3}
    for ear in ears(mp.topology):
        sides = mp.loops[ear.loop]
        assert [sides[(ear.side + j) % len(sides)].patch for j in range(3)] == [ear.patch] * 3
    assert ears(MultiPatch([quad((0, 0), (1, 0), (1, 1), (0, 1))]).topology) == []
    assert ears(models.annulus().topology) == []


def test_a_model_without_its_ears():
    mp = serif().with_labels({"foot": [(0, side) for k, side in serif().boundaries if k == 0]})
    made = without_patches(mp, [2, 3])
    left = made.multipatch
    assert left.patches == (mp.patches[0], mp.patches[1])
    assert left.ids == (0, 1)
    assert left.sides == mp.sides
    assert len(left.interfaces) == 1
    assert [origin.patch for origin in made.origin] == [0, 1]
    assert all(made.parts[2, side] == [] for side in Side)
    assert made.parts[1, Side.WEST] == [(1, Side.WEST)]
    other = without_patches(mp, [0])
    assert other.multipatch.ids == (1, 2, 3)
    assert other.multipatch.interfaces == ()
    assert all(own == () for own in other.multipatch.sides.values())


def test_what_a_file_says_of_a_patch_is_not_lost():
    mp = serif()
    assert all(nothing_lost(mp, k) for k in range(4))
    named = mp.with_labels({"left": [(2, Side.WEST)]})
    assert [nothing_lost(named, k) for k in range(4)] == [True, True, False, True]


@pytest.mark.parametrize("reversed_", [False, True])
def test_a_patch_glued_to_itself_is_not_opened(reversed_):
    mp = models.grid(1, 1, 2, 2, None)
    glued = object.__new__(MultiPatch)
    glued.__dict__.update(mp.__dict__, interfaces=(Interface(0, Side.EAST, 0, Side.NORTH, reversed_),))
    assert open_corners(glued, 0, [0]) is None
