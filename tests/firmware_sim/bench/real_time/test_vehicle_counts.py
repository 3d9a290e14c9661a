"""What a vehicle counts."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bench.real_time.vehicle_counts import LONGEST_NS, RESOLUTION_NS, Durations
from tests.examples import examples


@examples(100)
@given(
    times=st.lists(st.integers(0, 60_000_000), min_size=1, max_size=60), share=st.sampled_from([0.01, 0.5, 0.99, 1.0])
)
def test_quantiles_are_numpys_to_the_resolution(times: list[int], share: float) -> None:
    durations = Durations()
    for time in times:
        durations.add(time)
    exact = np.quantile(times, share, method="inverted_cdf") / 1e6
    assert exact - RESOLUTION_NS / 1e6 < durations.quantile_ms(share) <= exact


def test_times_without_end_and_without_beginning_are_kept_at_the_ends() -> None:
    durations = Durations()
    durations.add(10**15)
    assert durations.quantile_ms(1.0) == LONGEST_NS / 1e6
    durations.add(-5)
    assert durations.quantile_ms(0.5) == 0.0
