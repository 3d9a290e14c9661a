"""Faults of a whole node: it babbles, is off its bus, does not keep up, or has a wrong clock."""

import pytest

from can_bridge.bus.faults.fault import NS
from can_bridge.bus.faults.node_faults import MOST_BABBLED, Babble, ClockDrift, Disconnect, SlowConsumer
from can_bridge.wire.frame import Frame
from contract.errors import BusError
from tests.can_bridge.bus.faults.links import PERIOD_NS, PERIOD_S, number_of, numbered, numbers


def test_the_node_sends_at_the_rate_with_its_own_frames(link):
    fault = Babble(rate_hz=1000.0, start_s=9.5 * PERIOD_S, end_s=19.5 * PERIOD_S)
    faulty = link.wrapped(link.one, fault)
    received = link.stream(faulty, link.other, 30)
    # From 9.5 to 19 periods, the last call in the span: 190 ms.
    babbled = [frame for frames in received for frame in frames if frame.frame_id == 0]
    assert len(babbled) == len({frame.data for frame in babbled}) == faulty.injectors[0].acted == 190
    assert {(len(frame.data), frame.is_fd) for frame in babbled} == {(8, False)}
    assert [number_of(f) for frames in received for f in frames if f.frame_id == 0x120] == list(range(30))


class Hoard:
    """A transmit queue that is never emptied."""

    def __init__(self, room: int) -> None:
        self.room, self.taken = room, 0

    def send(self, frame: Frame) -> None:
        if self.taken == self.room:
            raise BusError("the transmit queue is full")
        self.taken += 1

    def receive_all(self) -> list[Frame]:
        return []


def test_a_bus_that_takes_no_more_ends_the_babble_and_not_the_node(link):
    full = Hoard(16)
    faulty = link.wrapped(full, Babble())
    # What was not taken is not made up for once there is room again; a long pause does not end in an endless burst.
    for room, pause_ns, taken in ((16, PERIOD_NS, 16), (10**6, 0, 16), (10**6, 3600 * NS, 16 + MOST_BABBLED)):
        full.room = room
        link.advance(pause_ns)
        assert faulty.receive_all() == []
        assert faulty.injectors[0].acted == full.taken == taken
    # Its own frame meets the full queue as any other would.
    full.room = full.taken
    with pytest.raises(BusError, match="full"):
        faulty.send(numbered(1))


def test_an_open_wire_is_silence_in_both_directions(link):
    faulty = link.wrapped(link.one, Disconnect(start_s=9.5 * PERIOD_S, end_s=19.5 * PERIOD_S))
    assert numbers(link.stream(faulty, link.other, 30)) == [*range(10), *range(20, 30)]
    assert faulty.injectors[0].acted == 10
    other = link.wrapped(link.other, Disconnect(start_s=30.5 * PERIOD_S, end_s=35.5 * PERIOD_S))
    # Frame 30 had arrived when the wire opened; 31 to 35 do not come later.
    assert numbers(link.stream(link.one, other, 10)) == [30, *range(36, 40)]


def test_a_device_that_is_gone_raises_and_comes_back(link):
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
    received = []
    for number in range(18):
        link.one.send(numbered(number))
        if number % 3 == 2:
            link.advance()
            received.append([number_of(frame) for frame in faulty.receive_all()])
    # In the queue: 0 1 2; then 1 2 3 4 5; then 2 3 4 5 6 without 7 and 8; then 3 4 5 6 9 without 10 and 11.
    assert received == [[0], [1], [2], [3], [4, 5, 6, 9, 12, 13, 14], [15, 16, 17]]
    assert faulty.injectors[0].acted == 4


def test_the_clock_shows_what_its_drift_and_offset_make_of_the_time():
    late = {"ppm": 50.0, "start_s": 100.0}
    for fault, true_ns, gained_ns in [
        (ClockDrift(ppm=100.0), 1000 * NS, NS // 10),
        (ClockDrift(ppm=-100.0), 1000 * NS, -NS // 10),
        (ClockDrift(offset_s=0.25), 7, NS // 4),
        (ClockDrift(offset_s=-1.0), NS // 2, -NS // 2),
        (ClockDrift(**late), 99 * NS, 0),
        (ClockDrift(**late), 300 * NS, NS // 100),
        (ClockDrift(**late, end_s=300.0), 300 * NS, 0),
    ]:
        assert fault.local_ns(true_ns) == true_ns + gained_ns, (fault, true_ns)


def test_received_frames_bear_the_stamps_of_the_drifting_clock(link):
    fault = ClockDrift(ppm=10_000.0, offset_s=0.001, end_s=1.0)
    faulty = link.wrapped(link.other, fault)
    for _ in range(60):
        link.one.send(numbered(3, now_ns=link.now_ns))
        link.advance()
        (local,), (true,) = faulty.receive_all(), link.listener.receive_all()
        gained_ns = NS // 1000 + round(true.timestamp_ns * 0.01) if true.timestamp_ns < NS else 0
        assert abs(local.timestamp_ns - true.timestamp_ns - gained_ns) <= 1  # rounded to whole ns
        assert local.data == true.data
    assert faulty.injectors[0].acted == 50
