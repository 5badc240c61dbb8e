"""Dense and sparse linear algebra of the core against NumPy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csc_array, random_array

from patchtransfer.numeric import dense
from patchtransfer.numeric.definite import DefiniteFactor

sizes = st.integers(1, 24)


def numbers(*shape, seed=0):
    return np.random.default_rng((seed, *shape)).normal(size=shape)


@given(m=sizes, k=sizes, n=sizes, left=st.sampled_from([(), (3,), (2, 3), (2, 1)]), right=st.sampled_from([(), (3,)]))
def test_products_broadcast_as_numpys(m, k, n, left, right):
    a, b = numbers(*left, m, k), numbers(*right, k, n)
    np.testing.assert_allclose(dense.product(a, b), a @ b, atol=1e-13)
    np.testing.assert_allclose(
        dense.product(a, b[..., 0].reshape(-1, k)[0]), a @ b[..., 0].reshape(-1, k)[0], atol=1e-13
    )


def test_products_of_views_of_nothing_and_of_what_does_not_fit():
    a = numbers(6, 5)
    np.testing.assert_allclose(dense.product(a[::-2].T, a[::2, ::-1]), a[::-2].T @ a[::2, ::-1], atol=1e-14)
    assert dense.product(np.zeros((2, 0)), np.zeros((0, 3))).tolist() == np.zeros((2, 3)).tolist()
    assert dense.product(np.zeros((0, 2, 4)), np.zeros((4, 3))).shape == (0, 2, 3)
    with pytest.raises(ValueError, match="do not fit"):
        dense.product(a, a)


@given(m=sizes, n=sizes, lead=st.sampled_from([(), (4,), (2, 3)]), full=st.booleans())
def test_singular_values_are_numpys(m, n, lead, full):
    a = numbers(*lead, m, n)
    u, sigma, vt = dense.svd(a, full=full)
    wanted = np.linalg.svd(a, full_matrices=full)
    assert (u.shape, vt.shape) == (wanted[0].shape, wanted[2].shape)
    np.testing.assert_allclose(sigma, wanted[1], atol=1e-13)
    k = min(m, n)
    np.testing.assert_allclose((u[..., :k] * sigma[..., None, :]) @ vt[..., :k, :], a, atol=1e-13)


def test_singular_values_of_large_stacks_and_of_no_numbers():
    a = numbers(500, 9, 4)
    np.testing.assert_allclose(dense.svd(a)[1], np.linalg.svd(a)[1], atol=1e-13)
    with pytest.raises(RuntimeError, match="finite"):
        dense.svd(np.full((3, 3), np.nan))


@given(n=sizes, columns=st.sampled_from([(), (1,), (3,)]))
def test_systems_are_solved_as_numpys(n, columns):
    a, b = numbers(n, n) + 8 * np.eye(n), numbers(n, *columns, seed=1)
    np.testing.assert_allclose(dense.solve(a, b), np.linalg.solve(a, b), atol=1e-12)
    gram = a @ a.T
    np.testing.assert_allclose(dense.solve_definite(gram, numbers(n)), np.linalg.solve(gram, numbers(n)), atol=1e-11)
    values, vectors = dense.eigen(gram)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(gram), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(gram @ vectors, vectors * values, atol=1e-10)


@given(m=sizes, n=sizes, rank=st.integers(1, 6))
def test_least_squares_are_the_shortest(m, n, rank):
    a, b = numbers(m, rank) @ numbers(rank, n), numbers(m, 2, seed=1)
    wanted = np.linalg.lstsq(a, b, rcond=1e-10)[0]
    np.testing.assert_allclose(dense.least_squares(a, b, 1e-10), wanted, atol=1e-9 * (1 + abs(wanted).max()))


def test_systems_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="square"):
        dense.solve(numbers(2, 3), numbers(2))
    with pytest.raises(ValueError, match="rows"):
        dense.solve_definite(np.eye(3), np.ones(2))


def test_sparse_definite_systems():
    n = 40
    a = random_array((n, n), density=0.1, rng=np.random.default_rng(1), format="csc")
    matrix, b = csc_array(a @ a.T + csc_array(np.eye(n))), numbers(n, 2)
    x = DefiniteFactor(matrix).solve(b)
    np.testing.assert_allclose(matrix @ x, b, atol=1e-11)
    np.testing.assert_array_equal(DefiniteFactor(matrix).solve(b[:, 0]), x[:, 0])
    for bad in (np.diag([1.0, 0.0]), np.array([[1.0, 2.0], [2.0, 1.0]])):
        with pytest.raises(RuntimeError, match="not positive definite"):
            DefiniteFactor(csc_array(bad))
