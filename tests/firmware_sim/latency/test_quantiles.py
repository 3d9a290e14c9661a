"""Percentiles where the answer is known without computing."""

import numpy as np

from firmware_sim.latency.measured import NEEDED_FOR_P99_9, Quantiles


def test_percentiles_are_measured_values_by_nearest_rank():
    values = np.random.default_rng(0).permutation(np.arange(1, 1001)) * 1e6
    assert Quantiles.of(values) == (500.0, 990.0, 999.0, 1000.0, 1000)
    # 0.999 * 3000 is more than 2997 in binary; a rank too high would show here.
    assert Quantiles.of(np.arange(1.0, 3001.0) * 1e6).p99_9 == 2997.0
    for number, p99_9 in ((NEEDED_FOR_P99_9 - 1, NEEDED_FOR_P99_9 - 1), (NEEDED_FOR_P99_9, NEEDED_FOR_P99_9 - 1)):
        assert Quantiles.of(np.arange(1.0, number + 1.0) * 1e6).p99_9 == p99_9, number
    # What never came counts, and what was not due does not.
    assert Quantiles.of(np.array([1e6, np.nan, np.inf])) == (1.0, np.inf, np.inf, np.inf, 2)
    assert Quantiles.of(np.full(3, np.nan)) == (None, None, None, None, 0)
