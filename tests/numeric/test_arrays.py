"""Small functions of arrays against NumPy's own."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from patchtransfer.numeric.arrays import among, distinct

numbers = st.lists(st.integers(-5, 5), max_size=12)


@given(numbers, numbers)
def test_membership_as_numpy_has_it(values, chosen):
    for kind in (np.int64, np.float64):
        array = np.array(values, kind)
        np.testing.assert_array_equal(among(array, chosen), np.isin(array, chosen))
        np.testing.assert_array_equal(among(array, frozenset(chosen)), np.isin(array, chosen))
        np.testing.assert_array_equal(distinct(array), np.unique(array))
