from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import eye_array

from patchtransfer import InputError, _core
from patchtransfer.mesh.background_mesh import TriangleMesh, target_mesh
from patchtransfer.mesh.harmonic import mesh_harmonic_map
from patchtransfer.paper.reversible_harmonic import _Descent, barycentric_map, reverse_boundary, reversible_harmonic_map
from shapes import SQUARE

HOLE = 0.5 + 0.2 * np.array([[1, 0], [0, -1], [-1, 0], [0, 1]])


def image(p):
    """A bent, moved and enlarged domain."""
    x, y = p.T
    return np.stack([3 * x + 0.6 * y**2 + 5, 2 * y + 0.5 * np.sin(2 * x) - 1], axis=1)


@pytest.fixture(scope="module")
def pair():
    """Mesh a with a hole, mesh b of the images of its boundary, and first maps both ways."""
    a = target_mesh([SQUARE, HOLE], max_area=0.01)
    b = target_mesh([image(a.points[loop]) for loop in a.loops], max_area=0.06)
    values = image(a.points[a.boundary])
    return a, b, values, mesh_harmonic_map(a, a.boundary, values), reverse_boundary(a, b)


def by_active_sets(query, corners):
    """Least distance to a triangle: the feasible foot on the spans of all its faces."""
    best = np.inf
    for size in (1, 2, 3):
        for chosen in combinations(range(3), size):
            p = corners[list(chosen)]
            edges = (p[1:] - p[0]).T
            t = np.linalg.lstsq(edges, query - p[0], rcond=None)[0] if size > 1 else np.zeros(0)
            if (t >= 0).all() and t.sum() <= 1:
                best = min(best, float(np.linalg.norm(query - p[0] - edges @ t)))
    return best


@settings(max_examples=30, deadline=None)
@given(arrays(float, (6, 4), elements=st.floats(-2, 2)), st.integers(0, 10**6))
def test_closest_points_equal_numpy(queries, seed):
    rng = np.random.default_rng(seed)
    vertices, triangles = rng.normal(size=(20, 4)), rng.integers(0, 20, (30, 3))
    p = barycentric_map(queries, vertices, triangles)
    assert p.shape == (6, 20)
    assert (p.data >= 0).all()
    np.testing.assert_allclose(p.sum(axis=1), 1)
    found = np.linalg.norm(queries - p @ vertices, axis=1)
    expected = [min(by_active_sets(q, vertices[t]) for t in triangles) for q in queries]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_closest_points_do_not_depend_on_threads(pair):
    a, b, _, start, reverse = pair
    there, here = np.hstack([reverse, b.points]), np.hstack([a.points, start])
    try:
        results = []
        for n in (1, 2, 3):
            _core.set_threads(n)
            results.append(_core.closest_on_mesh(here, there, b.triangles))
    finally:
        _core.set_threads(0)
    for other in results[1:]:
        for x, y in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(x, y)


def test_closest_points_refuse_bad_meshes():
    with pytest.raises(ValueError, match="finite points"):
        _core.closest_on_mesh(np.full((1, 4), np.nan), np.zeros((3, 4)), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="triangles"):
        _core.closest_on_mesh(np.zeros((1, 4)), np.zeros((3, 4)), np.array([[0, 1, 3]]))


def test_reverse_boundary_follows_the_edges(pair):
    a, b, _, _, reverse = pair
    corners = sum(len(loop) for loop in a.loops)
    np.testing.assert_allclose(reverse[:corners], a.points[np.concatenate(a.loops)], atol=1e-14)
    # Steiner points on the outline come back to the outline, in their order.
    for loop, outline in zip(b.loops, a.loops, strict=True):
        back, polygon = reverse[loop], a.points[outline]
        length = np.linalg.norm(polygon - np.roll(polygon, 1, axis=0), axis=1).sum()
        np.testing.assert_allclose(np.linalg.norm(back - np.roll(back, 1, axis=0), axis=1).sum(), length)


def test_every_block_lowers_the_energy(pair):
    a, b, values, start, reverse = pair
    found = reversible_harmonic_map(a, b, a.boundary, values, start, reverse, max_iterations=120)
    for step in found.steps:
        assert step.after_solve <= step.before * (1 + 1e-12)
        assert step.after_closest <= step.after_solve * (1 + 1e-12)
    assert found.steps[0].after_closest < found.steps[0].before
    assert [step.beta for step in found.steps][:3] == [0.005, 0.01, 0.015]
    assert found.steps[-1].beta == 0.5
    assert found.converged
    # Close to the true map, whose boundary it nearly meets.
    size = np.sqrt(b.areas().sum())
    assert np.abs(found.points - image(a.points)).max() < 0.03 * size
    assert np.abs(found.points[a.boundary] - values).max() < 0.02 * size
    # Both maps are each other's inverse within the size of a triangle.
    assert np.abs(found.reverse_matrix @ found.points - b.points).max() < 0.03 * size


def dirichlet(mesh, x):
    corners = mesh.points[mesh.triangles]
    edges, images = ([c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]] for c in (corners, x[mesh.triangles]))
    jacobian = np.stack(images, axis=2) @ np.linalg.inv(np.stack(edges, axis=2))
    return 0.5 * mesh.areas() @ (jacobian**2).sum(axis=(1, 2))


def test_the_energy_is_that_of_the_paper(pair):
    a, b, values, start, reverse = pair
    found = reversible_harmonic_map(a, b, a.boundary, values, start, reverse, max_iterations=3, weight=2.0)
    area_a, area_b = a.areas().sum(), b.areas().sum()
    mass_a, mass_b = (np.bincount(m.triangles.ravel(), np.repeat(m.areas() / 3, 3)) for m in (a, b))

    def square(mass, difference, area):
        return mass @ (difference**2).sum(axis=1) / mass.sum() / area

    p_ab, p_ba, beta = found.forward_matrix.toarray(), found.reverse_matrix.toarray(), 0.015
    terms = [
        5e-4 * (dirichlet(a, found.points) / area_b + dirichlet(b, found.reverse) / area_a),
        (1 - 5e-4) * square(mass_b, p_ba @ found.points - b.points, area_b),
        (1 - 5e-4) * square(mass_a, p_ab @ found.reverse - a.points, area_a),
        beta * square(mass_a, found.points - p_ab @ b.points, area_b),
        beta * square(mass_b, found.reverse - p_ba @ a.points, area_a),
        2.0 * ((found.points[a.boundary] - values) ** 2).sum(axis=1).mean() / area_b,
    ]
    np.testing.assert_allclose(found.steps[-1].after_closest, sum(terms), rtol=1e-10)


def test_the_solve_is_a_minimum(pair):
    a, b, values, start, reverse = pair
    descent = _Descent(a, b, a.boundary, values, start, reverse, None)
    descent.alpha, descent.beta, descent.weight = 0.01, 0.1, 1.0
    descent.solve()
    least, rng = descent.energy(), np.random.default_rng(1)
    for name in ("x_ab", "x_ba"):
        x = getattr(descent, name)
        for _ in range(5):
            direction = rng.normal(size=x.shape)
            slopes = []
            for h in (1e-4, -1e-4):
                setattr(descent, name, x + h * direction)
                slopes.append(descent.energy() - least)
            assert min(slopes) > 0
            # Symmetric about the minimum: no first-order part.
            np.testing.assert_allclose(slopes[0], slopes[1], rtol=1e-6)
        setattr(descent, name, x)


def test_hard_boundary_limit_is_the_dirichlet_solve(pair):
    a, b, values, start, reverse = pair
    away = start + 0.05 * np.random.default_rng(0).normal(size=start.shape)
    # With alpha = 1 nothing would hold the reverse map, which is free up to a shift then.
    alpha = 1.0 - 1e-10
    found = reversible_harmonic_map(
        a, b, a.boundary, values, away, reverse, alpha=alpha, beta=0.0, weight=1e7, max_iterations=3
    )
    assert found.converged
    np.testing.assert_allclose(found.points, start, atol=1e-5)
    # The same without the boundary among the unknowns, whatever its weight.
    away[a.boundary] = values
    basis = eye_array(len(start), format="csc")[:, a.interior]
    found = reversible_harmonic_map(
        a, b, a.boundary, values, away, reverse, null_space=basis, alpha=alpha, beta=0.0, max_iterations=2
    )
    np.testing.assert_allclose(found.points, start, atol=1e-8)


def test_constraints_are_kept(pair):
    a, b, values, start, reverse = pair
    # Pairs of interior vertices move together.
    first, second = a.interior[:10:2], a.interior[1:10:2]
    basis = eye_array(len(start), format="lil")
    basis[second, first] = 1
    keep = np.setdiff1d(np.arange(len(start)), second)
    found = reversible_harmonic_map(
        a, b, a.boundary, values, start, reverse, null_space=basis.tocsc()[:, keep], max_iterations=20
    )
    np.testing.assert_allclose(found.points[second] - found.points[first], start[second] - start[first], atol=1e-12)
    assert np.abs(found.points - start).max() > 1e-3
    steps = found.steps
    assert all(s.after_closest <= s.after_solve * (1 + 1e-12) <= s.before * (1 + 2e-12) for s in steps)


def test_bad_input(pair):
    a, b, values, start, reverse = pair
    for bad in ({"alpha": 1.5}, {"beta": -1.0}, {"weight": -1.0}, {"max_iterations": -1}, {"tolerance": -1.0}):
        with pytest.raises(InputError, match="reversible map"):
            reversible_harmonic_map(a, b, a.boundary, values, start, reverse, **bad)
    with pytest.raises(InputError, match="boundary values"):
        reversible_harmonic_map(a, b, a.boundary, values[1:], start, reverse)
    with pytest.raises(InputError, match="reverse start"):
        reversible_harmonic_map(a, b, a.boundary, values, start, reverse * np.nan)
    with pytest.raises(InputError, match="null space"):
        reversible_harmonic_map(a, b, a.boundary, values, start, reverse, null_space=np.eye(3))
    with pytest.raises(InputError, match="singular"):
        reversible_harmonic_map(a, b, a.boundary, values, start, reverse, null_space=np.zeros((len(start), 1)))
    with pytest.raises(InputError, match="loops"):
        reverse_boundary(a, TriangleMesh(b.points, b.triangles, (b.loops[0][::2], b.loops[1])))
