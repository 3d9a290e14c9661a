"""Two nodes with one identifier, a bus that is held dominant, and disturbances at random."""

from contextlib import suppress
from dataclasses import replace
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.simulated.medium import SimulatedBus, Transmission
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_bits
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.simulated.disturbing import BIT, INTERMISSION, RATES, SENT, bus_of, counts
from tests.examples import examples

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
        return random.randrange(sum(frame_bits(frame)) - INTERMISSION - 1) if random.random() < share else None

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
