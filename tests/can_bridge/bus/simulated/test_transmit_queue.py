"""The transmit queue against a sorted list, and the order of arbitration against the bits on the wire."""

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.simulated.transmit_queue import TransmitQueue
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import sent_bits
from can_bridge.wire.priority import priority


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


@given(items=st.lists(frames(), max_size=20), takes=st.lists(st.booleans(), max_size=40))
def test_a_queue_gives_the_highest_priority_and_equals_in_order(items, takes):
    queue, expected = TransmitQueue(10), list[tuple[tuple[int, bool, int], int, Frame]]()
    coming = list(items)
    for time_ns, take in enumerate(takes):
        if take and expected:
            expected.sort(key=lambda item: item[:2])
            head = queue.head
            assert (head.priority, head.queued_ns, head.frame) == expected.pop(0)
            queue.remove(head)
        elif coming:
            frame = coming.pop()
            taken = queue.put(frame, time_ns)
            assert taken == (len(expected) < 10)
            if taken:
                expected.append((priority(frame), time_ns, frame))
        assert len(queue) == len(expected)
    for frame_id in {frame.frame_id for frame in items}:
        ours = [item for item in expected if (item[2].frame_id, item[2].is_extended) == (frame_id, False)]
        assert queue.count(frame_id) == len(ours)


def test_a_frame_that_was_sent_is_taken_out_also_behind_a_newer_head():
    queue = TransmitQueue(3)
    queue.put(Frame(frame_id=5, data=b"1"), 1)
    sending = queue.head
    queue.put(Frame(frame_id=5, data=b"2"), 2)
    queue.put(Frame(frame_id=1, data=b""), 3)
    queue.remove(sending)
    assert [queue.head.frame.frame_id, len(queue)] == [1, 2]
    queue.remove(queue.head)
    assert queue.head.frame.data == b"2"
    assert queue.clear() == 1
    assert not queue
