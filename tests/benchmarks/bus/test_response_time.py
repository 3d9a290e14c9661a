"""The simulated bus never exceeds the analysis; and it would be seen if it did."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.bus import response_time
from benchmarks.bus.response_time import Sent, at_critical_instant, longest_frame, measure, play
from can_bridge.timing.periodic_message import PeriodicMessage
from can_bridge.timing.response_time import Timing, response_times
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_ns
from contract.config.vehicle import BusConfig
from tests.examples import examples

BUS = BusConfig()


def length_ns(frame: Frame) -> int:
    return frame_ns(frame, nominal_bitrate=BUS.nominal_bitrate, data_bitrate=BUS.data_bitrate)


@examples(25)  # a set is some hundred frames, bit by bit
@given(seed=st.integers(0, 2**62))
def test_no_message_is_later_than_the_analysis_says(seed):
    found = measure(sets=1, seed=seed)
    assert found["response_time_violations"] == 0
    assert 0 < found["largest_ratio"] <= 1
    assert 0 < found["largest_ratio_with_true_lengths"] <= 1


def davis() -> tuple[list[PeriodicMessage], list[Frame]]:
    """A, B and C of Davis et al. (2007), their periods in frames: 2.5, 3.5 and 3.5, all frames equally long."""
    frames: list[Frame] = []
    for frame_id in range(1, 0x7FF):
        frame = Frame(frame_id=frame_id, data=bytes(7), is_fd=False)
        if not frames or length_ns(frame) == length_ns(frames[0]):
            frames.append(frame)
    frames, unit = frames[:3], length_ns(frames[0])
    messages = [
        PeriodicMessage(
            name=name,
            frame_id=frame.frame_id,
            is_fd=False,
            length=7,
            period_ns=unit * halves // 2,
            deadline_ns=unit * quarters // 4,
        )
        for name, frame, halves, quarters in zip("ABC", frames, (5, 7, 7), (10, 13, 13), strict=True)
    ]
    return messages, frames


def test_the_published_counterexample_happens_on_the_bus():
    """C's second frame takes 3.5 frames, where the analysis of 1994 promised 3 and the deadline is at 3.25."""
    messages, frames = davis()
    unit = length_ns(frames[0])
    bound, played = at_critical_instant(messages, frames, 2, BUS)
    assert played.longest_ns[2] == bound.response_ns == 3.5 * unit
    assert (bound.instance, bound.in_time) == (1, False)


def first_instance_only(timings, *, bit_ns):
    """The analysis of 1994: it looks at the first frame after the critical instant alone."""
    found = []
    for level, one in enumerate(response_times(timings, bit_ns=bit_ns)):
        own, waited = timings[level], -1
        longer = one.blocking_ns
        while longer != waited:
            waited = longer
            longer = one.blocking_ns + sum(
                -(-(waited + other.jitter_ns + bit_ns) // other.period_ns) * other.frame_ns for other in timings[:level]
            )
        found.append(replace(one, response_ns=own.jitter_ns + waited + own.frame_ns))
    return found


def without_jitter_of_others(timings, *, bit_ns):
    still = [replace(one, jitter_ns=0) for one in timings]
    return [
        replace(response_times([*still[:level], own, *still[level + 1 :]], bit_ns=bit_ns)[level])
        for level, own in enumerate(timings)
    ]


def without_blocking(timings, *, bit_ns):
    return [response_times(timings[: level + 1], bit_ns=bit_ns)[level] for level in range(len(timings))]


@pytest.mark.parametrize("wrong", [without_jitter_of_others, without_blocking])
def test_an_analysis_that_leaves_something_out_is_found_out(monkeypatch, wrong):
    monkeypatch.setattr(response_time, "response_times", wrong)
    assert measure(sets=5, seed=0)["response_time_violations"] > 0


def test_the_first_analysis_is_found_out_on_the_published_messages(monkeypatch):
    monkeypatch.setattr(response_time, "response_times", first_instance_only)
    messages, frames = davis()
    bound, played = at_critical_instant(messages, frames, 2, BUS)
    assert bound.response_ns == 3 * length_ns(frames[0]) < played.longest_ns[2]


def test_a_frame_alone_takes_its_length():
    frame = longest_frame(davis()[0][0], BUS)
    played = play([[Sent(5_000, 7_000, frame)]], BUS)
    # Queued 2 us late, and then its bits, the intermission included.
    assert (played.longest_ns, played.frames) == ([2_000 + length_ns(frame)], 1)


def test_the_longest_frame_has_more_stuff_bits_than_most():
    message = PeriodicMessage(name="Some", frame_id=0x555, is_fd=False, length=8, period_ns=10**7)
    length = length_ns(longest_frame(message, BUS))
    assert length > length_ns(message.frame(bytes([0x55] * 8)))
    assert length <= message.worst_ns(BUS)


def test_figures_come_from_the_seed_and_progress_is_told():
    told: list[tuple[int, int]] = []
    found = [measure(sets=2, seed=seed, progress=lambda done, total: told.append((done, total))) for seed in (3, 3, 4)]
    assert found[0] == found[1] != found[2]
    assert told[:2] == [(1, 2), (2, 2)]
    assert found[0]["message_sets"] == 2
    assert found[0]["frames"] > 0


def test_bounds_for_any_content_are_above_those_for_one():
    """A frame is never longer than its worst case, so neither is a response."""
    messages, frames = davis()
    exact, _ = at_critical_instant(messages, frames, 1, BUS)
    any_content = response_times(
        [Timing(frame_ns=m.worst_ns(BUS), period_ns=m.period_ns, deadline_ns=m.period_ns) for m in messages],
        bit_ns=2000,
    )[1]
    assert exact.response_ns is not None
    assert any_content.response_ns is None or any_content.response_ns > exact.response_ns
