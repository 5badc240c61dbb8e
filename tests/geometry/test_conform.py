"""Models that were broken on purpose conform again: certified, with the same geometry, whatever was done to them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import models
import strategies
from patchtransfer import Block, InputError, Interface, MultiPatch, Patch, Side, certify, conform
from patchtransfer.geometry.conformity.nearest import nearest_on_curve
from shapes import LINE, bicubic, cut, quad, reparameterized, turned

quick = settings(max_examples=40, deadline=None)

#: Distance of points that are the same after insertions, elevations and cuts of models a few units wide.
SAME = 1e-11


def along(patch: Patch, axis: int, fraction: float) -> float:
    """A parameter; a knot where one is so near that no program would write both."""
    first, last = patch.knots[axis][[0, -1]]
    t = float(first + fraction * (last - first))
    nearest = float(patch.knots[axis][np.abs(patch.knots[axis] - t).argmin()])
    return nearest if abs(nearest - t) < 1e-7 * (last - first) else t


def samples(patch: Patch, n: int = 5) -> np.ndarray:
    return patch.grid(*(np.linspace(*k[[0, -1]], n) for k in patch.knots)).reshape(-1, 2)


def area(patches) -> float:
    """Sum of the patches' areas: a quadrature that is exact for polynomials of the degrees here."""
    total = 0.0
    nodes, weights = np.polynomial.legendre.leggauss(8)
    for patch in patches:
        ts, ws = [], []
        for knots in patch.knots:
            breaks = np.unique(knots)
            middle, half = (breaks[1:] + breaks[:-1]) / 2, np.diff(breaks) / 2
            ts.append((middle[:, None] + half[:, None] * nodes).ravel())
            ws.append((half[:, None] * weights).ravel())
        du, dv = patch.grid(*ts, du=1), patch.grid(*ts, dv=1)
        total += abs(float(ws[0] @ (du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]) @ ws[1]))
    return total


def side_curve(patch: Patch, side: Side):
    return MultiPatch([patch], []).topology.directed_side(0, side).curve([patch])


@st.composite
def broken(draw, kinds=("knots", "degree", "scale", "cut", "turn")):
    """A valid model and one with the same geometry whose patches do not conform."""
    mp = draw(strategies.multipatches(rational=False))
    patches = list(mp.patches)
    for _ in range(draw(st.integers(1, 4))):
        k = draw(st.integers(0, len(patches) - 1))
        patch, axis, kind = patches[k], draw(st.integers(0, 1)), draw(st.sampled_from(kinds))
        fraction = draw(st.floats(0.1, 0.9))
        if kind == "knots":
            knot = along(patch, axis, fraction)
            if np.count_nonzero(patch.knots[axis] == knot) < patch.degrees[axis]:
                patches[k] = patch.insert_knots(axis, [knot])
        elif kind == "degree":
            patches[k] = patch.elevate() if max(patch.degrees) < 5 else patch
        elif kind == "scale":
            patches[k] = reparameterized(patch, 8 + draw(st.integers(0, 7)))
        elif kind == "turn":
            patches[k] = turned(patch, *(draw(st.booleans()) for _ in "tuv"))
        else:
            # Cuts that all but meet are one cut within some tolerance; those of a model do not.
            halves = cut(patch, axis, along(patch, axis, round(fraction, 2)))
            patches[k : k + 1] = halves
    return mp, patches


def equal_again(mp: MultiPatch, mended: MultiPatch) -> None:
    """The same domain, certified, its patches glued into one part with as many loops."""
    assert certify(mended).injective
    assert mended.topology.n_components == 1
    assert len(mended.loops) == len(mp.loops)
    assert area(mended) == pytest.approx(area(mp), rel=1e-9)


@quick
@given(broken())
def test_broken_models_conform_again(case):
    mp, patches = case
    loose = MultiPatch(patches)
    outcome = conform(loose)
    assert outcome.left == ()
    assert outcome.moved < SAME
    equal_again(mp, outcome.multipatch)
    # Each patch is still where it was: a patch that was not split at the same parameters, pieces by their sides.
    for k, patch in enumerate(patches):
        pieces = [m for m, origin in zip(outcome.multipatch, outcome.origins, strict=True) if origin == k]
        assert area(pieces) == pytest.approx(area([patch]), rel=1e-9)
        if len(pieces) == 1:
            assert np.abs(samples(pieces[0]) - samples(patch)).max() < SAME
    # Once is enough.
    again = conform(outcome.multipatch)
    assert again.multipatch is outcome.multipatch or again.multipatch.patches == outcome.multipatch.patches
    assert not [note for note in again.notes if "rounding" not in note]


@quick
@given(broken(), st.randoms())
def test_the_order_of_patches_does_not_matter(case, random):
    _, patches = case
    order = list(range(len(patches)))
    random.shuffle(order)
    first, second = (MultiPatch(p).conform() for p in (patches, [patches[k] for k in order]))

    def shapes(mp: MultiPatch) -> list:
        return sorted((*p.shape, *p.degrees, *np.round(np.sort(p.control_points.reshape(-1, 2), 0)[0], 6)) for p in mp)

    assert len(first.interfaces) == len(second.interfaces)
    assert first.topology.n_points == second.topology.n_points
    assert np.allclose(shapes(first), shapes(second), atol=1e-5)


@quick
@given(broken(kinds=("knots", "degree")), st.floats(-9, -4), st.integers(0, 2**32 - 1), st.data())
def test_noise_on_a_side_is_welded_and_measured(case, digits, seed, data):
    mp, patches = case
    assume(len(patches) > 1)
    size = 10.0**digits
    f = data.draw(st.sampled_from(mp.interfaces))
    points = patches[f.patch_a].control_points.copy()
    side = f.side_a.of(points)
    side += size * np.random.default_rng(seed).uniform(-1, 1, side.shape)
    patches[f.patch_a] = patches[f.patch_a].with_control_points(points)
    # Knots may be closer to each other than the noise is large.
    assume(all(certify(MultiPatch([patch], [])).injective for patch in patches))
    loose = MultiPatch(patches)
    # A corner between patches that are not glued to each other may be twice the noise apart.
    outcome = conform(loose, weld=2.1 * size)
    assert outcome.left == ()
    assert outcome.moved <= 2 * size
    assert certify(outcome.multipatch).injective
    assert outcome.multipatch.topology.n_components == 1
    assert not conform(outcome.multipatch).left


@quick
@given(st.integers(0, 1000), st.integers(0, 15), st.floats(0.2, 0.8), st.booleans())
def test_rational_patches_conform_in_homogeneous_coordinates(seed, how, fraction, split):
    """A rational patch cut in two, the halves with other weights and knots."""
    whole = bicubic(seed, 0.03, weights=True)
    assume(certify(MultiPatch([whole])).injective)
    left, right = cut(whole, 0, fraction)
    left = left.insert_knots(1, [0.4])
    if split:
        low, high = cut(left, 1, 0.7)
        parts = [low, high]
    else:
        parts = [left]
    right = reparameterized(Patch(right.knots, right.degrees, right.control_points, 3 * right.weights), how)
    outcome = conform(MultiPatch([*parts, right]))
    assert outcome.left == ()
    assert certify(outcome.multipatch).injective
    assert len(outcome.multipatch) == (4 if split else 2)


def test_a_polynomial_patch_between_rational_ones():
    a, b = quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((1, 0), (2, 0), (2, 1), (1, 1))
    weighted = Patch(b.knots, b.degrees, b.control_points, [[1.0, 1.0], [2.0, 0.5]])
    assert certify(MultiPatch([a, weighted]).conform()).injective
    equal = Patch(b.knots, b.degrees, b.control_points, [[2.0, 2.0], [2.0, 2.0]])
    # A factor of all weights changes nothing, so nothing is to be done.
    assert conform(MultiPatch([a, equal])).notes == ()


def test_other_weights_on_a_side_are_named():
    a, b = quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((1, 0), (2, 0), (2, 1), (1, 1))
    a = Patch(a.knots, a.degrees, a.control_points, [[1, 1], [1, 2]])
    b = Patch(b.knots, b.degrees, b.control_points, [[1, 1], [1, 1]])
    outcome = conform(MultiPatch([a, b]))
    assert any("weights of the two sides differ" in text for text in outcome.left)
    assert any("again from the other's curve" in text for text in certify(outcome.multipatch).reasons)


def test_a_gap_along_a_side_is_no_junction_beside_its_end():
    """A corner 1e-4 before its neighbour's: the sides below end there and run on, but are meant to be one."""
    low, right = quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((1, 0), (2, 0), (2, 2), (1, 2))
    high = quad((0, 1), (1 - 1e-4, 1), (1 - 1e-4, 2), (0, 2))
    mended = MultiPatch([low, high, right]).conform(weld=2e-4)
    assert len(mended) == 4
    assert certify(mended).injective


def test_sides_of_split_patches_keep_their_labels():
    big = quad((0, 0), (1, 0), (1, 2), (0, 2))
    small = [quad((1, 0), (2, 0), (2, 1), (1, 1)), quad((1, 1), (2, 1), (2, 2), (1, 2))]
    labels = {"wall": [(0, Side.WEST), (0, Side.NORTH)], "far": [(1, Side.EAST)]}
    mp = MultiPatch([big, *small], ids=[5, 7, 9], labels=labels)
    mended = mp.conform()
    assert mended.ids == (5, 7, 9, 10)
    assert set(mended.sides["wall"]) == {(0, Side.WEST), (3, Side.WEST), (3, Side.NORTH)}
    assert mended.sides["far"] == ((1, Side.EAST),)
    assert conform(mp).origins == (0, 1, 2, 0)


@quick
@given(broken(), st.data())
def test_labels_stay_on_their_curves(case, data):
    _, patches = case
    k, side = data.draw(st.integers(0, len(patches) - 1)), data.draw(st.sampled_from(list(Side)))
    mended = MultiPatch(patches, labels={"here": [(k, side)]}).conform()
    curve = side_curve(patches[k], side)
    length = 0.0
    for m, s in mended.sides["here"]:
        piece = side_curve(mended[m], s)
        points = piece(np.linspace(*piece.domain, 200))
        assert nearest_on_curve(curve, points)[1].max() < SAME
        length += float(np.hypot(*np.diff(points, axis=0).T).sum())
    whole = curve(np.linspace(*curve.domain, 400))
    assert length == pytest.approx(float(np.hypot(*np.diff(whole, axis=0).T).sum()), rel=1e-3)


def test_staggered_sides_and_long_rows():
    """Bricks: every joint cuts the next row, whose cuts reach the row after it."""
    rows = [
        quad((x + shift, y), (x + shift + 1, y), (x + shift + 1, y + 1), (x + shift, y + 1))
        for y, shift in enumerate((0.0, 0.3, 0.75))
        for x in range(3)
    ]
    outcome = conform(MultiPatch(rows))
    assert certify(outcome.multipatch).injective
    assert outcome.left == ()
    assert area(outcome.multipatch) == pytest.approx(9)


def test_cuts_in_a_spiral_end_with_a_word():
    """A snail, whose narrow end lies on half of its wide end: what cuts one in two comes back at the other."""
    inner = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]], float)
    outer = inner * (1 + np.linspace(1, 2, 5))[:, None]
    snail = Patch(([0, 0, 0.25, 0.5, 0.75, 1, 1], LINE), (1, 1), np.stack([inner, outer], axis=1))
    with pytest.raises(InputError, match=r"spiral.*patch 0"):
        MultiPatch([snail]).conform()


def test_a_pinwheel_is_cut_until_it_conforms():
    """Four rectangles around a square, each T-junction sends a cut to the next one."""
    a = 0.6180339887
    pinwheel = [
        quad((0, 0), (1 + a, 0), (1 + a, 1), (0, 1)),
        quad((1 + a, 0), (2 + a, 0), (2 + a, 1 + 2 * a), (1 + a, 1 + 2 * a)),
        quad((1, 1 + a), (1 + a, 1 + a), (1 + a, 1 + 2 * a), (1, 1 + 2 * a)),
        quad((0, 1), (1, 1), (1, 1 + 2 * a), (0, 1 + 2 * a)),
        quad((1, 1), (1 + a, 1), (1 + a, 1 + a), (1, 1 + a)),
    ]
    mended = MultiPatch(pinwheel).conform()
    assert certify(mended).injective


def test_sides_of_other_speed_are_named_and_left():
    a = quad((0, 0), (1, 0), (1, 1), (0, 1))
    b = Patch((LINE, [0, 0, 0, 1, 1, 1]), (1, 2), [[(1, 0), (1, 0.8), (1, 1)], [(2, 0), (2, 0.5), (2, 1)]])
    outcome = conform(MultiPatch([a, b]), weld=1e-3)
    (text,) = outcome.left
    assert "different speeds" in text
    assert outcome.multipatch.interfaces == ()
    assert any("different speeds" in reason for reason in certify(outcome.multipatch).reasons)


@pytest.mark.parametrize("thickness", [1e-3, 1e-6, 1e-9])
def test_thin_patches_are_left_alone(thickness):
    thin = quad((0, 0), (1, 0), (1, thickness), (0, thickness))
    for weld in (0.0, 1e-4, 1.0):
        mp = MultiPatch([thin, quad((0, thickness), (1, thickness), (1, 1), (0, 1))])
        assert mp.conform(weld=weld) is mp
        outcome = conform(MultiPatch([thin]), weld=weld)
        assert outcome.left == outcome.notes == ()


def test_gaps_above_the_tolerance_stay_open():
    a, b = quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((1.001, 0), (2, 0), (2, 1), (1.001, 1))
    loose = MultiPatch([a, b])
    assert loose.conform(weld=9e-4) is loose
    assert conform(loose, weld=1e-3).moved == pytest.approx(5e-4)
    with pytest.raises(InputError, match="weld"):
        loose.conform(weld=-1.0)
    with pytest.raises(InputError, match="weld"):
        loose.conform(weld=float("nan"))


@pytest.mark.parametrize("name", sorted(models.ALL))
def test_models_that_conform_are_the_same_objects(name):
    mp = models.ALL[name]()
    assert mp.conform() is mp
    assert conform(mp).notes == ()


def test_closed_sides_with_another_seam():
    """Two rings in one, glued along a closed curve whose seams lie in different places."""
    inner = models.annulus(1, 3, 6, None).patches[0]
    points = inner.control_points
    outer = inner.with_control_points(points[:, -1:] * (1 + 0.4 * np.arange(points.shape[1]))[None, :, None])
    halves = cut(outer, 0, 0.5)
    mp = MultiPatch([inner, *halves])
    mended = mp.conform()
    assert certify(mended).injective
    assert len(mended.loops) == 2
    assert len(mended) == 4


def test_interfaces_given_by_hand_are_kept():
    a, b = quad((0, 0), (1, 0), (1, 1), (0, 1)), quad((1, 0), (2, 0), (2, 1), (1, 1))
    mp = MultiPatch([a, b], [Interface(0, Side.EAST, 1, Side.WEST, False)])
    assert mp.conform() is mp


def test_boundary_conditions_follow_split_patches():
    big = quad((0, 0), (1, 0), (1, 2), (0, 2))
    small = [quad((1, 0), (2, 0), (2, 1), (1, 1)), quad((1, 1), (2, 1), (2, 2), (1, 2))]
    text = '<boundaryConditions id="2"><bc type="Dirichlet" function="0">0 1\n1 2</bc></boundaryConditions>'
    mp = MultiPatch([big, *small], blocks=[Block("G+Smo XML", "boundaryConditions", text)])
    outcome = conform(mp)
    (block,) = outcome.multipatch.blocks
    rows = block.text.partition('"0">')[2].partition("</bc>")[0].split()
    assert rows == ["0", "1", "3", "1", "1", "2"]
    assert outcome.left == ()
