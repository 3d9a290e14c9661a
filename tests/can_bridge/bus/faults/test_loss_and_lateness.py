"""Frames that are lost, late, copied or reordered: how many, by how much, stamped how, and that the stream recovers."""

from collections import Counter
from itertools import groupby
from math import sqrt
from typing import Any

from can_bridge.bus.faults.frame_faults import BurstLoss, Delay, Drop, Duplicate, Reorder
from can_bridge.wire.frame_bits import worst_case_ns
from tests.can_bridge.bus.faults.links import PERIOD_NS, PERIOD_S, number_of, numbered, numbers, simulated_link

MS = 10**6


def test_everything_named_is_lost_in_the_span_and_nothing_else():
    span: Any = {"probability": 1.0, "start_s": 10 * PERIOD_S, "end_s": 15 * PERIOD_S, "frame_ids": (0x120, 0x140)}
    for at in ("send", "receive"):
        link = simulated_link()
        faulty = link.wrapped(link.one if at == "send" else link.other, Drop(at=at, **span))
        sender, receiver = (faulty, link.other) if at == "send" else (link.one, faulty)
        received = [frame for frames in link.stream(sender, receiver, 30, frame_ids=(0x120, 0x130)) for frame in frames]
        assert numbers([[one for one in received if one.frame_id == 0x120]]) == [*range(10), *range(15, 30)], at
        assert (len(received), faulty.injectors[0].acted) == (25 + 30, 5), at
        # Who sends faultily is heard so by all; who receives faultily is alone with it.
        assert len(link.listener.receive_all()) == (55 if at == "send" else 60), at


def test_losses_and_bursts_have_the_stated_share_and_length():
    # Independent losses are bursts, too.
    independent = 0.3, 1 / 0.7, Drop(probability=0.3)
    bursts_of = ((0.1, 4.0), (0.02, 1.0), (0.8, 10.0))
    for loss, mean_burst, fault in (
        independent,
        *((loss, mean_burst, BurstLoss(loss=loss, mean_burst=mean_burst)) for loss, mean_burst in bursts_of),
    ):
        link = simulated_link()
        n = 1000
        faulty = link.wrapped(link.one, fault)
        gone = [not frames for frames in link.stream(faulty, link.other, n)]
        assert faulty.injectors[0].acted == sum(gone)
        to_good = 1 / mean_burst
        correlation = 1 - to_good - to_good * loss / (1 - loss)
        # The variance of a sum over a two-state Markov chain, and of a geometric length; five standard deviations.
        spread = sqrt(loss * (1 - loss) / n * (1 + correlation) / (1 - correlation))
        assert abs(sum(gone) / n - loss) < 5 * spread, (loss, mean_burst)
        bursts = [len(list(group)) for is_gone, group in groupby(gone) if is_gone]
        assert len(bursts) > 12, (loss, mean_burst)
        length_spread = mean_burst * sqrt((1 - to_good) / len(bursts))
        assert abs(sum(bursts) / len(bursts) - mean_burst) <= 5 * length_spread, (loss, mean_burst)


def test_a_delay_counts_from_the_arrival_and_not_from_the_look(link):
    """A frame takes less than half a ms; it is looked for every ms, or first when its delay has passed."""
    faulty = link.wrapped(link.other, Delay(delay_s=0.0125))
    for number in range(3):
        begin_ms = link.now_ns // MS
        link.one.send(numbered(number, now_ns=link.now_ns))
        while not (frames := faulty.receive_all()):
            link.advance(MS)
        assert ([number_of(frame) for frame in frames], link.now_ns // MS - begin_ms) == ([number], 13)
    assert faulty.injectors[0].acted == 3
    link.one.send(numbered(7))
    link.advance()
    (late,) = faulty.receive_all()
    frame_ns = worst_case_ns(numbered(7), nominal_bitrate=500_000, data_bitrate=2_000_000)
    assert 0 <= late.timestamp_ns - 12.5 * MS - (link.now_ns - PERIOD_NS) <= frame_ns


def test_the_stamp_shows_a_queue_behind_it_only():
    for restamp in [True, False]:
        link = simulated_link()
        faulty = link.wrapped(link.other, Delay(delay_s=3 * PERIOD_S, restamp=restamp))
        received = link.stream(link.one, faulty, 4)
        plain, late = link.listener.receive_all()[0], received[3][0]
        assert [len(frames) for frames in received] == [0, 0, 0, 1], restamp
        assert late.timestamp_ns - plain.timestamp_ns == (3 * PERIOD_NS if restamp else 0), restamp
        assert late.data == plain.data, restamp


def test_the_queue_empties_when_the_delay_ends(link):
    """Frames 6 to 9 come two periods late; 10 and 11 are not delayed themselves but stand in the queue behind 9."""
    faulty = link.wrapped(link.other, Delay(delay_s=2.5 * PERIOD_S, start_s=5.5 * PERIOD_S, end_s=9.5 * PERIOD_S))
    received = link.stream(link.one, faulty, 20)
    assert [len(frames) for frames in received] == [*[1] * 6, 0, 0, 1, 1, 1, 3, *[1] * 8]
    assert numbers(received) == list(range(20))
    assert faulty.injectors[0].acted == 6


def test_copies_follow_their_frame():
    for copies in [1, 3]:
        link = simulated_link()
        fault = Duplicate(copies=copies, at="receive", start_s=9.5 * PERIOD_S, end_s=29.5 * PERIOD_S)
        received = link.stream(link.one, link.wrapped(link.other, fault), 50)
        expected = [1 + copies * (10 <= step < 30) for step in range(50)]
        assert numbers(received) == [step for step in range(50) for _ in range(expected[step])], copies


def test_windows_come_whole_and_in_all_orders_equally_often():
    for window in [2, 3, 5]:
        link = simulated_link()
        faulty = link.wrapped(link.other, Reorder(window=window))
        periods = 900 if window == 3 else 60
        received = link.stream(link.one, faulty, periods)
        sizes = [0 if (k + 1) % window else window for k in range(periods)]
        assert [len(frames) for frames in received] == sizes, window
        flat = numbers(received)
        assert sorted(flat) == list(range(periods)), window
        assert max(abs(place - number) for place, number in enumerate(flat)) == window - 1, window
        moved = sum(place != number for place, number in enumerate(flat))
        assert faulty.injectors[0].acted == moved > 10, window
        if window == 3:
            orders = Counter(tuple(n % 3 for n in flat[k : k + 3]) for k in range(0, periods, 3))
            # Six orders of expectation 50, variance 300 * 1/6 * 5/6: within five standard deviations.
            assert len(orders) == 6 and max(abs(n - 50) for n in orders.values()) < 5 * (300 * 5 / 36) ** 0.5


def test_what_is_kept_comes_when_the_span_ends(link):
    faulty = link.wrapped(link.other, Reorder(window=10, end_s=5.5 * PERIOD_S))
    received = link.stream(link.one, faulty, 8)
    assert [len(frames) for frames in received] == [0, 0, 0, 0, 0, 6, 1, 1]
    assert sorted(numbers(received)) == list(range(8))
    assert number_of(received[5][-1]) == 5  # the first after the span is not shuffled with them
