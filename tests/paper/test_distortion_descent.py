import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.sparse import csc_array

from patchtransfer import InputError
from patchtransfer.mesh.background_mesh import TriangleMesh, target_mesh
from patchtransfer.mesh.harmonic import mesh_harmonic_map
from patchtransfer.paper.distortion_descent import minimise_distortion
from shapes import SQUARE


def image(p):
    x, y = p.T
    return np.stack([2 * x + 0.4 * y**2, y + 0.2 * np.sin(3 * x)], axis=1)


@pytest.fixture(scope="module")
def mesh():
    return target_mesh([SQUARE], max_area=0.02)


@pytest.fixture(scope="module")
def start(mesh):
    return mesh_harmonic_map(mesh, mesh.boundary, image(mesh.points[mesh.boundary]))


def jacobians(mesh, u):
    corners, images = mesh.points[mesh.triangles], u[mesh.triangles]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    moved = np.stack([images[:, 1] - images[:, 0], images[:, 2] - images[:, 0]], axis=2)
    return moved @ np.linalg.inv(edges)


def distortion(mesh, u):
    """By NumPy's singular values."""
    first, second = np.linalg.svd(jacobians(mesh, u), compute_uv=False).T
    return float(mesh.areas() @ (first / second + second / first) / mesh.areas().sum())


def test_energy_is_the_conformal_distortion_and_falls(mesh, start):
    result = minimise_distortion(mesh, start, mesh.boundary, tolerance=1e-12)
    assert result.stop == "converged"
    np.testing.assert_allclose(result.energy[0], distortion(mesh, start))
    np.testing.assert_allclose(result.energy[-1], distortion(mesh, result.points))
    assert len(result.energy) > 2
    assert (np.diff(result.energy) < 0).all()
    assert result.energy[-1] < 0.999 * result.energy[0]
    np.testing.assert_array_equal(result.points[mesh.boundary], start[mesh.boundary])
    assert (TriangleMesh(result.points, mesh.triangles, ()).areas() > 0).all()


def test_minimum_equals_scipy(mesh, start):
    free = mesh.interior

    def energy(x):
        u = start.copy()
        u[free] = x.reshape(-1, 2)
        j = jacobians(mesh, u)
        det = np.linalg.det(j)
        return mesh.areas() @ ((j**2).sum(axis=(1, 2)) / det) / mesh.areas().sum() if (det > 0).all() else 1e6

    found = minimize(energy, start[free].ravel(), method="BFGS", options={"gtol": 1e-7})
    result = minimise_distortion(mesh, start, mesh.boundary, tolerance=1e-14)
    np.testing.assert_allclose(result.energy[-1], found.fun, rtol=1e-7)
    np.testing.assert_allclose(result.points[free].ravel(), found.x, atol=2e-4)


def test_never_flips_on_the_way(mesh, start):
    # Steps from a map with slivers that a full Newton step would turn over.
    rng, u = np.random.default_rng(4), start.copy()
    while True:
        moved = u.copy()
        v = rng.choice(mesh.interior)
        moved[v] += rng.normal(size=2) * 0.1
        if TriangleMesh(moved, mesh.triangles, ()).areas().min() > 0:
            u = moved
        if distortion(mesh, u) > 6:
            break
    for steps in range(8):
        result = minimise_distortion(mesh, u, mesh.boundary, max_steps=steps)
        assert (TriangleMesh(result.points, mesh.triangles, ()).areas() > 0).all()
        assert len(result.energy) == steps + 1
    result = minimise_distortion(mesh, u, mesh.boundary, tolerance=1e-12)
    best = minimise_distortion(mesh, start, mesh.boundary, tolerance=1e-12)
    np.testing.assert_allclose(result.energy[-1], best.energy[-1], rtol=1e-6)


def test_null_space(mesh, start):
    free = mesh.interior
    # Two interior vertices move together.
    rows, columns = np.arange(len(free)), np.maximum(np.arange(len(free)) - 1, 0)
    z = csc_array((np.ones(len(free)), (rows, columns)), shape=(len(free), len(free) - 1))
    result = minimise_distortion(mesh, start, mesh.boundary, z, tolerance=1e-12)
    a, b = free[:2]
    np.testing.assert_allclose(result.points[a] - result.points[b], start[a] - start[b], atol=1e-13)
    all_free = minimise_distortion(mesh, start, mesh.boundary, tolerance=1e-12)
    assert all_free.energy[-1] < result.energy[-1] < result.energy[0]
    nothing = minimise_distortion(mesh, start, np.arange(len(start)))
    np.testing.assert_array_equal(nothing.points, start)


def test_flipped_maps_are_returned(mesh, start):
    u = start.copy()
    u[mesh.interior[0]] += 5
    result = minimise_distortion(mesh, u, mesh.boundary)
    assert result.stop == "flipped"
    np.testing.assert_array_equal(result.points, u)


def test_a_face_flat_within_rounding_is_no_obstacle(mesh, start):
    # Met where a continuity row keeps the corners of a face on a line.
    u = start.copy()
    face = next(t for t in mesh.triangles if set(t) <= set(mesh.interior.tolist()))
    u[face[2]] = u[face[0]] + 0.5 * (u[face[1]] - u[face[0]])
    lift = np.array([[0, -1], [1, 0]]) @ (u[face[1]] - u[face[0]])
    u[face[2]] += 1e-13 * lift
    result = minimise_distortion(mesh, u, mesh.boundary, max_steps=300, tolerance=1e-9)
    assert result.stop == "converged"
    assert result.energy[0] > 1e9
    assert (np.diff(result.energy) < 0).all()
    assert result.energy[-1] < 3


def test_bad_input(mesh, start):
    with pytest.raises(InputError, match="max_steps"):
        minimise_distortion(mesh, start, mesh.boundary, max_steps=-1)
    with pytest.raises(InputError, match="positions"):
        minimise_distortion(mesh, start[1:], mesh.boundary)
    with pytest.raises(InputError, match="null-space basis has 3 rows"):
        minimise_distortion(mesh, start, mesh.boundary, np.eye(3))
    with pytest.raises(InputError, match="no vertex 99999"):
        minimise_distortion(mesh, start, [99999])
