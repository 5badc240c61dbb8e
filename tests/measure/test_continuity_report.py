"""Continuity report on maps whose smoothness is known by construction."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import patchtransfer as pt
import targets
from patchtransfer import Side, check_continuity, examples
from shapes import bicubic, cut, quad, reparameterized

flips = st.integers(0, 15)


@given(seed=st.integers(0, 10**6), turns=st.tuples(*[st.integers(0, 7)] * 4), at=st.sampled_from([0.25, 0.5]))
def test_a_split_patch_is_c1_whatever_the_handedness(seed, turns, at):
    quarters = [q for half in cut(bicubic(seed), 0, at) for q in cut(half, 1, 0.4)]
    mp = pt.MultiPatch([reparameterized(q, k) for q, k in zip(quarters, turns, strict=True)])
    r = check_continuity(mp)
    assert len(mp.interfaces) == 4
    assert r.c0_gap < 1e-15
    # Every row holds, those at the boundary too.
    assert r.c1_residual_all < 1e-13
    assert r.kink_deg.max < 1e-4
    assert r.as_g1_residual < 1e-13
    for f in r.interfaces:
        assert f.gluing_positive
        # Speeds on unit squares are as the parts that were cut off.
        assert f.speed_ratio == pytest.approx(width(mp, f.interface, "b") / width(mp, f.interface, "a"))


def width(mp: pt.MultiPatch, f: pt.Interface, which: str) -> float:
    """Length of a patch's domain across an interface."""
    side = getattr(f, f"side_{which}")
    return float(np.ptp(mp.patches[getattr(f, f"patch_{which}")].knots[1 - side.axis]))


def test_chord_ratio_is_shared_and_oriented():
    """Two chords of different speed ratios, each over two interfaces whose patches a lie on either side."""
    quarters = [q for half in cut(bicubic(3, 0.0), 0, 0.25) for q in cut(half, 1, 0.6)]
    plain = pt.MultiPatch(quarters)
    expected = {
        frozenset((f.patch_a, f.patch_b)): width(plain, f, "b") / width(plain, f, "a") for f in plain.interfaces
    }
    # Domains are a matter of the file: their lengths change nothing.
    quarters = [
        pt.Patch(((2 + k) * q.knots[0] - k, q.knots[1]), q.degrees, q.control_points) for k, q in enumerate(quarters)
    ]
    for order in ([0, 1, 2, 3], [2, 1, 0, 3]):
        mp = pt.MultiPatch([quarters[k] for k in order])
        assert sorted(len(chord) for chord in mp.topology.chords) == [2, 2]
        r = check_continuity(mp)
        assert r.c1_residual_all < 1e-14
        for f in r.interfaces:
            a, b = order[f.interface.patch_a], order[f.interface.patch_b]
            ratio = expected[frozenset((a, b))]
            assert f.speed_ratio == pytest.approx(ratio if a < b else 1 / ratio)
    # One quarter squeezed towards the chord alone cannot be C1 with a ratio per chord.
    points = quarters[2].control_points.copy()
    points[1, 1:-1] = (points[0, 1:-1] + points[1, 1:-1]) / 2
    squeezed = [q.with_control_points(points) if k == 2 else q for k, q in enumerate(quarters)]
    assert check_continuity(pt.MultiPatch(squeezed)).c1_residual > 1e-3


@given(angle=st.floats(-80, 80), stretch=st.floats(0.3, 3), turns=st.tuples(flips, flips))
def test_known_kink_angle(angle, stretch, turns):
    d = stretch * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    left = quad([-1, 0], [0, 0], [0, 1], [-1, 1])
    right = quad([0, 0], d, [d[0], d[1] + 1], [0, 1])
    r = check_continuity(pt.MultiPatch([reparameterized(left, turns[0]), reparameterized(right, turns[1])]))
    assert r.kink_deg.max == pytest.approx(abs(angle), abs=1e-5)
    assert r.kink_deg.mean == pytest.approx(abs(angle), abs=1e-5)
    # Two affine patches are analysis-suitable G1 in spite of the kink.
    assert r.as_g1_residual < 1e-14
    assert r.interfaces[0].gluing_positive


def test_c1_residual_of_a_known_offset():
    """A row moved by d leaves |d| / 2 / diameter when both sides have equal speed and spans."""
    knots = [0, 0, 0, 1, 1, 1]
    x = np.arange(3) / 2
    left = np.stack(np.meshgrid(x - 1, x, indexing="ij"), axis=2)
    right = np.stack(np.meshgrid(x, x, indexing="ij"), axis=2)
    right[1, 1] += [0, 0.1]
    mp = pt.MultiPatch([pt.Patch((knots, knots), (2, 2), c) for c in (left, right)])
    r = check_continuity(mp, 200)
    ratio = r.interfaces[0].speed_ratio
    assert r.c1_residual == r.c1_residual_all
    assert r.c1_residual == pytest.approx(np.hypot(0.5 - 0.5 * ratio, 0.1) / (1 + ratio) / mp.diameter, rel=1e-12)
    patch, side, t = r.kink_deg.at
    assert (patch, side) == (0, Side.EAST)
    assert t == pytest.approx(0.5, abs=0.01)
    # A quadratic bump: its peak is half of the control point's offset.
    assert r.kink_deg.max == pytest.approx(math.degrees(math.atan2(0.05, 0.5)), abs=1e-3)


def test_c0_gap_is_exact():
    left, right = quad([-1, 0], [0, 0], [0, 1], [-1, 1]), quad([0, 0], [1, 0], [1, 1], [0, 1])
    assert check_continuity(pt.MultiPatch([left, right])).c0_gap == 0.0
    moved = right.with_control_points(right.control_points + 1e-6)
    mp = pt.MultiPatch([left, moved])
    assert check_continuity(mp).c0_gap == pytest.approx(math.sqrt(2) * 1e-6 / mp.diameter, rel=1e-6)


def test_weights_that_differ_open_a_gap():
    knots = [0, 0, 0, 1, 1, 1]
    x = np.arange(3) / 2
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=2)
    bent = np.array([[1, 1, 1.0], [1, 1, 1], [1, 2, 4]])
    a, b = (
        pt.Patch((knots, knots), (2, 2), points - [1, 0]),
        pt.Patch((knots, knots), (2, 2), points, bent[::-1]),
    )
    r = check_continuity(pt.MultiPatch([a, b]))
    t = np.linspace(0, 1, 20)
    curve = a(1.0, 0.3) * 0 + b.grid([0.0], t)[0] - a.grid([1.0], t)[0]
    assert r.c0_gap == pytest.approx(np.hypot(*curve.T).max() / math.sqrt(5), rel=1e-12)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), turns=st.tuples(flips, flips))
def test_rational_split_has_no_kink(seed, turns):
    halves = cut(bicubic(seed, weights=True), 0, 0.5)
    r = check_continuity(pt.MultiPatch([reparameterized(h, k) for h, k in zip(halves, turns, strict=True)]))
    assert r.kink_deg.max < 1e-4
    assert r.c1_residual_all < 1e-13
    assert r.as_g1_residual < 1e-13


def star(valence: int, seed: int) -> list[pt.Patch]:
    """Bilinear patches around one vertex."""
    rng = np.random.default_rng(seed)
    at = np.linspace(0, 2 * np.pi, 2 * valence, endpoint=False) + rng.uniform(-0.2, 0.2, 2 * valence)
    ring = (rng.uniform(0.8, 1.2, 2 * valence) * np.array([np.cos(at), np.sin(at)])).T
    return [quad([0.0, 0.0], ring[2 * k], ring[2 * k + 1], ring[(2 * k + 2) % (2 * valence)]) for k in range(valence)]


@given(
    valence=st.sampled_from([3, 5, 6]),
    seed=st.integers(0, 1000),
    turns=st.lists(flips, min_size=6, max_size=6),
)
def test_bilinear_patches_are_analysis_suitable(valence, seed, turns):
    patches = star(valence, seed)
    mp = pt.MultiPatch([reparameterized(p.elevate(2), k) for p, k in zip(patches, turns, strict=False)])
    r = check_continuity(mp)
    assert r.as_g1_residual < 1e-13
    assert all(f.gluing_positive for f in r.interfaces)
    (vertex,) = r.vertices
    assert vertex.valence == valence
    assert np.hypot(*vertex.position) < 1e-12
    assert vertex.tangent_residual < 1e-12
    assert vertex.twist_residual < 1e-11


def test_a_moved_twist_is_seen_at_the_vertex_and_in_the_gluing():
    patches = [p.elevate(2).insert_knots(0, [0.5]).insert_knots(1, [0.5]) for p in star(5, 1)]
    moved = patches[0].control_points.copy()
    moved[1, 1] += [0.03, -0.02]
    r = check_continuity(pt.MultiPatch([patches[0].with_control_points(moved), *patches[1:]]))
    assert r.as_g1_residual > 1e-4
    assert r.vertices[0].twist_residual > 1e-2
    clean = check_continuity(pt.MultiPatch(patches))
    assert clean.as_g1_residual < 1e-13
    assert clean.vertices[0].twist_residual < 1e-11


def bumped(patches: list[pt.Patch], seed: int, weights: bool = False) -> pt.MultiPatch:
    """Move the inner control points; weights are a function of the plane, so that sides agree."""
    rng = np.random.default_rng(seed)
    out = []
    for p in patches:
        c = p.control_points.copy()
        c[1:-1, 1:-1] += rng.uniform(-0.04, 0.04, c[1:-1, 1:-1].shape)
        w = 1 + 0.4 * c[..., 0] + 0.3 * c[..., 1] ** 2 if weights else None
        out.append(pt.Patch(p.knots, p.degrees, c, w))
    return pt.MultiPatch(out)


def test_c1_rows_that_cannot_hold_are_left_out():
    mp = bumped([p.elevate(2).insert_knots(0, [0.4]).insert_knots(1, [0.4]) for p in star(5, 4)], 1)
    r = check_continuity(mp)
    diameter = np.hypot(*np.ptp(np.concatenate([p.control_points.reshape(-1, 2) for p in mp.patches]), axis=0))
    for f in r.interfaces:
        i = f.interface
        rows = [
            (i.side_a, mp.patches[i.patch_a].control_points),
            (i.side_b, mp.patches[i.patch_b].control_points),
        ]
        steps = [side.of(c, 1) - side.of(c) for side, c in rows]
        steps[1] = steps[1][::-1] if i.reversed else steps[1]
        # Equal degrees and spans on both sides: p / h cancels.
        offset = (f.speed_ratio * steps[0] + steps[1]) / (f.speed_ratio + 1)
        size = np.hypot(*offset.T) / diameter
        if np.hypot(*i.side_a.of(rows[0][1])[0]) > 0.5:
            size = size[::-1]
        assert f.c1_residual == pytest.approx(size[2:-1].max(), rel=1e-9)
        assert f.c1_residual_all == pytest.approx(size.max(), rel=1e-9)
    assert r.c1_residual == max(f.c1_residual for f in r.interfaces) < r.c1_residual_all


def test_rows_that_hold_have_no_residual_in_the_report():
    """The report takes its ratio from the rows themselves, so a C1 result is seen to be one."""
    source = examples.load("star")[0]
    target, landmarks = targets.deformed(source, targets.bend(source, 30))
    result = pt.transfer(source, target, landmarks, "c1")
    assert not result.rows.released
    assert not result.rows.without
    assert result.rows.residual < 1e-13
    assert result.continuity.c1_residual < 1e-13
    # With one row moved the others still say what the ratio is.
    mp, f = result.multipatch, result.multipatch.interfaces[0]
    points = mp.topology.coordinates.copy()
    beside = f.side_a.of(mp.topology.points[f.patch_a], 1)
    points[beside[len(beside) // 2]] += 1e-3 * mp.diameter
    found = check_continuity(mp.with_shared_points(points)).interfaces
    assert found[0].c1_residual > 1e-4
    apart = [g for g in found if f.patch_a not in (g.interface.patch_a, g.interface.patch_b)]
    assert apart
    assert max(g.c1_residual for g in apart) < 1e-13


@pytest.mark.parametrize("weights", [False, True])
def test_first_order_row_agrees_with_finite_differences(weights):
    """g = a D_a + b D_b − c C' of the reported gluing data, differentiated numerically at the vertex."""
    mp = bumped([p.elevate(2) for p in star(3, 2)], 5, weights)
    r = check_continuity(mp)
    values, slopes = [], []
    for f in r.interfaces:
        i = f.interface
        a, b, c = np.array(f.gluing[:2]), np.array(f.gluing[2:4]), np.array(f.gluing[4:])

        def vectors(t, i=i):
            def inward(k, side, along):
                sign = -1 if side.at_end else 1
                u = [1.0 if side.at_end else 0.0]
                if side.axis == 1:
                    return sign * mp.patches[k].grid(u, along, 1, 0)[0]
                return sign * mp.patches[k].grid(along, u, 0, 1)[:, 0]

            edge = mp.patches[i.patch_a]
            end = [1.0 if i.side_a.at_end else 0.0]
            tangent = edge.grid(end, t, 0, 1)[0] if i.side_a.axis == 1 else edge.grid(t, end, 1, 0)[:, 0]
            return (
                inward(i.patch_a, i.side_a, t),
                inward(i.patch_b, i.side_b, 1 - t if i.reversed else t),
                tangent,
            )

        grid = np.linspace(0, 1, 20)
        scale = [np.hypot(*v.T).max() for v in vectors(grid)]
        start = np.hypot(*mp.patches[i.patch_a](*corner(i.side_a, 0.0))) < 1e-9
        t = np.array([0.0, 1e-6]) if start else np.array([1.0, 1 - 1e-6])
        da, db, dc = (v / s for v, s in zip(vectors(t), scale, strict=True))
        line, square = np.stack([1 - t, t]), np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2])
        g = (a @ line)[:, None] * da + (b @ line)[:, None] * db - (c @ square)[:, None] * dc
        values.append(np.hypot(*g[0]))
        slopes.append(np.hypot(*(g[1] - g[0])) / 1e-6)
    assert r.vertices[0].tangent_residual == pytest.approx(max(values), rel=1e-6)
    assert r.vertices[0].twist_residual == pytest.approx(max(slopes), rel=1e-4)
    assert max(slopes) > 1e-3


def corner(side: Side, t: float) -> tuple[float, float]:
    end = 1.0 if side.at_end else 0.0
    return (end, t) if side.axis == 1 else (t, end)


def test_single_patch_and_json():
    r = check_continuity(pt.MultiPatch([quad([0, 0], [1, 0], [1, 1], [0, 1])]))
    assert (r.c0_gap, r.c1_residual, r.kink_deg.max, r.as_g1_residual) == (0, 0, 0, 0)
    data = json.loads(json.dumps(check_continuity(pt.MultiPatch(star(3, 0))).to_dict(), allow_nan=False))
    assert {"c0_gap", "c1_residual", "kink_deg", "as_g1_residual"} <= set(data)
    assert {"mean", "max"} <= set(data["kink_deg"])
    assert len(data["interfaces"]) == 3
    assert data["extraordinary_vertices"][0]["valence"] == 3
