import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import null_space
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import spsolve

from patchtransfer import InputError
from patchtransfer.mesh.background_mesh import TriangleMesh, target_mesh
from patchtransfer.mesh.harmonic import mesh_harmonic_map
from shapes import SQUARE


@pytest.fixture(scope="module")
def mesh():
    hole = 0.5 + 0.15 * np.array([[1, 0], [0, -1], [-1, 0], [0, 1]])
    return target_mesh([SQUARE, hole], max_area=0.01)


def cotangent_assembly(mesh):
    """The textbook formula, by angles."""
    p, t = mesh.points, mesh.triangles
    rows, columns, values = [], [], []
    for k in range(3):
        i, j, o = t[:, k], t[:, (k + 1) % 3], t[:, (k + 2) % 3]
        angles = [np.arctan2(*(p[x] - p[o]).T[::-1]) for x in (i, j)]
        half_cot = 0.5 / np.tan(angles[1] - angles[0])
        rows += [i, j, i, j]
        columns += [j, i, i, j]
        values += [-half_cot, -half_cot, half_cot, half_cot]
    n = len(p)
    indices = (np.concatenate(rows), np.concatenate(columns))
    return coo_array((np.concatenate(values), indices), shape=(n, n)).tocsc()


def test_laplacian(mesh):
    laplacian = mesh.laplacian()
    np.testing.assert_allclose(laplacian.toarray(), cotangent_assembly(mesh).toarray(), atol=1e-12)
    # Linear precision: the residual of a linear function vanishes at interior vertices.
    linear = mesh.points @ [0.7, -1.3] + 0.4
    assert np.abs(laplacian @ linear)[mesh.interior].max() < 1e-13
    # |∇u|² = 0.7² + 1.3² all over.
    np.testing.assert_allclose(linear @ laplacian @ linear, (0.49 + 1.69) * mesh.areas().sum())


def test_laplacian_names_the_bad_triangle():
    with pytest.raises(InputError, match="face 1"):
        TriangleMesh(SQUARE, np.array([[0, 1, 2], [0, 3, 2]]), ()).laplacian()


@given(arrays(float, (2, 2), elements=st.floats(-3, 3)), arrays(float, 2, elements=st.floats(-3, 3)))
def test_reproduces_affine_maps(mesh, matrix, shift):
    image = mesh.points @ matrix + shift
    u = mesh_harmonic_map(mesh, mesh.boundary, image[mesh.boundary])
    np.testing.assert_allclose(u, image, atol=1e-12)


def test_second_order_convergence():
    def exact(p):
        z = p[:, 0] + 1j * p[:, 1]
        return np.stack([np.exp(z).real, (z**3).imag], axis=1)

    errors = []
    for n in (8, 16, 32, 64):
        x = np.arange(n) / n
        sides = [np.stack([a, b], axis=1) for a, b in ((x, 0 * x), (0 * x + 1, x), (1 - x, 0 * x + 1), (0 * x, 1 - x))]
        mesh = target_mesh([np.concatenate(sides)], max_area=0.5 / n**2)
        image = exact(mesh.points)
        u = mesh_harmonic_map(mesh, mesh.boundary, image[mesh.boundary])
        mass = np.bincount(mesh.triangles.ravel(), np.repeat(mesh.areas() / 3, 3))
        errors.append(np.sqrt(mass @ ((u - image) ** 2).sum(axis=1)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.7).all(), orders
    assert errors[-1] < 1e-4


def constrained(mesh, seed=0, rows=12):
    """Random rows B u = 0 that involve boundary vertices, their null space and a particular solution."""
    rng = np.random.default_rng(seed)
    boundary, free = mesh.boundary, mesh.interior
    values = mesh.points[boundary] ** 2 * [1, 2] + 0.1
    b = np.zeros((rows, len(mesh.points)))
    for row in b:
        row[rng.choice(len(mesh.points), 4, replace=False)] = rng.normal(size=4)
    b[:, boundary[:3]] += rng.normal(size=(rows, 3))
    particular = np.linalg.lstsq(b[:, free], -b[:, boundary] @ values, rcond=None)[0]
    return b, values, null_space(b[:, free]), particular


@pytest.mark.parametrize("sparse", [True, False])
def test_null_space_equals_lagrange_multipliers(mesh, sparse):
    b, values, z, particular = constrained(mesh)
    boundary, free = mesh.boundary, mesh.interior
    basis = csc_array(z) if sparse else z
    u = mesh_harmonic_map(mesh, boundary, values, basis, particular)
    np.testing.assert_array_equal(u[boundary], values)
    np.testing.assert_allclose(b @ u, 0, atol=1e-12)
    stiffness = cotangent_assembly(mesh).toarray()
    m = len(b)
    system = np.block([[stiffness[np.ix_(free, free)], b[:, free].T], [b[:, free], np.zeros((m, m))]])
    right = np.concatenate([-stiffness[np.ix_(free, boundary)] @ values, -b[:, boundary] @ values])
    np.testing.assert_allclose(u[free], np.linalg.solve(system, right)[: len(free)], atol=1e-10)


def test_without_constraints_equals_elimination(mesh):
    boundary, free = mesh.boundary, mesh.interior
    values = np.sin(3 * mesh.points[boundary])
    stiffness = cotangent_assembly(mesh).tocsr()
    expected = spsolve(stiffness[free][:, free].tocsc(), -stiffness[free][:, boundary] @ values)
    u = mesh_harmonic_map(mesh, boundary[::-1], values[::-1])
    np.testing.assert_allclose(u[free], expected, atol=1e-12)


def test_basis_is_not_changed(mesh):
    n = len(mesh.interior)
    z = csc_array((np.ones(n), np.arange(n)[::-1].copy(), np.arange(n + 1)), shape=(n, n))
    before = [z.data.copy(), z.indices.copy(), z.indptr.copy()]
    mesh_harmonic_map(mesh, mesh.boundary, mesh.points[mesh.boundary], z)
    for a, b in zip(before, (z.data, z.indices, z.indptr), strict=True):
        np.testing.assert_array_equal(a, b)


def test_bad_input(mesh):
    boundary, values = mesh.boundary, mesh.points[mesh.boundary]
    with pytest.raises(InputError, match="distinct vertices"):
        mesh_harmonic_map(mesh, boundary, values[:-1])
    with pytest.raises(InputError, match="distinct vertices"):
        mesh_harmonic_map(mesh, np.zeros_like(boundary), values)
    with pytest.raises(InputError, match="finite"):
        mesh_harmonic_map(mesh, boundary, values * np.nan)
    with pytest.raises(InputError, match="null-space basis has 3 rows"):
        mesh_harmonic_map(mesh, boundary, values, np.eye(3))
    with pytest.raises(InputError, match="particular"):
        mesh_harmonic_map(mesh, boundary, values, particular=np.zeros((3, 2)))
    with pytest.raises(InputError, match="no fixed vertex"):
        mesh_harmonic_map(mesh, np.empty(0, int), np.empty((0, 2)))
    with pytest.raises(InputError, match="positive definite"):
        mesh_harmonic_map(mesh, boundary, values, np.zeros((len(mesh.interior), 2)))
