"""Steps on time, late, early, and on a clock that goes wrong."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.messages import Reason
from contract.config.vehicle import EcuConfig
from ecu.fail_safe import FailSafe, OperatingMode, PeriodInputs
from ecu.timing import LATEST_NS, StepTiming
from tests.each import each

PERIOD = 20_000_000


def after(*elapsed_ms: float, start_ns: int = 0, **settings: Any) -> list[StepTiming]:
    """The timing after each of these intervals, from a first step on."""
    config = EcuConfig(**settings)
    now_ns, timing, timings = start_ns, StepTiming().next(start_ns, PERIOD, config), []
    for elapsed in elapsed_ms:
        now_ns += round(elapsed * 1e6)
        timing = timing.next(now_ns, PERIOD, config)
        timings.append(timing)
    return timings


def test_steps_on_time_leave_no_trace_and_the_first_is_never_late():
    assert set(after(*[20.0] * 5)) == {StepTiming(step_ns=k * PERIOD) for k in range(1, 6)}
    assert StepTiming().next(10**18, PERIOD, EcuConfig()) == StepTiming(step_ns=10**18)


@each("elapsed, skipped", [(29.9, 0), (30.0, 1), (40.0, 1), (49.9, 1), (50.0, 2), (60.0, 2)])
def test_skipped_periods_are_whole_ones_to_the_nearest(elapsed, skipped):
    timing = after(elapsed)[0]
    assert (timing.skipped, timing.off_time, timing.fault) == (skipped, int(skipped > 0), None)


@each(
    "intervals",
    [
        # A step late and the next one on time, for ever.
        *([20.0 + jitter, 20.0 - jitter] * 200 for jitter in (1.0, 5.0, 9.0)),
        # A clock that differs by up to 4.5 %: an eighth forgotten with each step bounds the sum to eight times that.
        *([period] * 1000 for period in (19.1, 19.9, 20.1, 20.9)),
    ],
)
def test_jitter_and_a_clock_that_differs_a_little_never_add_up_to_a_period(intervals):
    assert {(timing.skipped, timing.fault) for timing in after(*intervals)} == {(0, None)}


LATE, EARLY = Reason.DEADLINE, Reason.CLOCK


@each(
    "intervals, settings, expected",
    [
        # Late steps count in a window and not in a row: here the third of ten.
        ([60.0, 60.0, 20.0, 60.0], {}, (3, LATE)),
        ([40.0, *[20.0] * 4, 40.0, *[20.0] * 3, 40.0], {}, (9, LATE)),
        ([40.0, *[20.0] * 4, 40.0, *[20.0] * 4, 40.0], {}, None),
        ([40.0] * 50, {"deadline_misses": 10}, (9, LATE)),
        ([40.0] * 50, {"deadline_misses": 11}, None),
        # A silence longer than hold and decay is a fault by itself.
        ([80.0], {}, None),
        ([100.0], {}, (0, LATE)),
        ([100.0], {"hold_periods": 2}, None),
    ],
)
def test_misses_end_in_a_fault_when_the_settings_say(intervals, settings, expected):
    faults = [(k, timing.fault) for k, timing in enumerate(after(*intervals, **settings)) if timing.fault]
    assert (faults[0] if faults else None) == expected


def test_a_window_longer_than_any_memory_is_as_good_as_one_that_is_never_full():
    never = 2**31 - 1
    endless = EcuConfig(deadline_window=never, deadline_misses=never, loss_window=never, loss_limit=never)
    full = EcuConfig(deadline_window=6, deadline_misses=6, loss_window=6, loss_limit=6)
    found = []
    for config in (endless, full):
        timing, mode = StepTiming(), FailSafe(mode=OperatingMode.CONTROL)
        for k, now_ns in enumerate((0, PERIOD, 4 * PERIOD, 6 * PERIOD, 7 * PERIOD)):
            timing = timing.next(now_ns, PERIOD, config)
            inputs = PeriodInputs(
                usable=k % 2 == 0, enable_request=True, unusable_because=Reason.STREAM_LOST, window_full=True
            )
            mode = mode.next(inputs, config)
        found.append((timing.off_time, mode.lost))
    assert found == [(0b0110, 0b1010)] * 2


@each("period, fault", [*((late, LATE) for late in (25.0, 29.9, 30.1, 39.0)), *((e, EARLY) for e in (5.0, 10.0, 12.0))])
def test_steps_that_are_always_late_or_early_switch_off_however_little_each(period, fault):
    timings = after(*[period] * 20)
    assert next(timing.fault for timing in timings if timing.fault) is fault
    assert fault is LATE or {timing.skipped for timing in timings} == {0}


def test_rows_for_skipped_periods_keep_the_window_on_the_clock_but_for_what_is_forgotten():
    assert sum(timing.skipped for timing in after(*[29.9] * 200)) == pytest.approx(200 * 9.9 / 20.0, rel=0.15)
    timing = after(3.6e6)[0]
    assert (timing.fault, timing.skipped, timing.lag_ns) == (LATE, 180_000 - 1, 0)


@each("back_ms", [0.0, 1e-6, 200.0, 1e4, 1e9])
def test_a_clock_that_stands_or_goes_back_is_a_fault_and_is_then_followed(back_ms):
    stopped, followed = after(-back_ms, 20.0, start_ns=2 * 10**15)
    assert (stopped.fault, stopped.skipped, stopped.lag_ns) == (Reason.CLOCK, 0, 0)
    assert (followed.fault, followed.skipped) == (None, 0)


@each("start_ns", [None, 0, LATEST_NS - PERIOD, LATEST_NS])
def test_a_time_out_of_the_limits_is_a_fault_until_the_clock_is_within_them_again(start_ns):
    timing = StepTiming(step_ns=start_ns)
    for now_ns in (LATEST_NS + 1, 2**63 - 1, 10**30):
        timing = timing.next(now_ns, PERIOD, EcuConfig())
        assert timing == StepTiming(step_ns=LATEST_NS, fault=Reason.CLOCK)
    back = timing.next(LATEST_NS - PERIOD, PERIOD, EcuConfig())
    assert back.fault is Reason.CLOCK
    assert back.next(LATEST_NS, PERIOD, EcuConfig()) == StepTiming(step_ns=LATEST_NS)
    # Before 0, even in the first step; from there to the last moment every time between two has room in 64 bits.
    before = StepTiming().next(-(10**30), PERIOD, EcuConfig())
    assert before == StepTiming(step_ns=-1, fault=Reason.CLOCK)
    assert before.next(0, PERIOD, EcuConfig()).fault is None
    longest = before.next(LATEST_NS, PERIOD, EcuConfig())
    assert longest.fault is Reason.DEADLINE
    assert 2 * (longest.skipped + 1) * PERIOD < 2**63


@given(st.lists(st.integers(-(2**63), 2**63 - 1) | st.integers(0, 10**18), max_size=20))
def test_no_clock_raises_and_every_lag_is_under_half_a_period(times):
    timing, last = StepTiming(), None
    for now_ns in times:
        timing = timing.next(now_ns, PERIOD, EcuConfig())
        assert timing.step_ns == min(max(now_ns, -1), LATEST_NS)
        assert -PERIOD / 2 <= timing.lag_ns <= PERIOD / 2
        assert timing.skipped >= 0
        assert 0 <= timing.off_time < 1 << EcuConfig().deadline_window
        if not 0 <= now_ns <= LATEST_NS or (last is not None and now_ns <= last):
            assert timing.fault is Reason.CLOCK
        last = now_ns
