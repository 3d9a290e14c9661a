"""Steps on time, late, early, and on a clock that goes wrong."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.messages import Reason
from contract.config.vehicle import EcuConfig
from firmware_sim.ecu.timing import LATEST_NS, Timing
from tests.each import each

PERIOD = 20_000_000
MS = 1_000_000


def after(*elapsed_ms: float, start_ns: int = 0, config: EcuConfig | None = None) -> list[Timing]:
    """The timing after each of these intervals, from a first step on."""
    config = EcuConfig() if config is None else config
    now_ns, timing, found = start_ns, Timing().next(start_ns, PERIOD, config), []
    for elapsed in elapsed_ms:
        now_ns += round(elapsed * MS)
        timing = timing.next(now_ns, PERIOD, config)
        found.append(timing)
    return found


def first_fault(*elapsed_ms: float, config: EcuConfig | None = None) -> tuple[int, Reason] | None:
    faults = [(k, timing.fault) for k, timing in enumerate(after(*elapsed_ms, config=config)) if timing.fault]
    return faults[0] if faults else None


def test_steps_on_time_leave_no_trace():
    assert set(after(*[20.0] * 5)) == {Timing(step_ns=k * PERIOD) for k in range(1, 6)}


def test_the_first_step_is_never_late():
    assert Timing().next(10**18, PERIOD, EcuConfig()) == Timing(step_ns=10**18)


@each("elapsed, skipped", [(29.9, 0), (30.0, 1), (40.0, 1), (49.9, 1), (50.0, 2), (60.0, 2)])
def test_skipped_periods_are_whole_ones_to_the_nearest(elapsed, skipped):
    timing = after(elapsed)[0]
    assert (timing.skipped, timing.off_time, timing.fault) == (skipped, int(skipped > 0), None)


@each("jitter", [1.0, 5.0, 9.0])
def test_jitter_about_the_due_time_is_no_lateness(jitter):
    """A step `jitter` late and the next one on time, for ever."""
    assert first_fault(*[20.0 + jitter, 20.0 - jitter] * 200) is None
    assert sum(timing.skipped for timing in after(*[20.0 + jitter, 20.0 - jitter] * 200)) == 0


@each("period", [19.9, 20.1, 20.9, 19.1])
def test_a_clock_that_differs_a_little_never_adds_up_to_a_period(period):
    """Up to 4.5 %, where an eighth forgotten with each step bounds the sum to eight times the difference."""
    assert {timing.skipped for timing in after(*[period] * 1000)} == {0}
    assert first_fault(*[period] * 1000) is None


@each("period", [25.0, 29.9, 30.1, 39.0])
def test_steps_that_are_always_late_switch_off_however_little_each(period):
    fault = first_fault(*[period] * 20)
    assert fault is not None
    assert fault[1] is Reason.DEADLINE
    # The rows that stand in for skipped periods keep the window on the clock, but for what is forgotten.
    timings = after(*[29.9] * 200)
    assert sum(timing.skipped for timing in timings) == pytest.approx(200 * 9.9 / 20.0, rel=0.15)


@each("period", [5.0, 10.0, 12.0])
def test_steps_that_are_always_early_are_a_wrong_clock(period):
    fault = first_fault(*[period] * 20)
    assert fault is not None
    assert fault[1] is Reason.CLOCK
    assert {timing.skipped for timing in after(*[period] * 20)} == {0}


def test_late_steps_count_in_a_window_and_not_in_a_row():
    assert first_fault(60.0, 60.0, 20.0, 60.0) == (3, Reason.DEADLINE)
    # The third one comes when the first has left the window of ten.
    assert first_fault(*[40.0], *[20.0] * 4, *[40.0], *[20.0] * 4, 40.0) is None
    assert first_fault(*[40.0], *[20.0] * 4, *[40.0], *[20.0] * 3, 40.0) == (9, Reason.DEADLINE)


def test_more_misses_than_the_window_never_come():
    assert first_fault(*[40.0] * 50, config=EcuConfig(deadline_misses=11)) is None
    assert first_fault(*[40.0] * 50, config=EcuConfig(deadline_misses=10)) == (9, Reason.DEADLINE)


def test_a_silence_longer_than_hold_and_decay_is_a_fault_by_itself():
    assert first_fault(80.0) is None
    assert first_fault(100.0) == (0, Reason.DEADLINE)
    assert first_fault(100.0, config=EcuConfig(hold_periods=2)) is None
    timing = after(3.6e6)[0]
    assert (timing.fault, timing.skipped, timing.lag_ns) == (Reason.DEADLINE, 180_000 - 1, 0)


@each("back_ms", [0.0, 1e-6, 200.0, 1e4, 1e9])
def test_a_clock_that_stands_or_goes_back_is_a_fault_and_is_then_followed(back_ms):
    stopped, followed = after(-back_ms, 20.0, start_ns=2 * 10**15)
    assert (stopped.fault, stopped.skipped, stopped.lag_ns) == (Reason.CLOCK, 0, 0)
    assert (followed.fault, followed.skipped) == (None, 0)


def test_a_time_before_zero_is_a_fault_even_in_the_first_step():
    timing = Timing().next(-1, PERIOD, EcuConfig())
    assert (timing.fault, timing.step_ns) == (Reason.CLOCK, -1)
    assert timing.next(0, PERIOD, EcuConfig()).fault is None


@each("start_ns", [None, 0, LATEST_NS - PERIOD, LATEST_NS])
def test_a_time_beyond_the_latest_is_a_fault_until_the_clock_is_within_its_limits_again(start_ns):
    timing = Timing(step_ns=start_ns)
    for now_ns in (LATEST_NS + 1, 2**63 - 1, 10**30):
        timing = timing.next(now_ns, PERIOD, EcuConfig())
        assert timing == Timing(step_ns=LATEST_NS, fault=Reason.CLOCK)
    back = timing.next(LATEST_NS - PERIOD, PERIOD, EcuConfig())
    assert back.fault is Reason.CLOCK
    assert back.next(LATEST_NS, PERIOD, EcuConfig()) == Timing(step_ns=LATEST_NS)


def test_the_longest_time_between_two_steps_fits_64_bits():
    """From the moment before the clock's start to its last."""
    timing = Timing().next(-(10**30), PERIOD, EcuConfig()).next(LATEST_NS, PERIOD, EcuConfig())
    assert timing.fault is Reason.DEADLINE
    assert 2 * (timing.skipped + 1) * PERIOD < 2**63


@given(st.lists(st.integers(-(2**63), 2**63 - 1) | st.integers(0, 10**18), max_size=20))
def test_no_clock_raises_and_every_lag_is_under_half_a_period(times):
    timing, last = Timing(), None
    for now_ns in times:
        timing = timing.next(now_ns, PERIOD, EcuConfig())
        assert timing.step_ns == min(max(now_ns, -1), LATEST_NS)
        assert -PERIOD / 2 <= timing.lag_ns <= PERIOD / 2
        assert timing.skipped >= 0
        assert 0 <= timing.off_time < 1 << EcuConfig().deadline_window
        if not 0 <= now_ns <= LATEST_NS or (last is not None and now_ns <= last):
            assert timing.fault is Reason.CLOCK
        last = now_ns
