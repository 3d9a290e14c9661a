"""Echoes followed past the end of the counter, next to what was really sent."""

from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bench.heard_commands import EchoTracker
from tests.each import each


def sent(frames: int, period: int, tracker: EchoTracker | None = None, *, first: int = 0) -> EchoTracker:
    """After frames `first` to `first + frames - 1`, sent at 1000 times their number."""
    tracker = EchoTracker(counter_period=period) if tracker is None else tracker
    for number in range(first, first + frames):
        tracker = tracker.sent(number % period, 1000 * number)
    return tracker


@each("period", [16, 256])
def test_an_echo_of_a_frame_that_was_not_sent_is_none(period):
    assert EchoTracker(counter_period=period).received(0).age is None
    tracker = sent(3, period)
    for counter in range(3, period):
        assert tracker.received(counter).age is None
    tracker = tracker.received(2)
    ahead = tracker.received(3)
    assert (ahead.age, ahead.sampled_ns) == (None, None)
    # From the next one on it is followed again.
    assert ahead.received(2).age == 0


@given(st.sampled_from([16, 256]), st.lists(st.tuples(st.integers(1, 3), st.integers(0, 3)), max_size=400))
def test_every_honest_echo_has_its_frames_age(period, events):
    """As if numbered without end: an ECU that echoes the newest frames, some of them late, none twice out of order."""
    tracker, number, echoed = EchoTracker(counter_period=period), -1, -1
    for frames, late in events:
        tracker = sent(frames, period, tracker, first=number + 1)
        number += frames
        echoed = max(echoed, number - late, 0)
        tracker = tracker.received(echoed % period)
        assert (tracker.age, tracker.sampled_ns) == (number - echoed, 1000 * echoed)
