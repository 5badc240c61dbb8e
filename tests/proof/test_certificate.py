"""The certificate against sampling, constructed folds, overlaps, rigid motions and real models."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import patchtransfer as pt
import real
from patchtransfer.geometry.patch import Patch
from patchtransfer.proof.certificate import check_boundary
from patchtransfer.proof.source_corners import straighten_source
from shapes import SQUARE, identity, mirrored, polygon, quad

BEZIER = {p: [0.0] * (p + 1) + [1.0] * (p + 1) for p in (1, 2, 3)}


def square(p=2, inner=(0.5,), bump=None):
    """Identity of the unit square, control points moved by `bump`."""
    knots = [0.0] * (p + 1) + list(inner) + [1.0] * (p + 1)
    points = identity((knots, knots), (p, p))
    return Patch((knots, knots), (p, p), points if bump is None else points + bump)


def sampled_det(patch, n=60):
    u, v = (np.linspace(k[0], k[-1], n) for k in patch.knots)
    du, dv = patch.grid(u, v, 1, 0), patch.grid(u, v, 0, 1)
    det = du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]
    return det


def moved(mp, angle=0.0, scale=1.0, offset=(0.0, 0.0), mirror=1.0):
    """Similar copy; elementwise, so that equal control points stay equal to the bit."""
    c, s = scale * math.cos(angle), scale * math.sin(angle)

    def move(points):
        x, y = points[..., 0], mirror * points[..., 1]
        return np.stack([c * x - s * y + offset[0], s * x + c * y + offset[1]], -1)

    patches = [Patch(p.knots, p.degrees, move(p.control_points), p.weights) for p in mp.patches]
    return pt.MultiPatch(patches, mp.interfaces)


def strip(outline_of, n, width=1):
    """n biquadratic patches along a band; `outline_of(s, r)` gives points, s in [0, 1], r in [0, 1]."""
    g = np.array([0, 0.5, 1.0])
    rows = np.array([[outline_of(s, r) for r in g] for s in np.linspace(0, 1, 2 * n + 1)])
    return pt.MultiPatch([Patch((BEZIER[2],) * 2, (2, 2), rows[2 * i : 2 * i + 3]) for i in range(n)])


def quarter_annulus(inner=1.0, outer=2.0):
    w = math.sqrt(0.5)
    ring = np.array([[1, 0], [1, 1], [0, 1.0]])
    points = np.stack([inner * ring, outer * ring])
    return Patch((BEZIER[1], BEZIER[2]), (1, 2), points, [[1, w, 1], [1, w, 1]])


def test_identity_is_certified_with_its_bound():
    c = pt.certify(pt.MultiPatch([square()]))
    assert (c.status, c.injective, c.cells, c.reasons, c.subdivisions) == ("certified", True, (), (), 0)
    assert c.lower_bound == pytest.approx(1, abs=1e-12)
    assert c.boundary.simple is True
    assert json.loads(json.dumps(c.to_dict()))["status"] == "certified"


def test_negative_coefficient_of_a_positive_determinant_needs_subdivision():
    # x' = 1 - 3.6 u (1 - u) >= 0.1 has the Bernstein coefficients 1, -0.8, 1.
    x = np.cumsum([0, 1, -0.8, 1]) / 3
    points = np.stack(np.meshgrid(x, [0.0, 1.0], indexing="ij"), -1)
    c = pt.certify(pt.MultiPatch([Patch((BEZIER[3], BEZIER[1]), (3, 1), points)]))
    assert c.status == "certified"
    assert c.subdivisions > 0
    assert 0 < c.lower_bound <= 0.1 / 0.4 + 1e-12
    shallow = pt.certify(pt.MultiPatch([Patch((BEZIER[3], BEZIER[1]), (3, 1), points)]), max_depth=0)
    assert shallow.status == "undecided"
    assert shallow.lower_bound <= 0
    assert "raise max_depth" in shallow.reasons[0]


def test_a_side_that_is_a_point_is_the_reason():
    triangle = pt.certify(pt.MultiPatch([quad((0, 0), (1, 0), (0.5, 1), (0.5, 1))]))
    assert triangle.status == "undecided"
    assert "its north side is a single point, so det J = 0 all along it" in triangle.reasons[0]


def tiny_fold(low):
    """(x(u), y(v)) with x' = low + (u - 1/3)² and y' = 1e-3 + (v - 0.3)²: minimum off dyadic grids."""

    def integral(low, c):
        power = [0.0, low + c * c, -c, 1 / 3]
        return [sum(math.comb(i, k) / math.comb(3, k) * power[k] for k in range(i + 1)) for i in range(4)]

    points = np.stack(np.meshgrid(integral(low, 1 / 3), integral(1e-3, 0.3), indexing="ij"), -1)
    return Patch((BEZIER[3], BEZIER[3]), (3, 3), points)


@pytest.mark.parametrize("low", [1e-8, 1e-6])
def test_folds_below_any_sampling_grid_are_found(low):
    # A fold of width 2 sqrt(low) along u = 1/3: with low = 1e-8, 2e-4 wide; the sampling sees nothing.
    good, bad = tiny_fold(low), tiny_fold(-low)
    assert pt.certify(pt.MultiPatch([good])).status == "certified"
    assert sampled_det(bad, 50).min() > 0
    c = pt.certify(pt.MultiPatch([bad]))
    assert c.status == "folded"
    u, v = c.cells[0].point
    assert abs(u - 1 / 3) < 2 * math.sqrt(low)
    slopes = bad.grid([u], [v], 1, 0)[0, 0], bad.grid([u], [v], 0, 1)[0, 0]
    assert np.linalg.det(np.array(slopes)) < 0


def test_dragged_control_point_by_bisection():
    """Drag an inner control point until det J just changes sign; both sides of the threshold are decided."""

    def patch(t):
        p = square(3, (0.3, 0.7))
        points = p.control_points.copy()
        points[2, 3] += t * np.array([0.83, -0.41])
        return p.with_control_points(points)

    low, high = 0.0, 4.0
    for _ in range(36):
        middle = 0.5 * (low + high)
        status = pt.certify(pt.MultiPatch([patch(middle)])).status
        assert status in ("certified", "folded")
        low, high = (middle, high) if status == "certified" else (low, middle)
    folded = pt.certify(pt.MultiPatch([patch(high)]))
    assert -1e-6 < folded.cells[0].value < 0
    assert folded.cells[0].bounds[0] <= folded.cells[0].point[0] <= folded.cells[0].bounds[1]
    assert 0 < pt.certify(pt.MultiPatch([patch(low)])).lower_bound < 1e-6


def test_swapped_control_points_fold():
    p = square(2, (0.25, 0.5, 0.75))
    points = p.control_points.copy()
    points[[2, 3], 2] = points[[3, 2], 2]
    c = pt.certify(pt.MultiPatch([p.with_control_points(points)]))
    assert c.status == "folded"
    assert not c.injective
    assert "patch 0 folds at (u, v)" in str(c)


def test_patch_mirrored_onto_its_neighbour_is_refused():
    left = quad((0, 0), (1, 0), (1, 1), (0, 1))
    onto = quad((1, 0), (0.2, 0), (0.2, 1), (1, 1))
    c = pt.certify(pt.MultiPatch([left, onto]))
    assert c.status == "folded"
    assert any("same side" in r for r in c.reasons)


def test_left_handed_patches_are_fine():
    left = quad((0, 0), (0, 1), (1, 1), (1, 0))
    right = quad((1, 0), (2, 0), (2, 1), (1, 1))
    assert pt.certify(pt.MultiPatch([left, right])).status == "certified"


def turning(total, drift=0.0):
    def outline(s, r):
        angle, radius = total * s, 1.0 + r + drift * s
        return radius * math.cos(angle), radius * math.sin(angle)

    return outline


def test_annular_strip_that_covers_itself_is_refused():
    assert pt.certify(strip(turning(math.radians(340)), 8)).status == "certified"
    c = pt.certify(strip(turning(math.radians(400), 0.3), 9))
    assert not any(cell.kind == "folded" for cell in c.cells)
    assert c.status == "folded"
    assert c.boundary.simple is False
    assert any("crosses itself" in r for r in c.reasons)


def test_spiral_with_a_gap_is_certified():
    assert pt.certify(strip(turning(math.radians(700), 2.5), 18)).status == "certified"


def test_doubly_wound_ring_is_refused():
    """A closed strip that winds twice: det J > 0, no side left open, both loops cross themselves."""

    def outline(s, r):
        angle = 4 * math.pi * s
        radius = 2 + r + 0.3 * math.cos(angle / 2)
        return radius * math.cos(angle), radius * math.sin(angle)

    mp = strip(outline, 24)
    points = [p.control_points.copy() for p in mp.patches]
    points[-1][-1] = points[0][0]
    ring = pt.MultiPatch([Patch(p.knots, p.degrees, c) for p, c in zip(mp.patches, points, strict=True)])
    assert len(ring.interfaces) == 24
    c = pt.certify(ring)
    assert not any(cell.kind == "folded" for cell in c.cells)
    assert c.status == "folded"


def test_ring_is_certified():
    mp = strip(turning(2 * math.pi), 8)
    points = [p.control_points.copy() for p in mp.patches]
    points[-1][-1] = points[0][0]
    ring = pt.MultiPatch([Patch(p.knots, p.degrees, c) for p, c in zip(mp.patches, points, strict=True)])
    c = pt.certify(ring)
    assert c.status == "certified"
    assert c.boundary.orientation == (1, -1)
    assert c.boundary.around == ((), (0,))


def test_touching_boundaries_stay_undecided():
    # A C of three squares whose free ends share a side that is no interface.
    a = quad((0, 0), (1, 0), (1, 1), (0, 1))
    b = quad((1.0, 0.25), (2, 0.25), (2, 0.75), (1.0, 0.75))
    c = pt.certify(pt.MultiPatch([a, b], interfaces=[]))
    assert c.status == "undecided"
    assert c.boundary.simple is None
    assert any("touch" in r for r in c.reasons)


def test_two_disjoint_components_and_two_overlapping_ones():
    a = quad((0, 0), (1, 0), (1, 1), (0, 1))
    far = quad((2, 0), (3, 0), (3, 1), (2, 1))
    inside = quad((0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8))
    assert pt.certify(pt.MultiPatch([a, far])).status == "certified"
    c = pt.certify(pt.MultiPatch([a, inside]))
    assert c.status == "folded"
    assert "covers itself" in c.reasons[0]


def test_interface_with_a_gap_is_undecided_but_patches_are_reported():
    a = quad((0, 0), (1, 0), (1, 1), (0, 1))
    b = quad((1 + 1e-9, 0), (2, 0), (2, 1), (1, 1))
    c = pt.certify(pt.MultiPatch([a, b]))
    assert c.status == "undecided"
    assert c.lower_bound > 0.9
    assert "1e-09" in c.reasons[0]


def test_reversed_interface_with_rounded_knots_is_conforming():
    inner = (0.1, 0.3, 0.7)
    a = square(2, inner)
    u, v = a.knots
    right = a.control_points + np.array([1.0, 0.0])
    right[0] = a.control_points[-1]
    b = Patch((u, v), (2, 2), right)
    flipped = Patch((u, (v[0] + v[-1]) - v[::-1]), (2, 2), right[:, ::-1])
    for other in (b, flipped):
        mp = pt.MultiPatch([a, other])
        assert len(mp.interfaces) == 1
        assert pt.certify(mp).status == "certified"


def test_nurbs_quarter_annulus():
    c = pt.certify(pt.MultiPatch([quarter_annulus()]))
    assert c.status == "certified"
    # det J = w(t) r with r from 1 to 2.
    det = sampled_det(quarter_annulus())
    assert c.lower_bound <= abs(det).min() / abs(det).mean() + 0.05
    assert c.lower_bound > 0.1
    turned = quarter_annulus(inner=-0.5)
    assert pt.certify(pt.MultiPatch([turned])).status == "folded"


def test_smooth_corners_of_a_disc_patch_are_degenerate():
    """One biquadratic patch on a disc-like domain: the boundary is smooth at the corners, det J = 0 there."""
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    points = np.zeros((3, 3, 2))
    points[0, 0], points[2, 0], points[2, 2], points[0, 2] = corner
    points[1, 0], points[2, 1], points[1, 2], points[0, 1] = [0, -2], [2, 0], [0, 2], [-2, 0]
    mp = pt.MultiPatch([Patch((BEZIER[2],) * 2, (2, 2), points)])
    c = pt.certify(mp)
    assert c.status == "degenerate"
    assert c.injective
    assert sorted(cell.point for cell in c.cells) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    for angle, scale, offset in ((0.3, 1, 0), (1.1, 1e-6, 0), (0.7, 1e6, 0), (2.0, 1, 1e3)):
        similar = moved(mp, angle, scale, (offset, -offset))
        c = pt.certify(similar)
        # Rounding takes corners to either side of straight.
        assert c.status in ("degenerate", "undecided")
        assert len(c.cells) == 4
        assert all(cell.kind == "degenerate" or (cell.within_rounding and cell.value < 0) for cell in c.cells)
        mended, notes = straighten_source(similar, c)
        assert pt.certify(mended).status == "degenerate"
        assert bool(notes) == (c.status == "undecided")


def test_max_depth_and_degree_are_checked():
    with pytest.raises(pt.InputError, match="max_depth"):
        pt.certify(pt.MultiPatch([square()]), max_depth=-1)
    p = 20
    knots = [0.0] * (p + 1) + [1.0] * (p + 1)
    g = np.linspace(0, 1, p + 1)
    points = np.stack(np.meshgrid(g, [0.0, 1.0], indexing="ij"), -1)
    with pytest.raises(pt.InputError, match="patch 0: degrees"):
        pt.certify(pt.MultiPatch([Patch((knots, BEZIER[1]), (p, 1), points)]))


@st.composite
def perturbed(draw):
    p = draw(st.integers(1, 3))
    inner = sorted(draw(st.sets(st.sampled_from([0.2, 0.35, 0.5, 0.8]), max_size=2)))
    base = square(p, inner)
    amount = draw(st.sampled_from([0.05, 0.15, 0.3]))
    seed = draw(st.integers(0, 2**32 - 1))
    bump = amount * np.random.default_rng(seed).uniform(-1, 1, base.control_points.shape)
    weights = None
    if draw(st.booleans()):
        weights = np.random.default_rng(seed).uniform(0.5, 2, base.shape)
    return Patch(base.knots, base.degrees, base.control_points + bump, weights)


@settings(max_examples=150, deadline=None)
@given(perturbed())
def test_status_never_contradicts_samples(patch):
    mp = pt.MultiPatch([patch])
    c = pt.certify(mp)
    det = sampled_det(patch) * mp.topology.orientation[0]
    if c.injective:
        assert det.min() > 0
        assert det.min() >= c.lower_bound * det.mean() * 0.9
    if det.min() < -1e-9 * abs(det).max() and det.max() > 1e-9 * abs(det).max():
        assert c.status == "folded"
    for cell in c.cells:
        if cell.kind == "folded" and cell.value < -1e-4:
            # At a knot the value is the limit from inside the cell.
            u0, u1, v0, v1 = cell.bounds
            u, v = (x + 1e-7 * ((a + b) / 2 - x) for x, a, b in zip(cell.point, (u0, v0), (u1, v1), strict=True))
            slopes = patch.grid([u], [v], 1, 0)[0, 0], patch.grid([u], [v], 0, 1)[0, 0]
            # The proof takes the orientation from the area, the topology from the control polygon.
            assert np.linalg.det(np.array(slopes)) * det.mean() * mp.topology.orientation[0] < 0


@settings(max_examples=60, deadline=None)
@given(
    perturbed(),
    st.floats(0, 6.3),
    st.sampled_from([1e-6, 1.0, 1e6]),
    st.sampled_from([0.0, 1e3]),
    st.sampled_from([1.0, -1.0]),
)
def test_status_is_invariant(patch, angle, scale, offset, mirror):
    mp = pt.MultiPatch([patch])
    similar = moved(mp, angle, scale, (offset * scale, -offset * scale), mirror)
    assert pt.certify(similar).status == pt.certify(mp).status
    assert pt.certify(pt.MultiPatch([mirrored(patch)])).status == pt.certify(mp).status


@real.needed
def test_real_models():
    for name in ("yeti", "disc", "turtle"):
        mp = real.model(name)
        welded = mp.with_control_points([mp.topology.coordinates[i] for i in mp.topology.points])
        c = pt.certify(welded)
        assert c.status == "certified", str(c)
        assert c.boundary.simple


def test_boundary_report_of_wrong_sense():
    lines = polygon(SQUARE)
    assert check_boundary([lines]).simple is True
    backwards = check_boundary([[line.reversed() for line in lines[::-1]]])
    assert backwards.simple is False
    assert backwards.orientation == (-1,)
