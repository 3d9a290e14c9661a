"""What a vehicle counts."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bench.real_time.vehicle_counts import LONGEST_NS, RESOLUTION_NS, Durations
from tests.examples import examples


@examples(100)
@given(
    times=st.lists(st.integers(-5, 60_000_000) | st.just(10**15), min_size=1, max_size=60),
    share=st.sampled_from([0.01, 0.5, 0.99, 1.0]),
)
def test_quantiles_are_numpys_to_the_resolution(times: list[int], share: float) -> None:
    durations = Durations()
    for time in times:
        durations.add(time)
    # What is beyond the ends is kept at them.
    exact = np.quantile(np.clip(times, 0, LONGEST_NS), share, method="inverted_cdf") / 1e6
    assert exact - RESOLUTION_NS / 1e6 < durations.quantile_ms(share) <= exact
