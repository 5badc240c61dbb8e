import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import csc_array

from patchtransfer import InputError, _core
from patchtransfer.mesh.background_mesh import TriangleMesh, target_mesh
from patchtransfer.mesh.harmonic import mesh_harmonic_map
from patchtransfer.paper.bounded_distortion import remove_foldovers


def grid_mesh(n):
    x = np.arange(n) / n
    sides = [(x, 0 * x), (0 * x + 1, x), (1 - x, 0 * x + 1), (0 * x, 1 - x)]
    return target_mesh([np.concatenate([np.stack(s, axis=1) for s in sides])], max_area=0.8 / n**2)


@pytest.fixture(scope="module")
def mesh():
    return grid_mesh(16)


def spike(points, height):
    """The bottom side pushed up towards the top one."""
    x, y = points.T
    return np.stack([x, y + (1 - y) * height * np.exp(-(((x - 0.5) / 0.12) ** 2))], axis=1)


def signed_areas(mesh, u):
    return TriangleMesh(u, mesh.triangles, ()).areas()


def by_numpy(matrix, k):
    """Signed SVD by numpy.linalg.svd, then the projection of (σ₁, σ₂) onto the cone 0 <= σ₁ <= k σ₂."""
    left, sigma, right = np.linalg.svd(matrix)
    sign = 1.0 if np.linalg.det(left) * np.linalg.det(right) >= 0 else -1.0
    left[:, 1] *= sign
    sigma[1] *= sign
    if sigma[0] > k * sigma[1]:
        ray = np.array([k, 1.0])
        sigma = ray * max(0.0, ray @ sigma) / (ray @ ray)
    return left @ np.diag(sigma) @ right


@given(arrays(float, (5, 2, 2), elements=st.floats(-2, 2, width=32)), st.floats(1.01, 50))
def test_projection_equals_numpy_svd(matrices, k):
    matrices = matrices + 1e-3 * np.array([[1.0, 0.4], [-0.3, 0.7]])
    flat = matrices.reshape(-1, 4)
    got = _core.project_bounded_distortion(flat, np.full(len(flat), k))
    for matrix, nearest in zip(matrices, got.reshape(-1, 2, 2), strict=True):
        expected = by_numpy(matrix, k)
        # Where z or w vanish nearest points are not unique; distances are.
        assert np.linalg.norm(nearest - matrix) == pytest.approx(np.linalg.norm(expected - matrix), abs=1e-9)
        z = abs(complex(matrix[0, 0] + matrix[1, 1], matrix[1, 0] - matrix[0, 1]))
        if z > 1e-4:
            np.testing.assert_allclose(nearest, expected, atol=1e-9)


@pytest.mark.parametrize("k", [0.5, np.nan, np.inf])
def test_projection_refuses_bad_bounds(k):
    with pytest.raises(ValueError, match="bound k"):
        _core.project_bounded_distortion(np.ones((1, 4)), np.array([k]))


@pytest.mark.parametrize("height", [0.4, 0.6, 0.8])
def test_unfolds_a_bent_boundary(mesh, height):
    image = spike(mesh.points, height)
    start = mesh_harmonic_map(mesh, mesh.boundary, image[mesh.boundary])
    folded = np.count_nonzero(signed_areas(mesh, start) <= 0)
    assert folded > 5
    result = remove_foldovers(mesh, start, mesh.boundary)
    assert result.converged
    assert (signed_areas(mesh, result.points) > 0).all()
    np.testing.assert_array_equal(result.points[mesh.boundary], image[mesh.boundary])
    assert result.flips[0] == folded
    assert result.flips[-1] == 0
    assert len(result.flips) == len(result.energy) == len(result.k_max) == result.iterations + 1
    # The energy never increases: not in a step, and not when bounds are relaxed.
    assert (np.diff(result.energy) <= 1e-12 * result.energy[0]).all()
    assert result.k.max() == result.k_max[-1]


def test_unfolds_scrambled_vertices(mesh):
    rng = np.random.default_rng(3)
    start = mesh.points.copy()
    start[mesh.interior] = rng.uniform(size=(len(mesh.interior), 2))
    result = remove_foldovers(mesh, start, mesh.boundary)
    assert result.flips[0] > len(mesh.triangles) / 3
    assert result.converged
    assert (signed_areas(mesh, result.points) > 0).all()


def test_bounds_are_raised_where_needed(mesh):
    # At the spike's tip the boundary itself forces large distortion.
    image = spike(mesh.points, 0.6) * [1, 3]
    start = mesh_harmonic_map(mesh, mesh.boundary, image[mesh.boundary])
    result = remove_foldovers(mesh, start, mesh.boundary, k0=1.5)
    assert result.converged
    assert result.k_max[0] == 1.5
    assert result.k_max[-1] > 3
    assert np.all(np.diff(result.k_max) >= 0)
    assert result.k_mean[-1] <= result.k_max[-1]


def test_an_impossible_boundary_is_reported(mesh):
    image = mesh.points.copy()
    image[:, 0] *= -1  # reversed: every face would have to be flipped
    result = remove_foldovers(mesh, image, mesh.boundary, max_iterations=60)
    assert not result.converged
    assert result.iterations <= 60
    assert min(result.flips) == np.count_nonzero(signed_areas(mesh, result.points) <= 0) > 0


def test_a_good_map_stays(mesh):
    start = mesh.points @ np.array([[2.0, 0.3], [0.1, 1.0]])
    result = remove_foldovers(mesh, start, mesh.boundary)
    assert result.converged
    assert result.iterations == 0
    np.testing.assert_array_equal(result.points, start)


def tied(mesh):
    """Rows u_c - u_a = const on pairs of interior vertices, eliminated by hand: u_c is the slave."""
    free = mesh.interior
    number = {int(v): i for i, v in enumerate(free)}
    slaves = {}
    for t in mesh.triangles[:: len(mesh.triangles) // 9]:
        a, c = (int(v) for v in t[:2])
        if {a, c} <= set(number) and not {a, c} & {*slaves, *slaves.values()}:
            slaves[c] = a
    masters = [int(v) for v in free if int(v) not in slaves]
    column = {v: i for i, v in enumerate(masters)}
    rows, columns = [], []
    for v in free.tolist():
        rows.append(number[v])
        columns.append(column[slaves.get(v, v)])
    return slaves, csc_array((np.ones(len(free)), (rows, columns)), shape=(len(free), len(masters)))


def test_null_space_path(mesh):
    slaves, z = tied(mesh)
    assert len(slaves) > 3
    free, boundary = mesh.interior, mesh.boundary
    start = spike(mesh.points, 0.5)
    start[free] = mesh.points[free]
    k = np.full(len(mesh.triangles), 3.0)
    arrays_ = (z.data, z.indices.astype(np.int64), z.indptr.astype(np.int64), z.shape)
    solver = _core.LocalGlobal(mesh.points, mesh.triangles, boundary, arrays_)
    u, flips, energy = solver.iterate(start, k, 1, 0.0)
    assert flips[0] > 0
    assert len(flips) == len(energy) == 2
    # By hand: one weighted least-squares problem in the masters for the projected Jacobians.
    corners = mesh.points[mesh.triangles]
    gradients = np.linalg.inv(np.concatenate([corners, np.ones((len(corners), 3, 1))], axis=2).transpose(0, 2, 1))[
        :, :, :2
    ]
    jacobian = np.einsum("fic,fid->fcd", start[mesh.triangles], gradients)
    h = _core.project_bounded_distortion(jacobian.reshape(-1, 4), k).reshape(-1, 2, 2)
    weight = np.sqrt(mesh.areas())
    m, n = len(mesh.triangles), len(mesh.points)
    design = np.zeros((m, 2, n))
    for i in range(3):
        design[np.arange(m), :, mesh.triangles[:, i]] += weight[:, None] * gradients[:, i]
    design = design.reshape(2 * m, n)
    right = (weight[:, None, None] * h).transpose(0, 2, 1).reshape(2 * m, 2)
    right = right - design[:, boundary] @ start[boundary]
    right = right - design[:, free] @ start[free]
    masters = np.linalg.lstsq(design[:, free] @ z.toarray(), right, rcond=None)[0]
    np.testing.assert_allclose(u[free], start[free] + z @ masters, atol=1e-10)
    np.testing.assert_allclose(energy[0], ((jacobian - h) ** 2).sum(axis=(1, 2)) @ mesh.areas())

    result = remove_foldovers(mesh, start, boundary, z)
    for c, a in slaves.items():
        np.testing.assert_allclose(result.points[c] - result.points[a], start[c] - start[a], atol=1e-12)
    assert result.converged


def test_bad_input(mesh):
    start = mesh.points
    for bad in ({"k0": 1.0}, {"beta": 1.0}, {"beta_growth": 0.5}, {"max_iterations": -1}, {"stall": -1.0}):
        with pytest.raises(InputError, match="foldover removal"):
            remove_foldovers(mesh, start, mesh.boundary, **bad)
    with pytest.raises(InputError, match="initial map"):
        remove_foldovers(mesh, start[:-1], mesh.boundary)
    with pytest.raises(InputError, match="no fixed vertex"):
        remove_foldovers(mesh, start, [])
