"""Inferred interfaces: exactly the sides that are one, whatever the patches' proportions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import models
from patchtransfer import InputError, Interface, MultiPatch, Patch, Side, certify
from patchtransfer.geometry.interfaces import infer_interfaces
from shapes import LINE, quad, turned

quick = settings(max_examples=150, deadline=None)


def pairs(interfaces) -> set:
    return {frozenset([(f.patch_a, f.side_a), (f.patch_b, f.side_b)]) for f in interfaces}


def shared(patches: list[Patch]) -> set:
    """Patches (numbers) that inferred interfaces glue."""
    return {frozenset([f.patch_a, f.patch_b]) for f in infer_interfaces(patches)}


widths = st.lists(st.floats(-8, 0), min_size=1, max_size=4)


@st.composite
def thin_grids(draw):
    """Grids of cells of any proportions up to 1e8, mapped affinely, with the neighbours that they should have.

    At most one cell is missing: its gap may be as thin as the cells beside it, which tell it from an interface.
    """
    x, y = (np.concatenate([[0.0], np.cumsum(10.0 ** np.array(draw(widths)))]) for _ in "xy")
    cells = [(i, j) for i in range(len(x) - 1) for j in range(len(y) - 1)]
    if len(x) > 2 and len(y) > 2 and draw(st.booleans()):
        cells.remove(draw(st.sampled_from(cells)))
    cells = draw(st.permutations(cells))
    angle, shear = draw(st.floats(0, 6.3)), draw(st.floats(-10, 10))
    c, s = np.cos(angle), np.sin(angle)
    affine = np.array([[c, -s], [s, c]]) @ np.array([[1, shear], [0, 1]])
    made = []
    for i, j in cells:
        points = np.array([[x[i], y[j]], [x[i + 1], y[j]], [x[i + 1], y[j + 1]], [x[i], y[j + 1]]])
        patch = quad(*points @ affine.T)
        made.append(turned(patch, *(draw(st.booleans()) for _ in "tuv")))
    expected = {
        frozenset([k, m])
        for k, (i, j) in enumerate(cells)
        for m, (a, b) in enumerate(cells)
        if abs(i - a) + abs(j - b) == 1
    }
    return made, expected


@quick
@given(thin_grids(), st.integers(-400, 400), st.tuples(st.floats(-3, 3), st.floats(-3, 3)), st.randoms())
def test_neighbours_of_any_proportions_are_found(grid, power, shift, random):
    made, expected = grid
    assert shared(made) == expected
    # A power of two changes no digit; a shift rounds the thinnest cells to eight.
    assert infer_interfaces([p.with_control_points(np.ldexp(p.control_points, power)) for p in made]) == (
        infer_interfaces(made)
    )
    assert shared([p.with_control_points(p.control_points + shift) for p in made]) == expected
    order = list(range(len(made)))
    random.shuffle(order)
    found = infer_interfaces([made[k] for k in order])
    renamed = {frozenset([(order[f.patch_a], f.side_a), (order[f.patch_b], f.side_b)]) for f in found}
    assert renamed == pairs(infer_interfaces(made))


@pytest.mark.parametrize("thickness", [1e-5, 1e-6, 1e-8, 1e-12])
def test_a_thin_patch_is_not_glued_to_itself(thickness):
    patch = quad((0, 0), (1, 0), (1, thickness), (0, thickness))
    assert infer_interfaces([patch]) == ()
    assert certify(MultiPatch([patch])).status == "certified"
    for wrong in (Interface(0, Side.SOUTH, 0, Side.NORTH, False), Interface(0, Side.EAST, 0, Side.WEST, False)):
        with pytest.raises(InputError, match=r"control points are .* apart"):
            MultiPatch([patch], [wrong])


def test_the_refusal_names_the_thin_patch():
    thin, thick = quad((0, 0), (1, 0), (1, 1e-7), (0, 1e-7)), quad((0, 2e-7), (1, 2e-7), (1, 1), (0, 1))
    with pytest.raises(InputError, match="half the thickness of patch 1"):
        MultiPatch([thick, thin], [Interface(0, Side.SOUTH, 1, Side.NORTH, False)])


@pytest.mark.parametrize("opening", [1e-6, 1e-9])
def test_slivers_between_two_of_a_patchs_sides_are_not_closed(opening):
    """South and west of these patches nearly coincide: gluing them would take the patch away."""
    rhombus = quad((0, 0), (1, 0), (2, opening), (1, opening))
    kite = quad((0, 0), (1, 0), (100, 0.5 * opening), (1, opening))
    lens = Patch(([0] * 3 + [1] * 3, LINE), (2, 1), [[(0, 0)] * 2, [(1, -opening), (1, opening)], [(2, 0)] * 2])
    for patch in (rhombus, kite, lens):
        assert infer_interfaces([patch]) == ()


def test_patches_without_area_are_not_glued_to_themselves():
    assert infer_interfaces([quad((0, 0), (1, 0), (1, 0), (0, 0))]) == ()
    assert infer_interfaces([quad((1, 1), (1, 1), (1, 1), (1, 1))]) == ()


def test_no_gap_is_bridged_that_a_neighbour_fills():
    """Two thin patches fill the gap under a long side, which matches neither of them."""
    t = 1e-7
    low, high = quad((0, -1), (1, -1), (1, 0), (0, 0)), quad((0, t), (1, t), (1, 1), (0, 1))
    halves = [quad((x, 0), (x + 0.5, 0), (x + 0.5, t), (x, t)) for x in (0, 0.5)]
    assert shared([low, high, *halves]) == {frozenset([2, 3])}


@pytest.mark.parametrize("count", [1, 2, 4])
@pytest.mark.parametrize("ring", [1.0, 1e-3, 1e-7])
def test_rings_close_however_thin(count, ring):
    ringed = []
    for patch in models.annulus(count, 3, 4, None).patches:
        # v runs outwards.
        inner = patch.control_points[:, :1]
        ringed.append(patch.with_control_points(inner + ring * (patch.control_points - inner)))
    found = infer_interfaces(ringed)
    assert len(found) == count
    assert {s for f in found for s in (f.side_a, f.side_b)} == {Side.WEST, Side.EAST}
    assert len(MultiPatch(ringed).loops) == 2


@pytest.mark.parametrize("digits", [6, 7, 10])
@pytest.mark.parametrize("thin", [1.0, 1e-2, 1e-3])
def test_few_written_digits_are_still_glued(digits, thin):
    exact = models.grid(3, 3, 2, 2).patches
    rng = np.random.default_rng(digits)
    # Half a unit of the last digit either way, as when both sides were computed by themselves.
    written = [
        p.with_control_points(
            np.round(p.control_points * [1, thin] + rng.uniform(-0.5, 0.5, (*p.shape, 2)) * 10.0**-digits, digits)
        )
        for p in exact
    ]
    assert pairs(infer_interfaces(written)) == pairs(infer_interfaces(exact))
    assert MultiPatch(written).interfaces == infer_interfaces(written)


def test_sides_computed_by_themselves_far_from_the_origin():
    """Rounding of a large coordinate is more than half the thickness of a thin patch."""
    far, t = 2.0**20, 2.0**-30
    a, b = (quad((far, k * t), (far + 1, k * t), (far + 1, (k + 1) * t), (far, (k + 1) * t)) for k in (0, 1))
    moved = b.with_control_points(b.control_points + np.array([4 * np.spacing(far), 0]))
    assert shared([a, moved]) == {frozenset([0, 1])}


@settings(max_examples=30, deadline=None)
@given(st.integers(20, 300))
@example(1000)
def test_many_copies_of_a_patch_end_quickly(count):
    """Not a model, but a file may hold it: every copy is glued at most once a side."""
    found = infer_interfaces([quad((0, 0), (1, 0), (1, 1), (0, 1))] * count)
    sides = [s for f in found for s in ((f.patch_a, f.side_a), (f.patch_b, f.side_b))]
    assert len(set(sides)) == len(sides)
