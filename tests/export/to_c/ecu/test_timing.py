"""The timing in C against the one in Python, over any run of a clock, and its limits by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.messages import Reason
from firmware_sim.ecu.timing import LATEST_NS, Timing
from tests.examples import examples

INT64 = st.integers(-(2**63), 2**63 - 1)


def as_python(timing) -> Timing:
    return Timing(
        step_ns=timing.step_ns if timing.has_step else None,
        lag_ns=timing.lag_ns,
        off_time=timing.off_time,
        skipped=timing.skipped,
        fault=Reason(timing.fault) if timing.fault else None,
    )


@st.composite
def clocks(draw, period_ns: int) -> list[int]:
    """Times of steps: near their due times, whole periods late, before 0, beyond the end, and anything."""
    now_ns, times = draw(st.sampled_from([0, 1, -5, 10**16, LATEST_NS - 20 * period_ns])), []
    near = st.integers(-period_ns, period_ns)
    late = st.integers(0, 8).map(lambda count: count * period_ns // 2)
    for _ in range(draw(st.integers(1, 40))):
        now_ns += period_ns + draw(st.just(0) | near | late | st.sampled_from([-period_ns, -period_ns - 1]))
        times.append(now_ns)
    if draw(st.booleans()):
        times.insert(draw(st.integers(0, len(times))), draw(INT64))
    return [time for time in times if -(2**63) <= time < 2**63]


@examples(100)
@given(data=st.data())
def test_every_run_of_a_clock_is_judged_as_in_python(core, data):
    timing, expected = core.ffi.new("sw_timing *"), Timing()
    for now_ns in data.draw(clocks(core.config.period_ns)):
        core.lib.sw_timing_next(timing, now_ns)
        expected = expected.next(now_ns, core.config.period_ns, core.config.ecu)
        assert as_python(timing) == expected


@pytest.mark.parametrize("now_ns", [-(2**63), -1, LATEST_NS + 1, 2**63 - 1])
def test_a_time_outside_the_clock_is_a_fault_of_it(core, now_ns):
    timing = core.ffi.new("sw_timing *")
    core.lib.sw_timing_next(timing, now_ns)
    assert as_python(timing) == Timing(step_ns=min(max(now_ns, -1), LATEST_NS), fault=Reason.CLOCK)


def test_the_longest_time_between_two_steps_is_counted(core):
    """From the moment before the clock's start to its last: 2^61 + 1 ns, less the one period that is due."""
    timing, period_ns = core.ffi.new("sw_timing *"), core.config.period_ns
    for now_ns in (-(2**63), LATEST_NS):
        core.lib.sw_timing_next(timing, now_ns)
    assert timing.skipped == round((LATEST_NS + 1 - period_ns) / period_ns)
    assert timing.fault == Reason.DEADLINE


def test_lateness_is_rounded_down_on_both_sides_of_zero(core):
    """A nanosecond early is -1 * 7 / 8 = -0.875, which is -1; a nanosecond late is 0.875, which is 0."""
    for off_ns, lag_ns in ((-1, -1), (1, 0), (-9, -8), (9, 7)):
        timing = core.ffi.new("sw_timing *")
        for now_ns in (0, core.config.period_ns + off_ns):
            core.lib.sw_timing_next(timing, now_ns)
        assert timing.lag_ns == lag_ns
