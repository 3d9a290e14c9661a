"""The bus in virtual time against arrival times worked out by hand, and properties over random traffic."""

from contextlib import suppress
from dataclasses import replace
from functools import partial
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.simulated.medium import SimulatedBus, Transmission
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import sent_bits, worst_case_ns
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.simulated.disturbing import BIT, INTERMISSION, RATES, SENT, bus_of, counts
from tests.examples import examples
from tests.refused import refused

FD_RATES = BusConfig(nominal_bitrate=500_000, data_bitrate=2_000_000)
INTERMISSION_NS = INTERMISSION * BIT


def frame(frame_id: int, data: bytes = b"\x55" * 8, **kind) -> Frame:
    return Frame(frame_id=frame_id, data=data, **kind)


def ids(frames: list[Frame]) -> list[int]:
    return [item.frame_id for item in frames]


def test_a_frame_arrives_at_its_end_of_frame_in_every_other_node():
    captured: list[Frame] = []
    bus, seen, one, two, three = bus_of("one", "two", "three", config=FD_RATES, capture=captured.append)
    sent = frame(0x120, bytes(16))
    bus.advance_to(1000)
    one.send(sent)
    end_ns = 1000 + bus.frame_ns(sent) - INTERMISSION_NS
    bus.advance_to(end_ns - 1)
    assert two.receive_all() == []
    assert bus.under_way(0x120) == 1
    bus.advance_to(end_ns)
    for port in (two, three):
        assert port.receive_all() == [replace(sent, timestamp_ns=end_ns)]
        assert port.receive_all() == []
    assert one.receive_all() == []
    assert bus.under_way(0x120) == 0
    assert captured == [replace(sent, timestamp_ns=end_ns)]
    assert [(item.sender, item.queued_ns, item.begin_ns, item.end_ns) for item in seen] == [("one", 1000, 1000, end_ns)]


def test_full_queues_refuse_and_count(monkeypatch):
    monkeypatch.setattr("can_bridge.bus.simulated.port.TRANSMIT_CAPACITY", 3)
    monkeypatch.setattr("can_bridge.bus.simulated.port.RECEIVE_CAPACITY", 2)
    bus, _, one, two = bus_of("pressure node", "", config=FD_RATES)
    for value in range(3):
        one.send(frame(0x100 + value))
    with pytest.raises(BusError, match=r"pressure node has 3 frames waiting .* frame 0x10f was not sent"):
        one.send(frame(0x10F))
    assert one.refused == 1
    bus.advance_to(10**7)
    # Who does not keep up loses the newest.
    assert ids(two.receive_all()) == [0x100, 0x101]
    one.send(frame(0x10F))  # there is room again
    bus.advance_to(2 * 10**7)
    assert ids(two.receive_all()) == [0x10F]


def test_calls_come_in_their_order_before_arbitration_and_advancing_stops_at_what_was_waited_for():
    bus, seen, one, two = bus_of("one", "two", config=FD_RATES)
    called: list[int] = []
    bus.call_at(500, lambda: called.append(2))
    bus.call_at(100, lambda: called.append(1))
    bus.call_at(500, lambda: two.send(frame(0x001)))
    bus.advance_to(499)
    assert called == [1]
    bus.advance_to(500)
    one.send(frame(0x700))
    got: list[Frame] = []

    def arrived() -> bool:
        got.extend(two.receive_all())
        return bool(got)

    assert bus.advance_until(10**6, arrived)
    assert (called, [item.frame.frame_id for item in seen]) == ([1, 2], [0x001, 0x700])
    assert bus.now_ns == got[0].timestamp_ns == 500 + bus.frame_ns(frame(1)) + bus.frame_ns(got[0]) - INTERMISSION_NS
    assert not bus.advance_until(10**6, lambda: False)
    for late, words in ((lambda: bus.call_at(5, arrived), "call at 5"), (lambda: bus.advance_to(9), "advance to 9")):
        with refused(ValueError, f"cannot {words} ns: the bus is at 1000000 ns"):
            late()


TRAFFIC = st.lists(
    st.tuples(
        st.integers(0, 3),  # node
        st.integers(0, 3_000_000),  # time, ns
        st.integers(0, 0x7FF),
        st.sampled_from([0, 1, 8, 16, 64]),
    ),
    max_size=30,
    unique_by=lambda item: item[2],
)


@examples(30)
@given(traffic=TRAFFIC, step=st.sampled_from([1_777, 50_000, 10**7]))
def test_arbitration_on_random_traffic(traffic, step):
    """Against the definition: at every begin nothing of higher priority waits, the bus is never left free, and no two
    frames overlap. The steps in which time advances change nothing.
    """
    bus, seen, *ports = bus_of(*"abcd", config=FD_RATES)
    for node, at_ns, frame_id, length in traffic:
        sent = frame(frame_id, bytes(length))
        bus.call_at(at_ns, partial(ports[node].send, sent))
    for t_ns in range(0, 20_000_001, step):
        bus.advance_to(t_ns)
    bus.advance_to(20_000_000)
    assert sorted(item.frame.frame_id for item in seen) == sorted(item[2] for item in traffic)
    free_ns = 0
    for k, item in enumerate(seen):
        assert item.begin_ns >= max(free_ns, item.queued_ns)
        waiting = [later for later in seen[k:] if later.queued_ns <= item.begin_ns]
        assert item.frame.frame_id == min(other.frame.frame_id for other in waiting)
        assert item.begin_ns == max(free_ns, min(later.queued_ns for later in seen[k:]))
        plain = replace(item.frame, timestamp_ns=0)
        free_ns = item.begin_ns + bus.frame_ns(plain)
        assert item.end_ns == free_ns - INTERMISSION_NS
        assert bus.frame_ns(plain) <= worst_case_ns(plain, nominal_bitrate=500_000, data_bitrate=2_000_000)


DOUBLED = ("one", "other", "listener")
"""Two nodes with the same identifier, and one that listens."""


def test_two_nodes_that_send_the_same_frame_at_once_do_not_notice():
    bus, seen, one, other, listener = bus_of(*DOUBLED)
    one.send(SENT)
    other.send(SENT)
    bus.advance_to(10**7)
    assert len(listener.receive_all()) == 1
    assert {item.sender for item in seen} == {"one", "other"}
    assert bus.activity().frames == 1
    assert counts(one, other, listener) == [(0, 0)] * 3
    assert one.receive_all() == other.receive_all() == []


def test_a_doubled_identifier_shows_as_bit_errors_in_both():
    bus, seen, one, other, listener = bus_of(*DOUBLED)
    one.send(SENT)
    other.send(replace(SENT, data=b"\x55\x55\x55\x57"))  # differs in bit 1 of the last byte
    differs = 1 + 11 + 3 + 4 + 3 * 8 + 6
    bus.advance_to(differs * BIT)
    assert counts(one, other, listener) == [(0, 0)] * 3
    bus.advance_to((differs + 1) * BIT)
    assert counts(one, other, listener) == [(8, 0), (8, 0), (0, 1)]
    assert bus.activity().error_frames == 1
    bus.advance_to(10**8)
    # Sixteen times both, then the one that sends the recessive bit is too passive to destroy the other's frame.
    assert [item.sender for item in seen] == ["one", "other"]
    assert bus.activity().error_frames == 16
    assert counts(one, other) == [(127, 0), (128 + 8 - 1, 0)]


@examples(30)
@given(seed=st.integers(0, 2**32), share=st.floats(0.0, 0.3), rates=st.sampled_from([RATES, BusConfig()]))
def test_whatever_is_disturbed_every_frame_arrives_once_in_order_or_is_counted(seed, share, rates):
    """Random disturbances of the bus and of single receivers, in any bit but the very last."""
    random = Random(seed)

    def wrong(frame: Frame, name: str, begin_ns: int) -> int | None:
        return random.randrange(sum(sent_bits(frame).total) - INTERMISSION - 1) if random.random() < share else None

    seen: list[Transmission] = []
    bus = SimulatedBus(rates, observe=seen.append, corrupts=wrong, mishears=wrong)
    ports = [bus.port(f"node {k}") for k in range(3)]
    handed_over, heard = [list[bytes]() for _ in ports], [list[Frame]() for _ in ports]
    for k in range(61):
        sender, data = random.randrange(3), bytes([k])
        if k < 60:
            with suppress(BusError):
                ports[sender].send(Frame(frame_id=0x100 + sender, data=data, is_fd=random.random() < 0.5))
                handed_over[sender].append(data)
        bus.advance_to(bus.now_ns + (random.randrange(600_000) if k < 60 else 10**10))
        for port, frames in zip(ports, heard, strict=True):
            frames.extend(port.receive_all())
    for k, port in enumerate(ports):
        sent = [item.frame.data for item in seen if item.sender == port.name]
        assert len(sent) + port.discarded == len(handed_over[k])
        assert [data for data in handed_over[k] if data in sent] == sent
        # Some receivers miss some: they were bus-off, or heard it wrong and were too passive to signal it.
        for other, frames in zip(ports, heard, strict=True):
            if other is not port:
                got = [frame.data for frame in frames if frame.frame_id == 0x100 + k]
                assert [data for data in sent if data in got] == got
                assert share > 0.0 or got == sent
    ends = [item.end_ns for item in seen]
    assert ends == sorted(set(ends))
    activity = bus.activity()
    assert activity.frames == len(seen)
    assert activity.busy_ns <= activity.now_ns
    assert share > 0.0 or activity.error_frames == 0
