"""Percentiles of values for which they are known without computing."""

import numpy as np

from firmware_sim.latency.quantiles import NEEDED_FOR_P99_9, Quantiles


def test_one_to_thousand_milliseconds():
    values = np.random.default_rng(0).permutation(np.arange(1, 1001)) * 1e6
    assert Quantiles.of(values) == (500.0, 990.0, 999.0, 1000.0, 1000)


def test_three_thousand_periods_have_their_three_slowest_above_p99_9():
    # 0.999 * 3000 is more than 2997 in binary; a rank too high would show here.
    values = np.arange(1.0, 3001.0) * 1e6
    assert Quantiles.of(values).p99_9 == 2997.0


def test_below_a_thousand_p99_9_is_the_maximum():
    below = np.arange(1.0, NEEDED_FOR_P99_9) * 1e6
    assert Quantiles.of(below).p99_9 == below[-1] / 1e6
    enough = np.arange(1.0, NEEDED_FOR_P99_9 + 1.0) * 1e6
    assert Quantiles.of(enough).p99_9 == NEEDED_FOR_P99_9 - 1.0


def test_without_values_there_are_none():
    assert Quantiles.of(np.full(3, np.nan)) == (None, None, None, None, 0)


def test_what_never_came_counts_and_what_was_not_due_does_not():
    found = Quantiles.of(np.array([1e6, np.nan, np.inf]))
    assert found.number == 2
    assert found.p50 == 1.0
    assert found.max == np.inf
