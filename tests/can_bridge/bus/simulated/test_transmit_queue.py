"""The transmit queue against a sorted list, and the order of arbitration against the bits on the wire."""

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.simulated.port import Queued, TransmitQueue
from can_bridge.wire.frame import Frame, priority
from can_bridge.wire.frame_bits import sent_bits


@st.composite
def frames(draw) -> Frame:
    extended = draw(st.booleans())
    # Few leading bits, so that the two formats meet.
    base, rest = draw(st.integers(0, 3)), draw(st.integers(0, 0x3FFFF))
    return Frame(
        frame_id=base << 18 | rest if extended else base,
        data=draw(st.binary(max_size=2)),
        is_extended=extended,
        is_fd=draw(st.booleans()),
    )


@given(one=frames(), other=frames())
def test_the_smaller_priority_is_the_one_whose_bits_win(one, other):
    """At the first bit in which two frames with stuff bits differ, the dominant one, 0, prevails."""
    if priority(one) != priority(other):
        assert (priority(one) < priority(other)) == (sent_bits(one).stuffed < sent_bits(other).stuffed)
    else:
        assert (one.frame_id, one.is_extended) == (other.frame_id, other.is_extended)


@given(items=st.lists(frames(), max_size=20), takes=st.lists(st.sampled_from([None, 0, 1]), max_size=40))
def test_a_queue_gives_the_highest_priority_and_equals_in_order(items, takes):
    """What was sent is taken out also behind a newer head: 1 takes the second."""
    queue, expected, coming, serial = TransmitQueue(10), list[Queued](), list(items), 0
    for time_ns, place in enumerate(takes):
        if place is not None and place < len(expected):
            assert queue.head == expected[0]
            queue.remove(expected.pop(place))
        elif coming:
            frame = coming.pop()
            assert queue.put(frame, time_ns) == (len(expected) < 10)
            if len(expected) < 10:
                serial += 1
                expected = sorted([*expected, Queued(priority(frame), serial, time_ns, frame)], key=lambda one: one[:2])
        assert len(queue) == len(expected)
