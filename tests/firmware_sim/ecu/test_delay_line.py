from collections import deque

from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.ecu.delay_line import DelayLine


@given(st.lists(st.floats(allow_nan=False), max_size=20), st.integers(0, 5))
def test_what_goes_in_comes_out_so_many_periods_later(values, delay):
    line = DelayLine.filled(delay, 0.5)
    expected = deque([0.5] * (delay + 1), maxlen=delay + 1)
    for k, value in enumerate(values):
        line = line.pushed(value)
        expected.append(value)
        assert line.newest == value
        assert line.in_force == (values[k - delay] if k >= delay else 0.5)
        assert line.pending == tuple(expected)[1:]
