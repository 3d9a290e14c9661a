"""A babbling node: how much it sends, and that it never stops its own node."""

import pytest

from can_bridge.bus.faults.babble import MOST_AT_ONCE, Babble, keep_babbling
from can_bridge.bus.faults.wrapping import wrap
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.faults.links import PERIOD_NS, PERIOD_S, number_of, numbered


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
    link.advance()
    assert faulty.receive_all() == []
    assert (faulty.injectors[0].acted, full.taken, faulty.injectors[0].refused) == (16, 16, 1)
    # What was not taken is not made up for once there is room again.
    full.room = 10**6
    faulty.receive_all()
    assert full.taken == 16
    # A long pause does not end in an endless burst.
    link.advance(3600 * 10**9)
    faulty.receive_all()
    assert full.taken == 16 + MOST_AT_ONCE
    # Its own frame meets the full queue as any other would.
    full.room = full.taken
    with pytest.raises(BusError, match="full"):
        faulty.send(numbered(1))


def test_on_a_bus_with_arbitration_a_babbling_node_starves_the_others():
    """Two nodes at 50 frames a second each, and a third one that babbles at the highest priority."""
    bus = SimulatedBus(BusConfig())
    one, other = bus.port(), bus.port()
    fault = Babble(start_s=9.5 * PERIOD_S, end_s=29.5 * PERIOD_S)
    babbler = wrap(bus.port(), (fault,), lambda: bus.now_ns)
    keep_babbling(babbler, bus)
    received = []
    for period in range(40):
        one.send(numbered(period))
        bus.advance_to((period + 1) * PERIOD_NS)
        received.append([number_of(frame) for frame in other.receive_all() if frame.frame_id == 0x120])
    # Up to 64 frames are still in the babbler's queue when it stops; then everything that waited gets through.
    assert received[:10] == [[k] for k in range(10)]
    assert received[10:30] == [[]] * 20
    assert [number for numbers in received[30:] for number in numbers] == list(range(10, 40))
    assert received[32:] == [[k] for k in range(32, 40)]
    # It had the bus to itself: no pause between frames of 111 to 135 bits at 2 us.
    assert 400_000_000 / 270_000 < babbler.injectors[0].acted < 400_000_000 / 222_000 + 64
