"""Late and reordered frames: by how much, stamped how, and that the stream recovers."""

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.faults.lateness import Delay, Reorder
from can_bridge.e2e.receiver import Check, StreamState
from can_bridge.wire.bit_timing import worst_case_ns
from tests.can_bridge.bus.faults.links import PERIOD_NS, PERIOD_S, Link, number_of, numbered, simulated_link

MS = 10**6


def numbers(received) -> list[list[int]]:
    return [[number_of(frame) for frame in frames] for frames in received]


def seen(link: Link, receiver, until_ms: int) -> dict[int, int]:
    """When each frame was received, in ms, looking every ms."""
    when: dict[int, int] = {}
    while link.now_ns < until_ms * MS:
        link.advance(MS)
        when |= {number_of(frame): link.now_ns // MS for frame in receiver.receive_all()}
    return when


def test_a_fixed_delay_is_kept_to_the_millisecond_one_looks_in(link):
    faulty = link.wrapped(link.other, Delay(delay_s=0.0125))
    for number in range(3):
        link.one.send(numbered(number, now_ns=link.now_ns))
        # A frame takes less than half a ms.
        begin_ms = link.now_ns // MS
        when = seen(link, faulty, begin_ms + 20)
        assert when == {number: begin_ms + 13}
    assert faulty.injectors[0].acted == 3


def test_a_delay_counts_from_the_stamp_and_not_from_the_look(link):
    """The frame begins at 1 ms and is looked for at 20 ms: 5 ms have long passed, 25 have not."""
    for delay_ms, periods in ((5, 1), (25, 2)):
        faulty = link.wrapped(link.other, Delay(delay_s=delay_ms / 1e3))
        begin_ns = link.now_ns + MS
        link.advance(MS)
        link.one.send(numbered(7))
        looks = 0
        while not (frames := faulty.receive_all()):
            link.advance(PERIOD_NS - MS if looks == 0 else PERIOD_NS)
            looks += 1
        assert looks == periods
        arrived_ns = frames[0].timestamp_ns - delay_ms * MS
        frame_ns = worst_case_ns(numbered(7), nominal_bitrate=500_000, data_bitrate=2_000_000)
        assert begin_ns <= arrived_ns <= begin_ns + frame_ns


def test_the_stamp_tells_of_a_queue_behind_it_only():
    for restamp in [True, False]:
        link = simulated_link()
        direct = link
        faulty = direct.wrapped(direct.other, Delay(delay_s=3 * PERIOD_S, restamp=restamp))
        direct.one.send(numbered(1))
        direct.advance()
        assert faulty.receive_all() == [], restamp
        (plain,) = direct.listener.receive_all()
        direct.advance(3 * PERIOD_NS)
        (late,) = faulty.receive_all()
        assert late.timestamp_ns - plain.timestamp_ns == (3 * PERIOD_NS if restamp else 0), restamp
        assert late.data == plain.data, restamp


@given(st.lists(st.integers(0, 5), max_size=20), st.floats(0.0, 0.1), st.floats(0.0, 0.1), st.integers(0, 9))
def test_delayed_frames_come_once_and_in_order(bursts, delay_s, jitter_s, seed):
    link = simulated_link()
    faulty = link.wrapped(link.other, Delay(delay_s=delay_s, jitter_s=jitter_s), seed=seed)
    sent, received = 0, []
    for burst in bursts:
        for _ in range(burst):
            link.one.send(numbered(sent))
            sent += 1
        link.advance()
        received += faulty.receive_all()
    link.advance(10**9)
    received += faulty.receive_all()
    assert [number_of(frame) for frame in received] == list(range(sent))


def test_the_queue_empties_when_the_delay_ends(link):
    """Frames 6 to 9 come two periods late; 10 and 11 are not delayed themselves but stand in the queue behind 9."""
    fault = Delay(delay_s=2.5 * PERIOD_S, start_s=5.5 * PERIOD_S, end_s=9.5 * PERIOD_S)
    faulty = link.wrapped(link.other, fault)
    receptions = link.protected(link.one, faulty, 20)
    ok, nothing = (Check.OK,), (Check.NO_NEW_DATA,)
    assert [reception.checks for reception in receptions] == [*[ok] * 6, *[nothing] * 2, *[ok] * 3, ok * 3, *[ok] * 8]
    assert all(reception.stream is StreamState.VALID for reception in receptions[2:])
    assert faulty.injectors[0].acted == 6


def test_frames_come_in_whole_windows_and_in_another_order():
    for window in [2, 3, 5]:
        link = simulated_link()
        faulty = link.wrapped(link.other, Reorder(window=window))
        received = numbers(link.stream(link.one, faulty, 60))
        assert [len(frames) for frames in received] == [0 if (k + 1) % window else window for k in range(60)], window
        flat = [number for frames in received for number in frames]
        assert sorted(flat) == list(range(60)), window
        assert max(abs(place - number) for place, number in enumerate(flat)) == window - 1, window
        moved = sum(place != number for place, number in enumerate(flat))
        assert faulty.injectors[0].acted == moved > 10, window


def test_all_orders_of_a_window_come_equally_often(link):
    faulty = link.wrapped(link.other, Reorder(window=3))
    received = [tuple(n % 3 for n in frames) for frames in numbers(link.stream(link.one, faulty, 1800))]
    orders = [order for order in received if order]
    assert len(orders) == 600
    counts = [orders.count(order) for order in set(orders)]
    # Six orders of expectation 100, variance 600 * 1/6 * 5/6: within five standard deviations.
    assert len(counts) == 6
    assert max(abs(n - 100) for n in counts) < 5 * (600 * 5 / 36) ** 0.5


def test_what_is_kept_comes_when_the_span_ends(link):
    faulty = link.wrapped(link.other, Reorder(window=10, end_s=5.5 * PERIOD_S))
    received = numbers(link.stream(link.one, faulty, 8))
    assert [len(frames) for frames in received] == [0, 0, 0, 0, 0, 6, 1, 1]
    assert sorted(received[5]) == list(range(6))
    assert received[5][-1] == 5  # the first after the span is not shuffled with them
