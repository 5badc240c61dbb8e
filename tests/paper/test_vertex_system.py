import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array, eye_array, random_array
from scipy.sparse.linalg import spsolve

from patchtransfer.mesh.background_mesh import target_mesh
from patchtransfer.paper.vertex_system import Barycentric, VertexSystem
from shapes import SQUARE


@pytest.fixture(scope="module")
def mesh():
    return target_mesh([SQUARE], max_area=0.01)


def somewhere(mesh, rng, m=200):
    """A map of m vertices onto a mesh."""
    faces = rng.integers(0, len(mesh.triangles), m)
    weights = rng.dirichlet(np.ones(3), m)
    return Barycentric(faces, mesh.triangles[faces], weights)


def tied(n, fixed, rng):
    """A basis that ties some of the free vertices to several others."""
    free = np.setdiff1d(np.arange(n), fixed)
    z = csr_array(eye_array(n, format="csr")[:, free])
    some = csr_array(random_array((len(free), 7), density=0.2, rng=rng))
    return csr_array(z @ (eye_array(len(free), format="csr")[:, 7:] + some @ eye_array(7, len(free) - 7)))


@pytest.mark.parametrize("kind", ["all", "exact boundary", "tied"])
def test_solves_as_scipy_does(mesh, kind):
    rng = np.random.default_rng(3)
    n = len(mesh.points)
    fixed = mesh.boundary[:0] if kind == "all" else mesh.boundary
    basis = tied(n, fixed, rng) if kind == "tied" else None
    system = VertexSystem(mesh, fixed, basis)
    z = eye_array(n, format="csr")[:, np.setdiff1d(np.arange(n), fixed)] if basis is None else basis
    # Another map, another matrix, the same analysis.
    for _ in range(3):
        p, mass, diagonal = somewhere(mesh, rng), rng.random(200), rng.random(n)
        full = p.matrix(n)
        matrix = 0.3 * mesh.laplacian() + diags_array(diagonal) + full.T @ diags_array(mass) @ full
        right = rng.normal(size=(n, 2))
        system.factorize(0.3, diagonal, p, mass)
        expected = z @ spsolve((z.T @ matrix @ z).tocsc(), z.T @ right)
        np.testing.assert_allclose(system.solve(right), expected, atol=1e-12 * np.abs(expected).max())


def test_maps_multiply_as_matrices_do(mesh):
    rng = np.random.default_rng(0)
    p, n = somewhere(mesh, rng), len(mesh.points)
    x, y = rng.normal(size=(n, 2)), rng.normal(size=(200, 2))
    np.testing.assert_allclose(p.of(x), p.matrix(n) @ x, atol=1e-14)
    np.testing.assert_allclose(p.transposed(y, n), p.matrix(n).T @ y, atol=1e-13)


def test_nothing_to_solve_for(mesh):
    system = VertexSystem(mesh, np.arange(len(mesh.points)))
    system.factorize(1.0, np.ones(len(mesh.points)), somewhere(mesh, np.random.default_rng(0)), np.ones(200))
    np.testing.assert_array_equal(system.solve(np.ones((len(mesh.points), 2))), 0)
