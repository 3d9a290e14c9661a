"""Errors on the simulated bus: what each rule of fault confinement does to nodes that share a wire, and how long it
takes, worked out in bits by hand.
"""

from dataclasses import replace

import pytest

from can_bridge.bus.interface import HEALTHY, BusState
from can_bridge.bus.simulated.medium import SimulatedBus, Transmission
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import sent_bits
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.simulated.disturbing import (
    BIT,
    DELIMITER,
    FLAG,
    FLAGS,
    INTERMISSION,
    LENGTH,
    RATES,
    SENT,
    SUSPEND,
    TO_ACKNOWLEDGE,
    Script,
    bits,
    bus_with,
    counts,
    two,
)


def test_a_destroyed_frame_is_sent_again_after_the_error_frame():
    bus, sender, receiver = two(corrupts=Script(40))
    sender.send(SENT)
    bus.advance_to(10**7)
    (received,) = receiver.receive_all()
    # Bits 0 to 40, flags, delimiter and intermission; then the frame up to its end of frame.
    assert bits(received.timestamp_ns) == 41 + FLAGS + DELIMITER + INTERMISSION + LENGTH - INTERMISSION
    assert bus.activity().error_frames == bus.activity().frames == 1
    # 8 for the error, 1 less for the success; 1, and 1 less.
    assert counts(sender, receiver) == [(7, 0), (0, 0)]
    assert bits(bus.activity().busy_ns) == 41 + FLAGS + DELIMITER + INTERMISSION + LENGTH


def test_the_counters_change_when_the_error_happens_and_not_before():
    bus, sender, receiver = two(corrupts=Script(40))
    sender.send(SENT)
    bus.advance_to(41 * BIT - 1)
    assert counts(sender, receiver) == [(0, 0), (0, 0)]
    bus.advance_to(41 * BIT)
    assert counts(sender, receiver) == [(8, 0), (0, 1)]


def test_an_error_late_in_a_can_fd_frame_is_timed_at_both_rates():
    bus = SimulatedBus(BusConfig(nominal_bitrate=500_000, data_bitrate=2_000_000), corrupts=Script(30))
    one, two = bus.port(), bus.port()
    sent = Frame(frame_id=0x155, data=b"\x55" * 8)
    one.send(sent)
    bus.advance_to(10**7)
    # 17 bits up to BRS without a stuff bit (0x155 alternates; RRS and IDE are two dominant bits), then the data phase.
    error_ns = 17 * BIT + 14 * 500 + (FLAGS + DELIMITER + INTERMISSION) * BIT
    assert two.receive_all()[0].timestamp_ns == error_ns + bus.frame_ns(sent) - INTERMISSION * BIT


def test_a_higher_priority_comes_before_the_repetition():
    seen: list[Transmission] = []
    bus = bus_with(seen, corrupts=Script(40))
    sender, receiver = bus.port("sender"), bus.port("receiver")
    sender.send(SENT)
    bus.call_at(10 * BIT, lambda: receiver.send(replace(SENT, frame_id=0x001)))
    bus.advance_to(10**7)
    assert [item.frame.frame_id for item in seen] == [0x001, 0x155]
    assert bits(seen[0].begin_ns) == 41 + FLAGS + DELIMITER + INTERMISSION


def test_a_node_alone_ends_up_error_passive_and_never_bus_off():
    """Rule 3, first exception: 16 attempts up to 128, then for ever without counting."""
    bus = SimulatedBus(RATES)
    alone = bus.port()
    alone.send(SENT)
    active = TO_ACKNOWLEDGE + FLAG + DELIMITER + INTERMISSION
    for attempt in range(1, 17):
        bus.advance_to(((attempt - 1) * active + TO_ACKNOWLEDGE) * BIT)
        assert alone.health().tx_errors == 8 * attempt
    assert alone.health().state is BusState.ERROR_PASSIVE
    bus.advance_to(10**9)
    assert counts(alone) == [(128, 0)]
    assert alone.health().state is BusState.ERROR_PASSIVE
    assert alone.health().bus_off == 0
    assert bus.activity().frames == 0
    # From then on it waits eight more bits after each attempt.
    passive = bits(10**9) // (active + SUSPEND)
    assert bus.activity().error_frames == pytest.approx(passive, abs=16)


def test_what_a_node_alone_could_not_send_goes_out_when_another_one_comes():
    bus = SimulatedBus(RATES)
    alone = bus.port()
    alone.send(SENT)
    bus.advance_to(10**8)
    other = bus.port()
    bus.advance_to(2 * 10**8)
    assert [frame.frame_id for frame in other.receive_all()] == [0x155]
    assert counts(alone) == [(127, 0)]
    assert alone.health().state is BusState.ERROR_ACTIVE


def test_an_error_passive_sender_waits_eight_bits_more_and_lets_others_go_first():
    seen: list[Transmission] = []
    bus = bus_with(seen, corrupts=Script(*[20] * 17))
    sender, other = bus.port("sender"), bus.port("other")
    sender.send(SENT)
    sender.send(SENT)
    bus.advance_to(10**7)
    assert sender.health().tx_errors == 17 * 8 - 2
    assert sender.health().state is BusState.ERROR_PASSIVE
    first, second = seen
    assert bits(second.begin_ns - first.begin_ns) == LENGTH + SUSPEND
    # Once more, with another node that has something of lower priority to say meanwhile.
    seen.clear()
    sender.send(SENT)
    sender.send(SENT)
    bus.call_at(bus.now_ns + 10 * BIT, lambda: other.send(replace(SENT, frame_id=0x7F0)))
    bus.advance_to(2 * 10**7)
    assert [item.frame.frame_id for item in seen] == [0x155, 0x7F0, 0x155]
    assert bits(seen[1].begin_ns - seen[0].begin_ns) == LENGTH
    # It has waited for another frame: no more suspension behind that one.
    assert seen[2].begin_ns == seen[1].end_ns + INTERMISSION * BIT


def test_the_suspension_counts_for_a_frame_that_is_handed_over_during_it():
    seen: list[Transmission] = []
    bus = bus_with(seen, corrupts=Script(*[20] * 17))
    sender, _ = bus.port("sender"), bus.port("other")
    sender.send(SENT)
    while not seen:
        bus.advance_to(bus.now_ns + BIT)
    assert sender.health().state is BusState.ERROR_PASSIVE
    bus.advance_to(seen[0].end_ns + 5 * BIT)
    sender.send(SENT)
    bus.advance_to(10**7)
    assert bits(seen[1].begin_ns - seen[0].end_ns) == INTERMISSION + SUSPEND


def test_a_can_fd_frame_of_an_error_passive_sender_has_its_own_length():
    """ESI recessive: from BRS to the end of length code 15 there are six equal bits, and all later runs shift."""
    seen: list[Transmission] = []
    bus = bus_with(seen, corrupts=Script(*[20] * 17))
    sender, _ = bus.port("sender"), bus.port("other")
    sent = Frame(frame_id=0x555, data=b"\xf0" * 64)
    active, passive = (sum(sent_bits(sent, error_passive=esi).total) for esi in (False, True))
    assert active != passive
    sender.send(sent)
    for _ in range(30):
        sender.send(sent)
    bus.advance_to(10**9)
    lengths = [bits(item.end_ns - item.begin_ns) + INTERMISSION for item in seen]
    # From 17 x 8 = 136 down by one with every frame: passive as long as 128 is left.
    assert lengths == [passive] * 9 + [active] * 22


def test_a_sender_that_is_always_disturbed_goes_bus_off_and_recovers():
    """32 errors of 8; then 128 times eleven recessive bits, the first of them the end of the last error frame."""
    bus, sender, receiver = two(corrupts=Script(*[20] * 32))
    sender.send(SENT)
    sender.send(SENT)
    active = 21 + FLAGS + DELIMITER + INTERMISSION
    off = 15 * active + 16 * (active + SUSPEND) + 21
    bus.advance_to(off * BIT - 1)
    assert counts(sender) == [(248, 0)]
    bus.advance_to(off * BIT)
    health = sender.health()
    assert (health.state, health.tx_errors, health.bus_off) == (BusState.BUS_OFF, 256, 1)
    assert sender.discarded == 2
    with pytest.raises(BusError, match="sender is bus-off: frame 0x155 was not sent"):
        sender.send(SENT)
    assert sender.refused == 1
    recovered = off + FLAGS + DELIMITER + INTERMISSION + 127 * 11
    bus.advance_to(recovered * BIT - 1)
    assert sender.health().state is BusState.BUS_OFF
    bus.advance_to(recovered * BIT)
    assert sender.health() == replace(HEALTHY, bus_off=1)
    sender.send(SENT)
    bus.advance_to(10**8)
    assert len(receiver.receive_all()) == 1


def test_recovery_counts_whole_sequences_between_frames():
    """Every frame comes 27 bits after the end of the one before: two sequences of eleven, and five bits for nothing."""
    bus = SimulatedBus(RATES, corrupts=Script(*[20] * 32, only="sender"))
    sender, one, _ = bus.port("sender"), bus.port("one"), bus.port("two")
    sender.send(SENT)
    while sender.health().state is not BusState.BUS_OFF:
        bus.advance_to(bus.now_ns + BIT)
    free = bits(bus.now_ns) + FLAGS + DELIMITER + INTERMISSION
    for k in range(10):
        bus.call_at((free + (k + 1) * 27 + k * LENGTH) * BIT, lambda: one.send(SENT))
    while sender.health().state is BusState.BUS_OFF:
        bus.advance_to(bus.now_ns + BIT)
    # One behind the error frame, then two and one for each of the ten frames; the rest in the idle bus.
    assert bits(bus.now_ns) == free + 10 * (27 + LENGTH) + (128 - 1 - 10 * 3) * 11


def test_a_node_that_is_bus_off_neither_hears_nor_acknowledges():
    bus = SimulatedBus(RATES, corrupts=Script(*[20] * 32, only="sender"))
    sender, other = bus.port("sender", restarts=False), bus.port("other")
    sender.send(SENT)
    bus.advance_to(10**7)
    assert sender.health().state is BusState.BUS_OFF
    other.receive_all()
    other.send(SENT)
    bus.advance_to(10**9)
    assert sender.receive_all() == []
    assert other.health().tx_errors == 128  # it is alone now
    assert sender.health().state is BusState.BUS_OFF  # it was not asked to restart
    sender.restart()
    bus.advance_to(2 * 10**9)
    assert sender.health().state is BusState.ERROR_ACTIVE
    assert [frame.frame_id for frame in sender.receive_all()] == [0x155]


def test_a_receiver_alone_with_its_error_is_blamed_for_it():
    """Rules 1 and 2: it signals before the others, which answer."""
    bus = SimulatedBus(RATES, mishears=Script(40, only="faulty"))
    sender, sound, faulty = bus.port("sender"), bus.port("sound"), bus.port("faulty")
    sender.send(SENT)
    bus.advance_to(41 * BIT)
    assert counts(sender, sound, faulty) == [(8, 0), (0, 1), (0, 9)]
    bus.advance_to(10**7)
    assert counts(sender, sound, faulty) == [(7, 0), (0, 0), (0, 8)]
    assert len(sound.receive_all()) == len(faulty.receive_all()) == 1


def test_a_receiver_that_is_always_wrong_becomes_passive_and_stops_disturbing_the_others():
    """9 up for every frame it destroys; once passive its flag is recessive."""
    bus = SimulatedBus(RATES, mishears=Script(40, repeat=True, only="faulty"))
    sender, sound, faulty = bus.port("sender"), bus.port("sound"), bus.port("faulty")
    for _ in range(10):
        sender.send(SENT)
    bus.advance_to(10**8)
    assert faulty.health().state is BusState.ERROR_PASSIVE
    assert bus.activity().error_frames == 15  # 15 x 9 = 135
    assert (len(sound.receive_all()), len(faulty.receive_all())) == (10, 0)
    assert counts(sender) == [(15 * 8 - 10, 0)]
    assert sender.health().state is BusState.ERROR_ACTIVE


def test_two_receivers_that_err_together_blame_each_other_no_more_than_the_rest():
    bus = SimulatedBus(RATES, mishears=Script(40, 40))
    sender, one, two = (bus.port(name) for name in ("sender", "one", "two"))
    sender.send(SENT)
    bus.advance_to(41 * BIT)
    # The sender answers their flags, so both see a dominant bit behind their own.
    assert counts(sender, one, two) == [(8, 0), (0, 9), (0, 9)]


def test_a_stuff_bit_of_the_identifier_that_is_overruled_counts_for_no_transmitter():
    """Rule 3, second exception. 0x001 has its first stuff bit, recessive, behind five dominant bits."""
    bus, sender, receiver = two(corrupts=Script(5))
    sender.send(replace(SENT, frame_id=0x001))
    bus.advance_to(6 * BIT)
    assert counts(sender, receiver) == [(0, 0), (0, 1)]
    bus.advance_to(10**7)
    assert len(receiver.receive_all()) == 1


def test_a_recessive_bit_of_the_identifier_that_is_overruled_is_lost_arbitration():
    """No bit error for the sender (ISO 11898-1, bit error): it counts as the receivers do."""
    bus, sender, receiver = two(corrupts=Script(2))
    assert f"{SENT.frame_id:011b}"[2 - 1] == "0"
    sender.send(replace(SENT, frame_id=0x3FF))  # bit 2 on the wire is recessive
    bus.advance_to(3 * BIT)
    assert counts(sender, receiver) == [(0, 1), (0, 1)]
    bus.advance_to(10**7)
    assert len(receiver.receive_all()) == 1


def test_a_dominant_bit_of_the_identifier_that_is_inverted_is_a_bit_error():
    bus, sender, receiver = two(corrupts=Script(1))
    sender.send(replace(SENT, frame_id=0x3FF))
    bus.advance_to(2 * BIT)
    assert counts(sender, receiver) == [(8, 0), (0, 1)]


def test_an_error_in_the_last_bit_of_the_end_of_frame_doubles_the_frame():
    """Receivers take a frame as valid at the bit before the last, the sender at the last (ISO 11898-1, validation)."""
    bus, sender, receiver = two(corrupts=Script(10_000))
    sender.send(SENT)
    bus.advance_to(10**7)
    assert [frame.data for frame in receiver.receive_all()] == [SENT.data, SENT.data]
    assert counts(sender, receiver) == [(7, 0), (0, 0)]
    # One bit earlier the receivers reject it, too.
    bus, sender, receiver = two(corrupts=Script(LENGTH - INTERMISSION - 2))
    sender.send(SENT)
    bus.advance_to(10**7)
    assert len(receiver.receive_all()) == 1
