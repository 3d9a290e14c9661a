"""The schedule, in a time of its own: sleeping and sending take as long as the test has it."""

from itertools import accumulate

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.tools.replay import LogSpan, Replayed, replay, span_of
from contract.errors import BusError
from tests.refused import refused


class Clock:
    """Sleeps overshoot by a fixed time, and sending takes one, or longer for one frame."""

    def __init__(self, overshoot_ns: int = 0, send_ns: int = 0, stall_ns: int = 0) -> None:
        self.now_ns = 0
        self.overshoot_ns, self.send_ns, self.stall_ns = overshoot_ns, send_ns, stall_ns
        self.sent_ns: list[int] = []

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9) + self.overshoot_ns

    def send(self, message: can.Message) -> None:
        self.sent_ns.append(self.now_ns)
        self.now_ns += self.send_ns + (self.stall_ns if message.arbitration_id == 0 else 0)

    def run(self, messages, **options) -> Replayed:
        return replay(
            messages,
            self.send,
            span=span_of("log", messages),
            start_ns=0,
            clock_ns=lambda: self.now_ns,
            sleep=self.sleep,
            **options,
        )


def log_of(times) -> list[can.Message]:
    return [can.Message(timestamp=t, arbitration_id=i % 0x800, is_extended_id=False) for i, t in enumerate(times)]


@given(
    gaps=st.lists(st.integers(0, 2_000_000), min_size=1, max_size=40),
    overshoot_us=st.integers(0, 50),
    send_us=st.integers(0, 50),
    speed=st.sampled_from([0.5, 1.0, 2.0, 10.0]),
)
def test_lateness_never_adds_up(gaps, overshoot_us, send_us, speed):
    """Late by one overshoot, and by the sending of frames that were due at about the same time; never by more."""
    times = [total_us / 1e6 for total_us in accumulate(gaps)]
    clock = Clock(overshoot_ns=overshoot_us * 1000, send_ns=send_us * 1000)
    done = clock.run(log_of(times), speed=speed)
    assert done.sent == len(gaps)
    free_at = 0.0
    for sent_ns, t in zip(clock.sent_ns, times, strict=True):
        due = (t - times[0]) * 1e9 / speed
        # A pause of 0.2 s is slept in pieces: each may overshoot, but only the last one makes it late.
        assert due - 1 <= sent_ns <= max(due + overshoot_us * 1000, free_at) + 2
        free_at = sent_ns + send_us * 1000


def test_a_stall_is_caught_up_and_shows():
    clock = Clock(stall_ns=25_000_000)
    messages = [*log_of([0.0, 0.01, 0.02, 0.03, 0.5]), can.Message(timestamp=0.6, is_error_frame=True)]
    done = clock.run(messages)
    assert clock.sent_ns == [0, 25_000_000, 25_000_000, 30_000_000, 500_000_000]
    assert (done.sent, done.late_ms(1.0), done.late_ms(0.5)) == (5, 15.0, 0.0)
    # Error frames are left out and counted.
    span = span_of("log", messages)
    assert (span.frames, span.left_out, span.first_s, span.last_s) == (5, 1, 0.0, 0.5)


def test_rounds_follow_each_other_by_a_mean_interval():
    assert span_of("log", log_of([5.0, 5.1, 5.4])).round_s == pytest.approx(0.4 + 0.2)
    assert LogSpan(frames=3, left_out=0, first_s=1.0, last_s=1.0).round_s == 1.0
    assert LogSpan(frames=1, left_out=0, first_s=1.0, last_s=1.0).round_s == 1.0


def test_it_can_be_stopped_before_each_frame_and_while_it_waits():
    for asked in [0, 1, 2, 5]:
        clock = Clock()
        answers = iter([False] * asked + [True] * 1000)
        done = clock.run(log_of([0.0, 10.0, 20.0]), is_over=answers.__next__)
        assert done.sent == len(clock.sent_ns) == (0 if asked == 0 else 1), asked
        # It stops within the 0.2 s that one sleep lasts.
        assert clock.now_ns <= 200_000_000 * asked, asked


def test_logs_that_cannot_be_replayed_are_refused():
    back = r"^a\.log: time goes back at frame 3 \(002\), from 2\.000000 to 1\.500000 s"
    for times, only, message in [
        ([1.0, 2.0, 1.5], None, back),
        # Also where the frame is not among those to send.
        ([1.0, 2.0, 1.5], {0}, back),
        ([], None, r"^a\.log: holds no CAN frame$"),
        ([1.0, 2.0], {9}, "holds no CAN frame to send among its 2"),
    ]:
        with refused(BusError, message):
            span_of("a.log", log_of(times), only)


@given(st.lists(st.integers(0, 10**6), min_size=1), st.floats(0.01, 1.0))
def test_percentiles_are_nearest_rank(late_us, share):
    done = Replayed(sent=len(late_us))
    done.late_us.update(late_us)
    exceeded = sum(one <= round(done.late_ms(share) * 1e3) for one in late_us)
    assert exceeded >= share * len(late_us) - 1e-9
    below = sum(one < round(done.late_ms(share) * 1e3) for one in late_us)
    assert below < share * len(late_us) + 1e-9
    assert done.late_ms(1.0) == max(late_us) / 1e3
