"""Small functions of arrays against NumPy's own."""

from __future__ import annotations

import subprocess
import sys

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


def test_a_ctrl_c_while_numpy_is_looked_up_by_the_core_is_held_back():
    """In there it would end as a panic; here it comes where the lookup looks at NumPy's version."""
    program = """
import signal, sys
import numpy.lib
plain = numpy.lib.NumpyVersion
class Interrupted(plain):
    def __init__(self, text):
        signal.raise_signal(signal.SIGINT)
        super().__init__(text)
numpy.lib.NumpyVersion = Interrupted
try:
    import patchtransfer.numeric.arrays
except KeyboardInterrupt:
    sys.exit(7)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (7, "")
