"""The core's matching and sliding against plain loops and plain NumPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import targets
from patchtransfer._core import Matching
from patchtransfer.geometry.outline import Outline
from patchtransfer.registration.inner_distances import energy_of, slide, sliding
from patchtransfer.registration.sampled_boundary import WINDOWS, BoundaryShape

#: Steps (source, target) of a matching: ratios of whole numbers up to 6 in lowest terms, with those that the core uses.
STEPS = [(1, 1)] + [
    (a, b) for p, q in ((1, 2), (1, 3), (2, 3), (1, 4), (3, 4), (1, 5), (2, 5), (3, 5), (4, 5), (1, 6), (5, 6))
    for a, b in ((p, q), (q, p))
]  # fmt: skip


def random_problem(seed, n, m, forbidden):
    rng = np.random.default_rng(seed)
    source, target = (np.append(0, np.cumsum(g := rng.uniform(0.2, 1, k)) / g.sum()) for k in (n, m))
    source[-1] = target[-1] = 1.0
    point = rng.uniform(0, 0.1, (n, m)) * (rng.random((n, m)) < 0.3)
    if forbidden:
        i, j = rng.integers(1, n), rng.integers(1, m)
        point[i], point[:, j], point[i, j] = np.inf, np.inf, 0.0
    return source, target, rng.uniform(0, 1, (n, m)), point, rng.uniform(0, 0.1, n), rng.uniform(0, 0.1, m)


def plain_cost(source, target, cost, point, skip_a, skip_b, stretch, band, start):
    """The cheapest path by the textbook: node pair after node pair, in double precision."""
    n, m = cost.shape
    at = np.array([target[(start + j) % m] + (start + j) // m for j in range(m + 1)]) - target[start]
    best = np.full((n + 1, m + 1), np.inf)
    best[0, 0] = point[0, start]
    for i in range(1, n + 1):
        for j in range(1, m + 1):
            if abs(source[i] - at[j]) > band or (i == n) != (j == m):
                continue
            for a, b in STEPS:
                if a > i or b > j:
                    continue
                ds, dt = source[i] - source[i - a], at[j] - at[j - b]
                here, there = cost[i % n, (start + j) % m], cost[i - a, (start + j - b) % m]
                total = best[i - a, j - b] + (here + there) * (ds + dt) / 4
                total += stretch * (dt / ds - 1) ** 2 / (dt / ds) * (ds + dt) / 2
                total += skip_a[i - a + 1 : i].sum() + sum(skip_b[(start + k) % m] for k in range(j - b + 1, j))
                best[i, j] = min(best[i, j], total)
            best[i, j] += point[i, (start + j) % m] if i < n else 0.0
    return best[n, m]


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(4, 14), st.integers(4, 14), st.sampled_from([0.25, 1.0]), st.booleans())
def test_costs_are_those_of_plain_dynamic_programming(seed, n, m, band, forbidden):
    source, target, cost, *rest = problem = (*random_problem(seed, n, m, forbidden), 0.05, band)
    core = Matching(source, target, *rest)
    plain = np.array([plain_cost(*problem, start) for start in range(m)])
    np.testing.assert_allclose(core.scan(cost, list(range(m))), plain, rtol=1e-5)
    for start in range(m):
        found = core.solve(cost, [start])
        assert (found is None) == np.isinf(plain[start])
        if found is not None:
            assert found[0] == pytest.approx(plain[start], rel=1e-12)
            assert found[1][0].tolist() == [0, start]
            assert found[1][-1].tolist() == [n, start + m]
    best = core.solve(cost, list(range(m)))
    assert (np.inf if best is None else best[0]) == pytest.approx(plain.min(), rel=1e-12)


@pytest.fixture(scope="module")
def shapes():
    """A plate with a hole, and its image under a quadratic map."""
    mp = models.plate_with_hole()
    target, _ = targets.deformed(mp, lambda x: x + 0.2 * x * x[:, ::-1], reverse=False)
    images = sorted((Outline(loop) for loop in target.loops), key=lambda outline: -abs(outline.area))
    return BoundaryShape.sample([Outline(loop) for loop in mp.boundary().loops]), BoundaryShape.sample(images)


def plain_turning(outline, s):
    """Turning (n, windows) from points alone."""
    p = outline.point(s)
    out = []
    for w in WINDOWS:
        a, b = p - outline.point(s - w * outline.length), outline.point(s + w * outline.length) - p
        out.append(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)) / np.pi)
    return np.array(out).T


def plain_energy(source, target, x):
    """Distances, turning and stretch of matched nodes, loop k on loop k."""
    found = np.zeros(source.distances.shape)
    where = [target.locate(k, y) for k, y in enumerate(x)]
    pairs = [(target.rows(k).start, i, (i + 1) % len(target.s[k]), f) for k, (i, f) in enumerate(where)]
    low = np.concatenate([first + i for first, i, _, _ in pairs])
    high = np.concatenate([first + j for first, _, j, _ in pairs])
    f = np.concatenate([f for *_, f in pairs])
    rows = target.distances[low] * (1 - f)[:, None] + target.distances[high] * f[:, None]
    found = rows[:, low] * (1 - f) + rows[:, high] * f
    parts = [o.length / source.outlines[0].length for o in source.outlines]
    share = np.concatenate([part * source.shares(k) for k, part in enumerate(parts)])
    wanted, both = source.distances, np.outer(share, share)
    weight = np.where(wanted < 12 * np.sqrt(both), 0, both / (wanted**2 + 0.02))
    weight /= weight.sum()
    scale = (weight * wanted * found).sum() / (weight * found**2).sum()
    energy = (weight * (scale * found - wanted) ** 2).sum()
    for k, y in enumerate(x):
        o, image, part = source.outlines[k], target.outlines[k], parts[k]
        unlike = plain_turning(image, y) - plain_turning(o, source.s[k])
        energy += (part * source.shares(k)[:, None] / len(WINDOWS) * unlike**2).sum()
        step = np.diff(source.positions(k))
        stretch = np.diff(y, append=y[0] + image.length) / (step * image.length) - 1
        energy += (0.03 * part**2 * step * stretch**2).sum()
    return energy


def test_the_energy_of_a_matching_is_that_of_plain_numpy(shapes):
    source, target = shapes
    rng = np.random.default_rng(4)
    x = [
        (source.positions(k)[:-1] + rng.uniform(0, 0.3, len(s)) / len(s)) * target.outlines[k].length
        for k, s in enumerate(source.s)
    ]
    energy, gradient, hessian = sliding(source, target, [0, 1]).model(np.concatenate(x))
    assert energy == pytest.approx(plain_energy(source, target, x), rel=1e-12)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-15)
    anchors = [
        np.column_stack([np.append(s, s[0] + a.length), np.append(y, y[0] + b.length)])
        for s, y, a, b in zip(source.s, x, source.outlines, target.outlines, strict=True)
    ]
    assert energy_of(source, target, [0, 1], anchors) == pytest.approx(energy, rel=1e-12)
    slid, lower = slide(source, target, [0, 1], anchors, [s[:1] for s in source.s])
    assert lower < energy
    assert lower == pytest.approx(plain_energy(source, target, [rows[:-1, 1] for rows in slid]), rel=1e-12)
    assert all(rows[0, 1] == pytest.approx(y[0]) for rows, y in zip(slid, x, strict=True))
    assert all((np.diff(rows[:, 1]) > 0).all() for rows in slid)
    # Held everywhere but at one node, only that one goes downhill.
    keep = [np.delete(source.s[0], 7), source.s[1]]
    one, _ = slide(source, target, [0, 1], anchors, keep)
    assert (one[0][7, 1] - x[0][7]) * gradient[7] < 0
