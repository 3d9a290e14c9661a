"""The measurement compares what it claims to compare, and reports a difference."""

import numpy as np

from benchmarks.ecu.ecu_loop import largest_difference


def test_the_largest_difference_is_of_steps_that_both_made():
    one = np.array([0.0, np.nan, 0.02, 0.03])
    other = np.array([0.0, 0.5, 0.02, -0.01])
    assert largest_difference(one, one) == 0.0
    assert largest_difference(one, other) == 0.04
    assert largest_difference(other, one) == 0.04
    assert largest_difference(np.array([np.nan]), np.array([0.1])) == 0.0
