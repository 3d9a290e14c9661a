"""Response times: the published counterexample, another tool's numbers, and a bus played through event by event."""

from math import lcm

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.timing.periodic_message import PeriodicMessage
from can_bridge.timing.response_time import (
    Timing,
    message_response_times,
    response_times,
    timing,
    utilisation,
)
from contract.config.vehicle import BusConfig

US = 1000


def timings(*rows: tuple[int, int, int]) -> list[Timing]:
    """Of (frame, period, jitter), deadlines as the periods."""
    return [Timing(frame_ns=c, period_ns=t, deadline_ns=t, jitter_ns=j) for c, t, j in rows]


def davis_messages() -> list[PeriodicMessage]:
    """Messages A, B and C of Davis et al. (2007), section 3.1: seven bytes at 125 kbit/s, 125 bits in 1 ms."""
    rows = (("A", 2500, 2500), ("B", 3500, 3250), ("C", 3500, 3250))
    return [
        PeriodicMessage(
            name=name, frame_id=number, is_fd=False, length=7, period_ns=period * US, deadline_ns=deadline * US
        )
        for number, (name, period, deadline) in enumerate(rows, start=1)
    ]


def test_the_counterexample_to_the_first_analysis():
    """Its third message meets its deadline in the first instance, at 3 ms, and misses it in the second, at 3.5 ms."""
    bus = BusConfig(nominal_bitrate=125_000)
    messages = davis_messages()
    assert [message.worst_ns(bus) for message in messages] == [1000 * US] * 3
    found = message_response_times(messages, bus)
    assert [one.response_ns for one in found] == [2000 * US, 3000 * US, 3500 * US]
    assert [one.blocking_ns for one in found] == [1000 * US, 1000 * US, 0]
    assert [one.instance for one in found] == [0, 0, 1]
    assert [one.in_time for one in found] == [True, True, False]
    # 1 / 2.5 + 2 / 3.5, which the paper gives as 97 per cent.
    assert float(utilisation([timing(message, bus) for message in messages])) == pytest.approx(0.9714, abs=5e-5)


# What pyCPA 1.2 (github.com/IDA-TUBS/pycpa, 824e794), SPNPScheduler(cycle_time=1) with PJd event models, says of the
# messages without jitter of their own; it counts from when a frame is queued, the analysis here from its release.
PYCPA = (
    (((6, 100, 50), (11, 35, 17), (9, 35, 0), (3, 70, 0), (10, 35, 17)), {2: 47, 3: 85}),
    (((6, 130, 0), (11, 70, 0), (4, 35, 17), (10, 20, 3), (3, 20, 0)), {0: 17, 1: 27, 4: 90}),
    (((10, 130, 0), (7, 25, 0), (9, 35, 17), (11, 35, 17), (2, 50, 0)), {0: 21, 1: 28, 4: 234}),
    (((8, 100, 3), (2, 50, 0), (9, 50, 25), (10, 20, 3), (3, 20, 0)), {1: 20, 4: 90}),
)


def test_another_tool_gives_the_same_response_times():
    for rows, published in PYCPA:
        found = response_times(timings(*rows), bit_ns=1)
        assert {level: found[level].response_ns for level in published} == published, (rows, published)


SETS = st.lists(
    st.tuples(st.integers(1, 9), st.sampled_from([10, 12, 15, 20, 30, 60]), st.sampled_from([0, 0, 1, 5, 12])),
    min_size=1,
    max_size=5,
)


def play(rows, offsets, delays, *, until):
    """Longest response of each message on a bus that always sends the queued frame of highest priority, in whole ticks.

    Args:
        rows: (frame, period, jitter), the highest priority first; every frame takes its whole length.
        offsets: of the first release.
        delays: share of the jitter by which each release is queued, in turns.
    """
    waiting = []
    for level, ((_, period, jitter), offset) in enumerate(zip(rows, offsets, strict=True)):
        queued = 0
        for number, release in enumerate(range(offset, until, period)):
            # Frames of one message are queued in the order of their release.
            queued = max(queued, release + round(jitter * delays[(number + level) % len(delays)]))
            waiting.append((queued, level, release))
    worst = [0] * len(rows)
    now = 0
    while waiting:
        ready = [item for item in waiting if item[0] <= now]
        if not ready:
            now = min(item[0] for item in waiting)
            continue
        sent = min(ready, key=lambda item: (item[1], item[2]))
        waiting.remove(sent)
        now += rows[sent[1]][0]
        worst[sent[1]] = max(worst[sent[1]], now - sent[2])
    return worst


@given(
    rows=SETS,
    seeds=st.lists(st.floats(0, 1), min_size=5, max_size=5),
    delays=st.lists(st.floats(0, 1), min_size=1, max_size=4),
)
def test_no_frame_is_later_than_the_bound(rows, seeds, delays):
    found = response_times(timings(*rows), bit_ns=1)
    offsets = [int(seed * period) for (_, period, _), seed in zip(rows, seeds, strict=False)]
    played = play(rows, offsets, delays, until=240)
    for one, longest in zip(found, played, strict=True):
        assert one.response_ns is None or longest <= one.response_ns


@given(rows=SETS.filter(lambda rows: sum(c / t for c, t, _ in rows) <= 1))
def test_the_bound_of_the_last_message_without_jitter_is_reached(rows):
    """Nothing of lower priority blocks it, so its worst case is that all messages come at once."""
    steady = [(frame, period, 0) for frame, period, _ in rows]
    found = response_times(timings(*steady), bit_ns=1)[-1]
    played = play(steady, [0] * len(steady), [0.0], until=lcm(*(period for _, period, _ in steady)))
    assert found.response_ns == played[-1]


def test_a_bus_that_cannot_keep_up_has_no_bound():
    for rows, bounded in [
        (((5, 10, 0), (6, 10, 0)), [True, False]),  # 110 %
        (((5, 10, 0), (5, 10, 0)), [True, True]),  # all of it, and nothing that adds to it
        (((5, 10, 0), (5, 10, 1)), [True, False]),  # all of it, and jitter
        (((5, 10, 0), (5, 10, 0), (1, 100, 0)), [True, False, False]),  # the second can be blocked by the third
    ]:
        found = response_times(timings(*rows), bit_ns=1)
        assert [one.response_ns is not None for one in found] == bounded, (rows, bounded)
        assert [one.in_time for one in found][-1] == bounded[-1], (rows, bounded)


def test_a_load_of_nearly_all_comes_to_an_end():
    """Its busy period would last for years."""
    almost = [Timing(frame_ns=999_999_999, period_ns=10**9, deadline_ns=10**9)]
    small = Timing(frame_ns=1, period_ns=2 * 10**9, deadline_ns=2 * 10**9)
    assert response_times([*almost, small, *almost], bit_ns=1)[1].response_ns is None


def test_a_frame_that_comes_within_a_bit_still_wins():
    """The tau_bit of the paper: the second frame of the first message comes as the bus gets free for the last one."""
    for bit_ns, in_between in ((1, 0), (2, 40)):
        rows = timings((40, 101, 0), (60, 1000, 0), (10, 1000, 0))
        assert response_times(rows, bit_ns=bit_ns)[2].response_ns == 40 + 60 + in_between + 10


def test_messages_out_of_order_are_refused():
    a, b, _ = davis_messages()
    for messages in ([b, a], [a, a]):
        with pytest.raises(ValueError, match="must be in falling priority"):
            message_response_times(messages, BusConfig())


def test_thousands_of_messages_with_one_rhythm_are_counted_not_listed():
    """All at once, 3,000 frames of a tenth of a millisecond: each waits for those above it and one from below.

    Two sums over all messages of higher priority for every message would take minutes.
    """
    count, frame = 3000, 100 * US
    found = response_times(timings(*[(frame, 10_000 * count * US, 0)] * count), bit_ns=2 * US)
    below = [frame] * (count - 1) + [0]
    assert [one.response_ns for one in found] == [below[k] + (k + 1) * frame for k in range(count)]
    assert [one.blocking_ns for one in found] == below
