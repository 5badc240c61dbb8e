"""Quality against SciPy's splines and finite differences, and its invariances."""

import itertools
import json
import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline, NdBSpline

import models
import patchtransfer as pt
from patchtransfer import _core
from patchtransfer.geometry.basis import span_basis
from patchtransfer.measure.quality import quality, sample
from shapes import identity, mirrored

KNOTS = [0, 0, 0, 0.3, 1, 1, 1]
C0_KNOTS = [0, 0, 0, 0.5, 0.5, 1, 1, 1]


def wobbly(seed: int, knots=(KNOTS, C0_KNOTS), size: float = 0.12, weights: bool = False) -> pt.Patch:
    """A unit square of degree 2, its control points moved at random."""
    rng = np.random.default_rng(seed)
    points = identity(knots, (2, 2))
    points = points + size * rng.uniform(-1, 1, points.shape)
    return pt.Patch(knots, (2, 2), points, rng.uniform(0.5, 2, points.shape[:2]) if weights else None)


def by_hand(patch: pt.Patch, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Second route: general linear algebra on `Patch.grid`, spans entered by a hair."""

    def parameters(knots):
        breaks = np.unique(knots)
        return np.concatenate(
            [np.clip(np.linspace(a, b, samples), a + 1e-9, b - 1e-9) for a, b in itertools.pairwise(breaks)]
        )

    u, v = (parameters(k) for k in patch.knots)
    jacobian = np.stack([patch.grid(u, v, 1, 0), patch.grid(u, v, 0, 1)], axis=-1)
    lengths = np.linalg.norm(jacobian, axis=-2)
    scaled = np.linalg.det(jacobian) / lengths.prod(axis=-1)
    return scaled, np.linalg.cond(jacobian, "fro")


@pytest.mark.parametrize("weights", [False, True])
@pytest.mark.parametrize("left_handed", [False, True])
def test_agrees_with_linear_algebra_on_the_grid(weights, left_handed):
    patches = [wobbly(k, weights=weights) for k in range(3)]
    if left_handed:
        patches[1] = mirrored(patches[1])
    mp = pt.MultiPatch(patches, interfaces=[])
    q = quality(mp, 6)
    routes = [by_hand(p, 6) for p in patches]
    sign = [-1 if left_handed and k == 1 else 1 for k in range(3)]
    scaled = np.concatenate([s.ravel() * o for (s, _), o in zip(routes, sign, strict=True)])
    kappa = np.concatenate([c.ravel() for _, c in routes])
    assert q.nonpositive == 0
    assert [q.scaled_jacobian.min, q.scaled_jacobian.mean, q.scaled_jacobian.max] == pytest.approx(
        [scaled.min(), scaled.mean(), scaled.max()], abs=1e-6
    )
    assert [q.condition_number.min, q.condition_number.mean, q.condition_number.max] == pytest.approx(
        [kappa.min(), kappa.mean(), kappa.max()], rel=1e-5
    )
    k, u, v = q.worst
    here = by_hand_at(patches[k], u, v)
    assert min(abs(sign[k] * s - q.scaled_jacobian.min) for s in here) < 1e-4


def by_hand_at(patch: pt.Patch, u: float, v: float) -> list[float]:
    """Scaled Jacobian at (u, v) from all sides, by finite differences."""
    h, out = 1e-7, []
    for a in (u - 3 * h, u + 3 * h):
        for b in (v - 3 * h, v + 3 * h):
            if 2 * h < a < 1 - 2 * h and 2 * h < b < 1 - 2 * h:
                x = (patch(a + h, b) - patch(a - h, b)) / (2 * h)
                y = (patch(a, b + h) - patch(a, b - h)) / (2 * h)
                out.append((x[0] * y[1] - x[1] * y[0]) / (np.hypot(*x) * np.hypot(*y)))
    return out


def test_span_basis_is_one_sided_and_matches_scipy():
    t, basis = span_basis(C0_KNOTS, 2, 4)
    assert t.tolist() == pytest.approx([0, 1 / 6, 1 / 3, 0.5, 0.5, 2 / 3, 5 / 6, 1])
    reference = BSpline(C0_KNOTS, np.eye(5), 2)
    inside = np.array([0, 1 / 6, 1 / 3, 0.5 - 1e-12, 0.5 + 1e-12, 2 / 3, 5 / 6, 1 - 1e-12])
    for order, values in enumerate(basis):
        np.testing.assert_allclose(values, reference(inside, nu=order), atol=1e-9)
    assert abs(basis[1][3] - basis[1][4]).max() > 1


def test_sample_gives_points_of_the_patches():
    patches = [wobbly(1), wobbly(2, weights=True)]
    for patch, (points, scaled) in zip(patches, sample(pt.MultiPatch(patches, []), 3), strict=True):
        assert points.shape == (6, 6, 2)
        assert scaled.shape == (6, 6)
        u, v = (span_basis(k, 2, 3)[0] for k in patch.knots)
        np.testing.assert_allclose(points, patch.grid(u, v), atol=1e-14)
    spline = NdBSpline(patches[0].knots, patches[0].control_points, (2, 2))
    points, _ = sample(pt.MultiPatch(patches[:1], []), 3)[0]
    np.testing.assert_allclose(points[1, 1], spline([0.15, 0.25]).ravel(), atol=1e-14)


@given(seed=st.integers(0, 10**6), size=st.floats(0, 0.5))
def test_condition_number_bounds(seed, size):
    q = quality(pt.MultiPatch([wobbly(seed, size=size)], []), 4)
    assert q.condition_number.min >= 2 - 1e-12
    assert -1 <= q.scaled_jacobian.min <= q.scaled_jacobian.mean <= q.scaled_jacobian.max <= 1
    if q.nonpositive:
        assert q.condition_number.max == math.inf
        assert q.scaled_jacobian.min <= 0
    else:
        assert q.condition_number.max >= 2 / q.scaled_jacobian.min * (1 - 1e-12)


@given(
    seed=st.integers(0, 10**6),
    angle=st.floats(0, 7),
    scale=st.sampled_from([1e-150, 1e-3, 7.0, 1e150]),
    swap=st.booleans(),
)
def test_invariant_under_similarities_and_handedness(seed, angle, scale, swap):
    patch = wobbly(seed)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = patch.with_control_points(scale * (patch.control_points @ turn.T + [3.0, -2.0]))
    a = quality(pt.MultiPatch([patch], []), 4)
    b = quality(pt.MultiPatch([mirrored(moved) if swap else moved], []), 4)
    assert b.nonpositive == a.nonpositive
    for x, y in ((a.scaled_jacobian, b.scaled_jacobian), (a.condition_number, b.condition_number)):
        assert [y.min, y.mean, y.max] == pytest.approx([x.min, x.mean, x.max], rel=1e-6, abs=1e-9)


def test_known_values():
    shear = pt.Patch(([0, 0, 1, 1],) * 2, (1, 1), [[[0, 0], [1, 1]], [[1, 0], [2, 1]]])
    q = quality(pt.MultiPatch([shear]))
    assert q.scaled_jacobian.min == pytest.approx(math.sqrt(0.5), rel=1e-15)
    assert q.scaled_jacobian.min <= q.scaled_jacobian.mean <= q.scaled_jacobian.max
    assert q.condition_number.mean == pytest.approx(3)
    assert q.n_samples == 100


def test_degenerate_corner_can_be_excluded_and_json_knows_no_infinity():
    # det J vanishes at u = v = 1, where the two sides are tangent.
    patch = pt.Patch(([0, 0, 1, 1],) * 2, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [0.5, 0.5]]])
    mp = pt.MultiPatch([patch])
    q = quality(mp)
    assert q.worst == (0, 1.0, 1.0)
    assert q.nonpositive == 1
    assert q.condition_number.max == math.inf
    assert math.isfinite(q.condition_number.mean)
    data = json.loads(json.dumps(q.to_dict(), allow_nan=False))
    assert data["condition_number"]["max"] is None
    without = quality(mp, exclude=[(0, 3)])
    assert without.n_samples == q.n_samples - 1
    assert without.scaled_jacobian.min > 0
    assert math.isfinite(without.condition_number.max)
    assert without.worst != q.worst


def test_collapsed_side_counts_as_degenerate():
    patch = pt.Patch(([0, 0, 1, 1],) * 2, (1, 1), [[[0, 0], [0, 0]], [[1, 0], [1, 1]]])
    q = quality(pt.MultiPatch([patch], []), 5)
    assert q.nonpositive == 5
    assert q.scaled_jacobian.min == 0


def test_refuses_nonsense():
    mp = pt.MultiPatch([wobbly(0)], [])
    with pytest.raises(pt.InputError, match="at least 2"):
        quality(mp, 1)
    with pytest.raises(pt.InputError, match="corner 4 of patch 0"):
        quality(mp, exclude=[(0, 4)])
    with pytest.raises(pt.InputError, match="at least 3"):
        quality(mp, 2, exclude=[(0, 0)])


@settings(max_examples=5)
@given(order=st.permutations(range(6)))
def test_grouping_does_not_matter(order):
    """Patches of different knots, degrees and weights are measured alike in any order."""
    patches = [wobbly(k, knots=(KNOTS, KNOTS) if k % 2 else (KNOTS, C0_KNOTS), weights=k > 3) for k in range(6)]
    a, b = quality(pt.MultiPatch(patches, [])), quality(pt.MultiPatch([patches[k] for k in order], []))
    assert a.scaled_jacobian.min == b.scaled_jacobian.min
    assert a.condition_number.mean == pytest.approx(b.condition_number.mean, rel=1e-12)
    assert order[b.worst[0]] == a.worst[0]


def test_many_patches_are_measured_at_once():
    mp = pt.MultiPatch([wobbly(k) for k in range(21)], [])
    quality(mp)
    best = math.inf
    for _ in range(20):
        start = time.perf_counter()
        quality(mp)
        best = min(best, time.perf_counter() - start)
    assert best < 3e-3


@pytest.mark.parametrize("signs", [[], [1.0], [1.0] * 3])
def test_the_core_wants_one_sign_a_patch(signs):
    """Alike in every function that takes them."""
    mp = models.grid(2, 1, 2, 2)
    patches = [patch.to_core() for patch in mp.patches]
    message = f"{len(signs)} signs for 2 patches"
    with pytest.raises(ValueError, match=message):
        _core.certify_patches(patches, signs, 4)
    with pytest.raises(ValueError, match=message):
        _core.measure_quality(patches, signs, 4, [[], []])
    with pytest.raises(ValueError, match="1 lists of excluded corners for 2 patches"):
        _core.measure_quality(patches, [1.0, 1.0], 4, [[]])
