"""Deadlines: absolute, never caught up, and drawn to the vehicle's sampling."""

from random import Random

from hypothesis import given
from hypothesis import strategies as st

from ecu.real_time.deadlines import LARGEST_SLEW, REMEMBERED, Arrivals, Deadlines, wrapped
from tests.examples import examples

PERIOD = 20_000_000
durations = st.integers(0, 5 * PERIOD)


@given(st.lists(durations, min_size=1, max_size=50), st.integers(0, PERIOD - 1))
@examples(100)
def test_however_long_work_takes_every_period_is_begun_once_or_counted(works, grace):
    deadlines, now, begun = Deadlines(period_ns=PERIOD, due_ns=0, grace_ns=grace), 0, []
    for work in works:
        now = max(now, deadlines.due_ns)
        begun.append(deadlines.number)
        # Late by the grace at most, so never two steps for one period, nor a burst.
        assert now - deadlines.due_ns <= grace
        assert deadlines.due_ns == deadlines.number * PERIOD
        now += work
        before, deadlines = deadlines, deadlines.after(now)
        # No more are left out than are too late.
        assert deadlines.number == before.number + 1 or now - (deadlines.due_ns - PERIOD) > grace
    assert begun == sorted(set(begun))
    assert deadlines.number == len(begun) + deadlines.left_out


@given(st.integers(0, 10 * PERIOD), st.integers(-(10**15), 10**15))
@examples(100)
def test_a_slew_is_small_and_goes_the_shorter_way(due, target):
    after = Deadlines(period_ns=PERIOD, due_ns=due).slewed(target)
    assert abs(after.due_ns - due) <= PERIOD // LARGEST_SLEW
    distance = abs(wrapped(target - due, PERIOD))
    assert abs(wrapped(target - after.due_ns, PERIOD)) == max(0, distance - PERIOD // LARGEST_SLEW)


@given(
    phase=st.integers(0, PERIOD - 1),
    jitter=st.integers(0, 4_000_000),
    offset=st.integers(0, PERIOD - 1),
    ppm=st.integers(-200, 200),
    seed=st.integers(0, 2**32),
)
@examples(30)
def test_steps_come_to_lie_the_offset_behind_the_arrivals(phase, jitter, offset, ppm, seed):
    """Of a vehicle whose clock runs at another speed and whose frames are late by up to `jitter`."""
    rng = Random(seed)
    its_period = PERIOD * (1 + ppm * 1e-6)
    deadlines, arrivals = Deadlines(period_ns=PERIOD, due_ns=0), Arrivals(period_ns=PERIOD)
    for number in range(200):
        sent = round(phase + number * its_period)
        arrivals = arrivals.seen(sent + rng.randint(0, jitter))
        if (expected := arrivals.expected_ns) is not None:
            deadlines = deadlines.slewed(expected + offset)
        # REMEMBERED to know the phase, 16 for half a period; the rest is room.
        if number > REMEMBERED + LARGEST_SLEW:
            behind = wrapped(deadlines.due_ns - sent - offset - jitter // 2, PERIOD)
            # The median of uniform lateness lies somewhere in it; the clocks part meanwhile.
            assert abs(behind) <= jitter // 2 + 1 + (REMEMBERED + 1) * abs(its_period - PERIOD)
        deadlines = deadlines.after(deadlines.due_ns)


def test_an_arrival_is_expected_after_enough_have_been_seen_and_a_few_late_frames_do_not_move_it():
    arrivals = Arrivals(period_ns=PERIOD)
    for number in range(REMEMBERED):
        assert arrivals.expected_ns is None
        arrivals = arrivals.seen(number * PERIOD + (9_000_000 if number % 3 == 0 else 0))
    assert arrivals.expected_ns is not None and arrivals.expected_ns % PERIOD == 0
