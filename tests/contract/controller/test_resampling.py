"""The past at another speed: what is linear along the way is read exactly, and the design speed changes nothing."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from contract.controller.resampling import places

SPEEDS = st.lists(st.floats(0.3, 2.0), min_size=2, max_size=60)


@given(SPEEDS, st.integers(1, 40))
def test_rows_lie_whole_steps_of_travel_behind_the_newest(speeds: list[float], length: int) -> None:
    travelled = np.cumsum(speeds)
    found = places(speeds, length)
    behind, reach = travelled[-1] - found.of(travelled), travelled[-1] - travelled[0]
    # Sums of 60 speeds in two orders.
    np.testing.assert_allclose(behind, np.arange(len(behind))[::-1], atol=1e-12)
    assert len(behind) == length or reach - 1e-9 < len(behind) <= reach + 1.0 + 1e-9
    assert (found.newer - (found.share > 0.0)).min() >= 0


def test_at_the_design_speed_every_row_is_its_own() -> None:
    rows = np.random.default_rng(0).normal(size=(12, 3))
    found = places([1.0] * 12, 12)
    np.testing.assert_array_equal(found.of(rows), rows)
    assert len(places([1.0] * 12, 13).newer) == 12
