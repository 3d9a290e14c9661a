"""A node without its bus, and one that does not keep up."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.faults.connection import Disconnect, SlowConsumer
from contract.errors import BusError
from tests.can_bridge.bus.faults.links import PERIOD_S, number_of, numbered, numbers, simulated_link

CUT = Disconnect(start_s=9.5 * PERIOD_S, end_s=19.5 * PERIOD_S)


def test_an_open_wire_is_silence_in_both_directions(link):
    faulty = link.wrapped(link.one, CUT)
    assert numbers(link.stream(faulty, link.other, 30)) == [*range(10), *range(20, 30)]
    assert faulty.injectors[0].acted == 10
    other = link.wrapped(link.other, Disconnect(start_s=30.5 * PERIOD_S, end_s=35.5 * PERIOD_S))
    # Frame 30 had arrived when the wire opened; 31 to 35 do not come later.
    assert numbers(link.stream(link.one, other, 10)) == [30, *range(36, 40)]


def test_a_device_that_is_gone_says_so_and_comes_back(link):
    faulty = link.wrapped(link.other, Disconnect(kind="device_gone", end_s=1.5 * PERIOD_S))
    link.one.send(numbered(1))
    link.advance()
    with pytest.raises(BusError, match="the device is gone"):
        faulty.receive_all()
    with pytest.raises(BusError, match="frame 0x120 was not sent: the device is gone"):
        faulty.send(numbered(2))
    link.advance()
    assert faulty.receive_all() == []
    faulty.send(numbered(3))
    link.advance()
    assert [number_of(frame) for frame in link.one.receive_all()] == [3]
    assert faulty.injectors[0].acted == 2


def test_a_slow_consumer_gets_the_oldest_and_loses_the_newest(link):
    """Three frames a period, one taken, room for five: worked out by hand."""
    faulty = link.wrapped(link.other, SlowConsumer(frames_per_call=1, queue=5, end_s=4.5 * PERIOD_S))
    received, number = [], 0
    for _ in range(6):
        for _ in range(3):
            link.one.send(numbered(number))
            number += 1
        link.advance()
        received.append([number_of(frame) for frame in faulty.receive_all()])
    # In the queue: 0 1 2; then 1 2 3 4 5; then 2 3 4 5 6 without 7 and 8; then 3 4 5 6 9 without 10 and 11.
    assert received == [[0], [1], [2], [3], [4, 5, 6, 9, 12, 13, 14], [15, 16, 17]]
    assert faulty.injectors[0].acted == 4


@given(st.lists(st.integers(0, 6), max_size=25), st.integers(1, 4), st.integers(1, 8))
def test_a_slow_consumer_loses_what_it_counts_and_nothing_else(bursts, per_call, queue):
    link = simulated_link()
    faulty = link.wrapped(link.other, SlowConsumer(frames_per_call=per_call, queue=queue, end_s=1.0))
    sent, received = 0, []
    for burst in bursts:
        for _ in range(burst):
            link.one.send(numbered(sent))
            sent += 1
        link.advance()
        frames = faulty.receive_all()
        assert len(frames) <= per_call
        received += frames
    link.advance(10**9)
    received += faulty.receive_all()
    numbers = [number_of(frame) for frame in received]
    assert numbers == sorted(set(numbers))
    assert len(numbers) == sent - faulty.injectors[0].acted
