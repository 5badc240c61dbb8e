"""Topology: interfaces, shared points, loops, vertices and chords, by counting and by quadrature."""

import itertools
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
from patchtransfer import Boundary, InputError, Interface, MultiPatch, Patch, Side
from patchtransfer.geometry.areas import enclosed_areas, polygon_area, sides_around
from shapes import turned
from strategies import multipatches, patches

K = [0, 0, 1, 1]
quick = settings(max_examples=30, deadline=None)


def cell(x: float, y: float, width: float = 1.0) -> Patch:
    return Patch((K, K), (1, 1), [[[x, y], [x, y + 1]], [[x + width, y], [x + width, y + 1]]])


def glued(mp: MultiPatch) -> set:
    """Interfaces as unordered pairs of sides, each with the images of its ends."""
    return {frozenset([(f.patch_a, f.side_a), (f.patch_b, f.side_b)]) for f in mp.interfaces}


def brute_force(patches: list[Patch]) -> set:
    """Pairs of sides whose end points and middle coincide."""
    found = set()
    for a, b in itertools.combinations(range(len(patches)), 2):
        for s, t in itertools.product(Side, Side):
            x, y = s.of(patches[a].control_points), t.of(patches[b].control_points)
            if len(x) == len(y) and min(np.abs(x - y).max(), np.abs(x - y[::-1]).max()) < 1e-9:
                found.add(frozenset([(a, s), (b, t)]))
    return found


def area_by_gauss(patch: Patch) -> float:
    (u, wu), (v, wv) = (gauss(k, p) for k, p in zip(patch.knots, patch.degrees, strict=True))
    du, dv = patch.grid(u, v, 1, 0), patch.grid(u, v, 0, 1)
    return float(wu @ (du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]) @ wv)


def gauss(knots, degree):
    x, w = np.polynomial.legendre.leggauss(degree + 1)
    breaks = np.unique(knots)
    half = np.diff(breaks)[:, None] / 2
    return (breaks[:-1, None] + half * (1 + x)).ravel(), (half * w).ravel()


@quick
@given(multipatches())
def test_interfaces_are_found_and_points_shared(mp):
    assert glued(mp) == brute_force(list(mp.patches))
    t = mp.topology
    raw = np.concatenate([p.control_points.reshape(-1, 2) for p in mp.patches])
    numbers = np.concatenate([p.ravel() for p in t.points])
    assert sorted(set(numbers.tolist())) == list(range(t.n_points))
    assert t.n_points == len(np.unique(np.round(raw, 8), axis=0))
    np.testing.assert_allclose(t.coordinates[numbers], raw, atol=1e-12)
    # First appearance numbers them.
    assert np.array_equal(np.unique(numbers, return_index=True)[1], np.sort(np.unique(numbers, return_index=True)[1]))
    assert set(t.interior_points) | set(t.boundary_points) == set(range(t.n_points))
    assert not set(t.interior_points) & set(t.boundary_points)
    again = MultiPatch(mp.patches, mp.interfaces)
    assert all(np.array_equal(a, b) for a, b in zip(again.topology.points, t.points, strict=True))
    # The same interfaces seen from the other side.
    swapped = [Interface(f.patch_b, f.side_b, f.patch_a, f.side_a, f.reversed) for f in mp.interfaces[::-1]]
    assert MultiPatch(mp.patches, swapped).topology.n_points == t.n_points


@quick
@given(multipatches(rational=False))
def test_loops_have_the_domain_on_their_left(mp):
    (loop,) = mp.loops
    curves = mp.boundary().loops[0]
    points = np.concatenate([c(np.linspace(*c.domain, 30)[:-1]) for c in curves])
    total = sum(abs(area_by_gauss(p)) for p in mp.patches)
    assert polygon_area(points) == pytest.approx(total, rel=1e-2)
    for side, c in zip(loop, curves, strict=True):
        # A step to the left from the middle of the side leads into its patch.
        patch, m = mp.patches[side.patch], float(np.mean(c.domain))
        tangent, inward = c(m, 1), side.side.of(patch.control_points, 1).mean(axis=0) - c.control_points.mean(axis=0)
        assert tangent[0] * inward[1] - tangent[1] * inward[0] > 0
    assert Counter((s.patch, s.side) for s in loop) == Counter(mp.boundaries)


@pytest.mark.parametrize("name", models.ALL)
def test_euler_characteristic_and_holes(name):
    mp = models.ALL[name]()
    t = mp.topology
    edges = 4 * len(mp) - len(mp.interfaces)
    assert len(mp.vertices) - edges + len(mp) == 2 - len(mp.loops)
    assert sum(v.valence for v in mp.vertices) == 4 * len(mp)
    assert t.n_components == 1
    outer, *holes = [polygon_area(np.concatenate([c.control_points[:-1] for c in b])) for b in mp.boundary().loops]
    assert outer > 0
    assert all(h < 0 for h in holes)
    # Each shared number stands for one place and each place has one number.
    assert len(np.unique(np.round(t.coordinates, 9), axis=0)) == t.n_points


def test_valences_and_extraordinary_vertices():
    def found(mp):
        return sorted(v.valence for v in mp.vertices if v.extraordinary)

    assert found(models.grid(3, 3)) == []
    assert found(models.o_grid(2, 2)) == [3, 3, 3, 3]
    for valence in (3, 5, 6):
        mp = models.star(valence)
        assert found(mp) == [valence]
        (centre,) = [v for v in mp.vertices if v.interior]
        np.testing.assert_allclose(
            mp.topology.coordinates[centre.point], models.wave(np.array([0.05, -0.03])), atol=1e-12
        )
        assert sorted(k for k, _ in centre.corners) == list(range(valence))
    reentrant = [v for v in models.l_shape().vertices if not v.interior and v.valence == 3]
    assert len(reentrant) == 1


@pytest.mark.parametrize(("columns", "rows", "chords"), [(3, 3, 4), (4, 2, 4), (1, 1, 0), (2, 1, 1)])
def test_chords_of_grids_run_straight_through(columns, rows, chords):
    mp = models.grid(columns, rows, 1, 1)
    assert len(mp.topology.chords) == chords
    assert sorted(i for c in mp.topology.chords for i in c) == list(range(len(mp.interfaces)))
    lengths = sorted(len(c) for c in mp.topology.chords)
    assert lengths == sorted([rows] * (columns - 1) + [columns] * (rows - 1))
    for chord in mp.topology.chords:
        ends = []
        for i in chord:
            f = mp.interfaces[i]
            ends += f.side_a.of(mp.topology.points[f.patch_a])[[0, -1]].tolist()
        # A path: two ends, every other vertex twice.
        assert sorted(Counter(ends).values()) == [1, 1] + [2] * (len(chord) - 1)


def test_chords_stop_at_extraordinary_vertices():
    assert sorted(map(len, models.star(5).topology.chords)) == [1] * 5
    assert sorted(map(len, models.o_grid().topology.chords)) == [1] * 8


@pytest.mark.parametrize("count", [1, 2, 4])
def test_rings_of_few_patches(count):
    """One patch may be glued to itself, two patches twice to each other."""
    mp = models.annulus(count, 3, 4)
    assert len(mp.interfaces) == count
    assert len(mp.loops) == 2
    assert [len(loop) for loop in mp.loops] == [count, count]
    assert all(v.valence == 2 and not v.interior for v in mp.vertices)
    assert len(mp.vertices) == 2 * count


@quick
@given(patches(rational=False))
def test_signed_area_is_the_integral_of_the_jacobian(patch):
    size = np.abs(patch.control_points).max() ** 2 + 1e-9
    patches = [patch, turned(patch, True, False, False), turned(patch, False, True, False)]
    areas = enclosed_areas(patches, sides_around(patches), len(patches))
    assert areas[0] == pytest.approx(area_by_gauss(patch), abs=1e-11 * size)
    assert areas[1:] == pytest.approx([-areas[0]] * 2, abs=1e-11 * size)


@quick
@given(multipatches(rational=False), st.integers(0, 10**6))
def test_orientation_is_kept_and_interfaces_are_bit_equal(mp, seed):
    t = mp.topology
    assert t.orientation.tolist() == [int(np.sign(area_by_gauss(p))) for p in mp.patches]
    points = t.coordinates + 1e-3 * np.random.default_rng(seed).normal(size=t.coordinates.shape)
    moved = mp.with_control_points([points[p] for p in t.points])
    assert moved.interfaces == mp.interfaces
    assert moved.ids == mp.ids
    for f in moved.interfaces:
        a = f.side_a.of(moved.patches[f.patch_a].control_points)
        b = f.side_b.of(moved.patches[f.patch_b].control_points)
        assert np.array_equal(a, b[::-1] if f.reversed else b)
    assert np.array_equal(moved.topology.coordinates, points)
    for a, b in zip(moved.patches, mp.patches, strict=True):
        assert a.degrees == b.degrees
        assert all(np.array_equal(x, y) for x, y in zip(a.knots, b.knots, strict=True))


def test_points_written_with_six_digits_are_still_shared():
    exact = models.plate_with_hole()
    rounded = [p.with_control_points(np.round(p.control_points, 6) + 4e-7 * k) for k, p in enumerate(exact.patches)]
    mp = MultiPatch(rounded)
    assert glued(mp) == glued(exact)
    assert mp.topology.n_points == exact.topology.n_points
    assert np.abs(mp.topology.coordinates - exact.topology.coordinates).max() < 4e-6


def test_bit_equal_copies_keep_their_bits():
    """A mean of three or seven equal numbers may round."""
    for valence in (3, 5, 6, 7):
        mp = models.star(valence)
        for seed in range(20):
            t = mp.topology
            points = np.random.default_rng(seed).uniform(-1, 1, t.coordinates.shape)
            moved = mp.with_control_points([points[p] for p in t.points])
            assert np.array_equal(moved.topology.coordinates, points)


def test_sides_of_arrays():
    a = np.arange(12).reshape(3, 4)
    assert Side.WEST.of(a).tolist() == [0, 1, 2, 3]
    assert Side.EAST.of(a, 1).tolist() == [4, 5, 6, 7]
    assert Side.SOUTH.of(a).tolist() == [0, 4, 8]
    assert Side.NORTH.of(a, 1).tolist() == [2, 6, 10]
    assert [int(s) for s in Side] == [1, 2, 3, 4]


A, B = cell(0, 0), cell(1, 0)
FINE = B.insert_knots(1, [0.5])
QUADRATIC = B.elevate()


@pytest.mark.parametrize(
    ("patches", "interfaces", "message"),
    [
        ([A, cell(1.01, 0)], [Interface(0, Side.EAST, 1, Side.WEST, False)], "patch 0 east - patch 1 west.*0.01 apart"),
        ([A, B], [Interface(0, Side.EAST, 1, Side.WEST, True)], "patch 0 east - patch 1 west.*apart"),
        ([A, B], [Interface(0, Side.NORTH, 1, Side.WEST, False)], "patch 0 north - patch 1 west.*apart"),
        ([A, FINE], [Interface(0, Side.EAST, 1, Side.WEST, False)], "east - patch 1 west.*knots differ: 1 and 2 spans"),
        ([A, QUADRATIC], [Interface(0, Side.EAST, 1, Side.WEST, False)], "patch 0 east - patch 1 west.*degrees"),
        (
            [A.insert_knots(1, [0.4]), FINE],
            [Interface(0, Side.EAST, 1, Side.WEST, False)],
            "patch 0 east - patch 1 west.*knots differ",
        ),
        ([A, B], [Interface(0, Side.EAST, 2, Side.WEST, False)], "patch 2.*there is no patch 2"),
        ([A, B], [Interface(0, Side.EAST, 1, Side.WEST, False)] * 2, "east of patch 0 is in more than one"),
    ],
)  # fmt: skip
def test_wrong_interfaces_are_refused_by_both_sides(patches, interfaces, message):
    with pytest.raises(InputError, match=message):
        MultiPatch(patches, interfaces)


def test_other_bad_models():
    with pytest.raises(InputError, match="at least one patch"):
        MultiPatch([])
    with pytest.raises(InputError, match="distinct ids"):
        MultiPatch([A, B], ids=[3, 3])
    # The second cell folds back over the first one.
    folded = MultiPatch([A, cell(1, 0, -0.8)])
    with pytest.raises(InputError, match=r"not a set of simple loops at .*of patch 1.*of patch 0|open at"):
        _ = folded.loops
    assert MultiPatch([A, cell(5, 0)]).topology.n_components == 2


def test_boundaries_are_closed_or_refused():
    mp = models.plate_with_hole()
    boundary = mp.boundary()
    assert Boundary(boundary.loops) == boundary
    for loop in boundary.loops:
        for c, following in zip(loop, [*loop[1:], loop[0]], strict=True):
            assert np.array_equal(c.end, following.start)
    with pytest.raises(InputError, match=r"boundary loop 0 is open: curve 6 ends .* start of curve 0"):
        Boundary([boundary.loops[0][:-1]])
    for empty in ([], [[]]):
        with pytest.raises(InputError, match="at least one loop"):
            Boundary(empty)
