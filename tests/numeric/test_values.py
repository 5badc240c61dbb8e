"""Small helpers against the functions of NumPy that they stand for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss

from patchtransfer._core import gauss
from patchtransfer.numeric.arrays import distinct


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
