"""The bus in virtual time against arrival times worked out by hand."""

import pytest

from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated import SimulatedBus
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig

RATES = BusConfig(nominal_bitrate=500_000, data_bitrate=2_000_000)
# 16 bytes on CAN FD at worst: 34 bits at 500 kbit/s, 193 bits at 2 Mbit/s (test_bit_timing.py has the count).
LONG = Frame(frame_id=0x120, data=bytes(16))
LONG_NS = 34 * 2000 + 193 * 500
SHORT = Frame(frame_id=0x130, data=bytes(8))


@pytest.fixture
def captured() -> list[Frame]:
    return []


@pytest.fixture
def bus(captured) -> SimulatedBus:
    return SimulatedBus(RATES, captured.append)


def times(frames: list[Frame]) -> list[tuple[int, int]]:
    return [(frame.timestamp_ns, frame.frame_id) for frame in frames]


def test_a_frame_arrives_when_its_bits_are_through(bus):
    assert bus.frame_ns(LONG) == LONG_NS
    one, two, three = (bus.port() for _ in range(3))
    bus.advance_to(1000)
    one.send(LONG)
    bus.advance_to(1000 + LONG_NS - 1)
    assert two.receive_all() == []
    bus.advance_to(1000 + LONG_NS)
    for port in (two, three):
        assert times(port.receive_all()) == [(1000, 0x120)]
        assert port.receive_all() == []
    assert one.receive_all() == []


def test_nothing_changes_a_frame_but_its_time(bus):
    one, two = bus.port(), bus.port()
    sent = Frame(frame_id=0x7FF, data=b"\x01\x02", timestamp_ns=999, is_fd=False)
    one.send(sent)
    bus.advance_to(10**6)
    assert two.receive_all() == [Frame(frame_id=0x7FF, data=b"\x01\x02", timestamp_ns=0, is_fd=False)]


def test_a_nodes_frames_follow_each_other(bus, captured):
    one, two = bus.port(), bus.port()
    for _ in range(3):
        one.send(LONG)
    bus.advance_to(10 * LONG_NS)
    one.send(SHORT)
    bus.advance_to(20 * LONG_NS)
    expected = [(0, 0x120), (LONG_NS, 0x120), (2 * LONG_NS, 0x120), (10 * LONG_NS, 0x130)]
    assert times(two.receive_all()) == times(captured) == expected


def test_nodes_do_not_wait_for_each_other(bus):
    one, two = bus.port(), bus.port()
    one.send(LONG)
    bus.advance_to(LONG_NS // 2)
    two.send(SHORT)
    bus.advance_to(LONG_NS // 2 + bus.frame_ns(SHORT))
    assert times(one.receive_all()) == [(LONG_NS // 2, 0x130)]


def test_frames_are_captured_in_the_order_they_begin_in_and_then_by_identifier(bus, captured):
    one, two, three = (bus.port() for _ in range(3))
    three.send(SHORT)
    two.send(LONG)
    one.send(SHORT)
    bus.advance_to(0)
    assert times(captured) == [(0, 0x120), (0, 0x130), (0, 0x130)]
    bus.advance_to(10**6)
    # Two of three each: a node does not hear itself. The short frames arrive first.
    assert times(one.receive_all()) == [(0, 0x130), (0, 0x120)]
    assert times(two.receive_all()) == [(0, 0x130), (0, 0x130)]


def test_what_has_not_arrived_is_under_way(bus):
    one, _ = bus.port(), bus.port()
    one.send(LONG)
    one.send(LONG)
    one.send(SHORT)
    assert (bus.under_way(0x120), bus.under_way(0x130)) == (2, 1)
    bus.advance_to(LONG_NS)
    assert bus.under_way(0x120) == 1
    bus.advance_to(10 * LONG_NS)
    assert (bus.under_way(0x120), bus.under_way(0x130)) == (0, 0)


def test_one_long_advance_delivers_what_many_short_ones_do():
    received = []
    for step in (1000, 7919, 10**6):
        bus = SimulatedBus(RATES)
        one, two = bus.port(), bus.port()
        for frame in (LONG, SHORT, LONG):
            one.send(frame)
        for t in range(0, 10**6 + 1, step):
            bus.advance_to(t)
        received.append(times(two.receive_all()))
    assert received[0] == received[1] == received[2]
    assert len(received[0]) == 3


def test_time_does_not_run_backwards(bus):
    bus.advance_to(10)
    with pytest.raises(ValueError, match="cannot advance to 9 ns: the bus is at 10 ns"):
        bus.advance_to(9)


def test_a_port_is_a_bus(bus):
    port: Bus = bus.port()
    assert port.receive_all() == []
