"""Sparse matrices against SciPy's, to the bit; small helpers against the functions of NumPy that they stand for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss
from scipy.sparse import coo_array, csr_array, triu

from patchtransfer._core import gauss, sparse_product
from patchtransfer.numeric.arrays import distinct
from patchtransfer.numeric.definite import upper_triangle
from patchtransfer.numeric.sparse import Sparse, ranges

sizes = st.integers(0, 9)
seeds = st.integers(0, 10**6)


def entries(m, n, seed):
    """Rows, columns and values of entries, some at the same place, some zero; none where there is no place."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 3 * max(m, n, 1))) if m * n else 0
    values = rng.normal(size=count)
    values[rng.random(count) < 0.2] = 0.0
    return rng.integers(0, max(m, 1), count), rng.integers(0, max(n, 1), count), values


def pair(m, n, seed):
    """The same matrix as ours and as SciPy's."""
    row, column, value = entries(m, n, seed)
    theirs = csr_array(coo_array((value, (row, column)), shape=(m, n)))
    theirs.sum_duplicates()
    return Sparse.of_entries(row, column, value, (m, n)), theirs


def same(ours, theirs):
    assert ours.shape == theirs.shape
    np.testing.assert_array_equal(ours.toarray(), theirs.toarray())
    # By rows, columns sorted, no place twice.
    for k in range(ours.shape[0]):
        assert (np.diff(ours.indices[ours.indptr[k] : ours.indptr[k + 1]]) > 0).all()
    assert ours.indptr[-1] == ours.nnz == len(ours.indices)


@given(m=sizes, k=sizes, n=sizes, seed=seeds)
def test_products_and_sums_are_scipys_to_the_bit(m, k, n, seed):
    (a, their_a), (b, their_b), (c, their_c) = pair(m, k, seed), pair(k, n, seed + 1), pair(m, k, seed + 2)
    same(a, their_a)
    same(a.T, their_a.T)
    same(a @ b, their_a @ their_b)
    same(a + c, their_a + their_c)
    x = np.random.default_rng(seed).normal(size=(k, 2))
    np.testing.assert_array_equal(a @ x, their_a @ x)
    np.testing.assert_array_equal(a @ x[:, 0], their_a @ x[:, 0])
    np.testing.assert_array_equal(b.T @ x, their_b.T @ x)
    assert (a @ x).dtype == (a @ x[:, 0]).dtype == np.float64


@given(m=sizes, n=sizes, seed=seeds)
def test_parts_are_scipys(m, n, seed):
    a, theirs = pair(m, n, seed)
    rng = np.random.default_rng(seed)
    rows = rng.integers(0, m, 5) if m else np.empty(0, int)
    begin, end = sorted(rng.integers(0, n + 1, 2).tolist())
    same(a[rows], theirs[rows])
    where = rng.random(m) < 0.5
    same(a[where], theirs[np.flatnonzero(where)])
    same(a[rows, begin:end], theirs[rows][:, begin:end])
    same(a[:, begin:], theirs[:, begin:])
    np.testing.assert_array_equal(a.diagonal(), theirs.diagonal())
    factors = rng.normal(size=n)
    factors[::2] = 0.0
    scaled = a.scaled(factors)
    np.testing.assert_array_equal(scaled.toarray(), theirs.toarray() * factors)
    assert scaled.data.all()
    limit = 0.5
    kept = a.without(limit)
    np.testing.assert_array_equal(kept.toarray(), np.where(abs(theirs.toarray()) < limit, 0.0, theirs.toarray()))
    same(Sparse.of(theirs), a.to_scipy())
    assert Sparse.of(a) is a


@given(n=sizes, seed=seeds)
def test_the_upper_triangle_is_scipys(n, seed):
    a, theirs = pair(n, n, seed)
    for given_ in (a, theirs):
        columns = upper_triangle(given_)
        np.testing.assert_array_equal(columns.T.toarray(), triu(theirs).toarray())


def test_rows_are_chosen_where_true():
    a = Sparse.of_entries([0, 1, 2], [2, 1, 0], [1.0, 2.0, 3.0], (3, 3))
    assert a[np.array([True, False, True])].toarray().tolist() == [[0, 0, 1], [3, 0, 0]]
    assert Sparse.diagonal_of(np.array([4.0, 5.0])).toarray().tolist() == [[4, 0], [0, 5]]
    assert ranges(np.array([7, 2, 0]), np.array([2, 0, 3])).tolist() == [7, 8, 0, 1, 2]


def test_what_does_not_fit_is_refused():
    a, b = Sparse.of_entries([0], [0], [1.0], (2, 3)), Sparse.of_entries([0], [0], [1.0], (2, 2))
    for wrong in (lambda: a @ b, lambda: a + b, lambda: a @ np.ones(2)):
        with pytest.raises(ValueError, match="do not fit"):
            wrong()
    zero = np.zeros(1, np.int64)
    with pytest.raises(ValueError, match="out of range"):
        sparse_product((np.array([0, 1]), zero + 5, np.ones(1)), (np.array([0, 1]), zero, np.ones(1)), 1)
    # Unsorted columns.
    with pytest.raises(ValueError, match=r"[Ii]ndices"):
        sparse_product((np.array([0, 2]), np.array([1, 0]), np.ones(2)), (np.array([0, 0, 0]), zero[:0], np.ones(0)), 1)


@given(st.lists(st.integers(-4, 4) | st.floats(-2, 2, width=16)))
def test_distinct_values_are_numpys(values):
    values = np.array(values, float)
    np.testing.assert_array_equal(distinct(values), np.unique(values))


@pytest.mark.parametrize("n", [1, 2, 3, 8, 21])
def test_gauss_rules_are_numpys(n):
    for ours, theirs in zip(gauss(n), leggauss(n), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-15)


def test_a_rule_has_a_node():
    with pytest.raises(ValueError, match="at least one node"):
        gauss(0)
