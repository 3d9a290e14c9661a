"""Percentiles and cyclictest's summary, where the answer is known without computing."""

import numpy as np

from firmware_sim.latency.cyclictest import Cyclictest, parsed
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


def test_cyclictest_2_4_is_read_back_in_us():
    summary = "T: 0 (17571) P:50 I:20000 C:    201 Min:     24 Act:   37 Avg:   45 Max:     889\n"
    expected = Cyclictest(priority=50, count=201, min_ms=0.024, mean_ms=0.045, max_ms=0.889)
    assert parsed("# /dev/cpu_dma_latency set to 0us\n" + summary) == expected
    # Without permission there is none.
    assert parsed("FATAL: could not set scheduler\n") is None
    assert parsed("T: 0 (17571) P:50 I:20000 C:      0 Min:1000000 Act:    0 Avg:    0 Max:       0\n") is None
