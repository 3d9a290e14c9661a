"""Errors on the simulated bus: what each rule of fault confinement does to nodes, and how long, by hand in bits."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from can_bridge.bus.interface import HEALTHY, BusHealth, BusState
from can_bridge.bus.simulated.attempt import AttemptVerdict, counted
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import sent_bits
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.simulated.disturbing import BIT, INTERMISSION, SENT, bus_of, counts

FLAGS, FLAG, DELIMITER, SUSPEND = 12, 6, 8, 8
LENGTH = sent_bits(SENT).total[0]
TO_ACKNOWLEDGE = LENGTH - INTERMISSION - 7 - 1
"""Bits up to and including the acknowledge slot."""
ACTIVE, PASSIVE, OFF = BusState.ERROR_ACTIVE, BusState.ERROR_PASSIVE, BusState.BUS_OFF


def bits(ns: int) -> int:
    assert ns % BIT == 0
    return ns // BIT


def script(*positions: int, only: str = "") -> Callable[[Frame, str, int], int | None]:
    """A disturbance of the first so many attempts, of those of one node if it is named."""
    left = list(positions)
    return lambda frame, name, begin_ns: left.pop(0) if left and only in ("", name) else None


def at(tx_errors: int, rx_errors: int) -> BusHealth:
    state = PASSIVE if max(tx_errors, rx_errors) >= 128 else ACTIVE
    return BusHealth(state=state, tx_errors=tx_errors, rx_errors=rx_errors)


def test_each_verdict_counts_by_its_rules_and_a_node_is_passive_from_128_and_off_from_256_on():
    changes: dict[AttemptVerdict, list[tuple[tuple[int, int], tuple[int, int]]]] = {
        AttemptVerdict.RECEIVE_ERROR: [((5, 7), (5, 8)), ((0, 127), (0, 128))],
        # The register has eight bits.
        AttemptVerdict.SIGNALLED_FIRST: [((0, 0), (0, 9)), ((0, 250), (0, 255))],
        AttemptVerdict.TRANSMIT_ERROR: [((5, 7), (13, 7)), ((120, 0), (128, 0)), ((247, 0), (255, 0))],
        AttemptVerdict.ARBITRATION_STUFF: [((5, 7), (5, 7))],
        AttemptVerdict.UNACKNOWLEDGED: [((tx, 0), (tx + 8 if tx < 128 else tx, 0)) for tx in (0, 120, 127, 128, 255)],
        AttemptVerdict.SENT: [((tx, 3), (max(tx - 1, 0), 3)) for tx in (0, 1, 8, 128, 255)],
        # The standard allows 119 to 127 after an error-passive receiver's success.
        AttemptVerdict.HEARD: [((3, rx), (3, min(max(rx - 1, 0), 127))) for rx in (0, 1, 127, 128, 129, 135, 255)],
    }
    for verdict, before, after in ((verdict, *each) for verdict, some in changes.items() for each in some):
        assert counted(at(*before), verdict) == at(*after), (verdict, before)
    off = counted(at(248, 90), AttemptVerdict.TRANSMIT_ERROR)
    assert off == BusHealth(state=OFF, tx_errors=256, rx_errors=90, bus_off=1)
    # It stays off whatever happens, and counts once.
    for verdict in (AttemptVerdict.SENT, AttemptVerdict.HEARD, AttemptVerdict.TRANSMIT_ERROR):
        off = counted(off, verdict)
        assert (off.state, off.bus_off) == (OFF, 1), verdict


def test_a_destroyed_frame_is_sent_again_after_the_error_frame():
    bus, seen, sender, receiver = bus_of("sender", "receiver", corrupts=script(40))
    sender.send(SENT)
    bus.advance_to(41 * BIT - 1)
    assert counts(sender, receiver) == [(0, 0), (0, 0)]
    bus.advance_to(41 * BIT)
    assert counts(sender, receiver) == [(8, 0), (0, 1)]
    bus.advance_to(10**7)
    (received,) = receiver.receive_all()
    # Bits 0 to 40, flags, delimiter and intermission; then the frame up to its end of frame.
    again = 41 + FLAGS + DELIMITER + INTERMISSION
    assert bits(received.timestamp_ns) == again + LENGTH - INTERMISSION
    assert bus.activity().error_frames == bus.activity().frames == 1
    assert bits(bus.activity().busy_ns) == again + LENGTH
    assert bus.activity().load == (again + LENGTH) * BIT / 10**7
    # 8 for the error, 1 less for the success; 1, and 1 less.
    assert counts(sender, receiver) == [(7, 0), (0, 0)]
    # A higher priority comes before the repetition.
    bus, seen, sender, receiver = bus_of("sender", "receiver", corrupts=script(40))
    sender.send(SENT)
    bus.call_at(10 * BIT, lambda: receiver.send(replace(SENT, frame_id=0x001)))
    bus.advance_to(10**7)
    assert [item.frame.frame_id for item in seen] == [0x001, 0x155]
    assert bits(seen[0].begin_ns) == again


def test_an_error_late_in_a_can_fd_frame_is_timed_at_both_rates():
    bus = SimulatedBus(BusConfig(nominal_bitrate=500_000, data_bitrate=2_000_000), corrupts=script(30))
    one, two, sent = bus.port(), bus.port(), Frame(frame_id=0x155, data=b"\x55" * 8)
    one.send(sent)
    bus.advance_to(10**7)
    # 17 bits up to BRS without a stuff bit (0x155 alternates; RRS and IDE are two dominant bits), then the data phase.
    error_ns = 17 * BIT + 14 * 500 + (FLAGS + DELIMITER + INTERMISSION) * BIT
    assert two.receive_all()[0].timestamp_ns == error_ns + bus.frame_ns(sent) - INTERMISSION * BIT


def test_a_node_alone_ends_up_error_passive_and_never_bus_off():
    """Rule 3, first exception: 16 attempts up to 128, then for ever without counting."""
    bus, _, alone = bus_of("alone")
    alone.send(SENT)
    active = TO_ACKNOWLEDGE + FLAG + DELIMITER + INTERMISSION
    for attempt in range(1, 17):
        bus.advance_to(((attempt - 1) * active + TO_ACKNOWLEDGE) * BIT)
        assert alone.health().tx_errors == 8 * attempt
    bus.advance_to(10**8)
    assert counts(alone) == [(128, 0)]
    assert (alone.health().state, alone.health().bus_off, bus.activity().frames) == (PASSIVE, 0, 0)
    # From then on it waits eight more bits after each attempt.
    passive = bits(10**8) // (active + SUSPEND)
    assert bus.activity().error_frames == pytest.approx(passive, abs=16)
    # What it could not send goes out when another one comes.
    other = bus.port()
    bus.advance_to(2 * 10**8)
    assert [frame.frame_id for frame in other.receive_all()] == [0x155]
    assert (counts(alone), alone.health().state) == ([(127, 0)], ACTIVE)


def test_an_error_passive_sender_waits_eight_bits_more_and_lets_others_go_first():
    bus, seen, sender, other = bus_of("sender", "other", corrupts=script(*[20] * 17))
    sender.send(SENT)
    sender.send(SENT)
    bus.advance_to(10**7)
    assert (sender.health().tx_errors, sender.health().state) == (17 * 8 - 2, PASSIVE)
    first, second = seen
    assert bits(second.begin_ns - first.begin_ns) == LENGTH + SUSPEND
    # Another node that has something of lower priority to send meanwhile.
    seen.clear()
    sender.send(SENT)
    sender.send(SENT)
    bus.call_at(bus.now_ns + 10 * BIT, lambda: other.send(replace(SENT, frame_id=0x7F0)))
    bus.advance_to(2 * 10**7)
    assert [item.frame.frame_id for item in seen] == [0x155, 0x7F0, 0x155]
    assert bits(seen[1].begin_ns - seen[0].begin_ns) == LENGTH
    # It has waited for another frame: no more suspension behind that one.
    assert seen[2].begin_ns == seen[1].end_ns + INTERMISSION * BIT
    # A frame that is handed over during the suspension waits for its end.
    seen.clear()
    sender.send(SENT)
    bus.advance_until(10**8, lambda: bool(seen))
    bus.advance_to(seen[0].end_ns + 5 * BIT)
    sender.send(SENT)
    bus.advance_to(3 * 10**7)
    assert bits(seen[1].begin_ns - seen[0].end_ns) == INTERMISSION + SUSPEND


def test_a_can_fd_frame_of_an_error_passive_sender_has_its_own_length():
    """ESI recessive: from BRS to the end of length code 15 there are six equal bits, and all later runs shift."""
    bus, seen, sender, _ = bus_of("sender", "other", corrupts=script(*[20] * 17))
    sent = Frame(frame_id=0x555, data=b"\xf0" * 64)
    active, passive = (sum(sent_bits(sent, error_passive=esi).total) for esi in (False, True))
    assert active != passive
    for _ in range(31):
        sender.send(sent)
    bus.advance_to(10**9)
    lengths = [bits(item.end_ns - item.begin_ns) + INTERMISSION for item in seen]
    # From 17 x 8 = 136 down by one with every frame: passive as long as 128 is left.
    assert lengths == [passive] * 9 + [active] * 22


def test_a_sender_that_is_always_disturbed_goes_bus_off_and_recovers():
    """32 errors of 8; then 128 times eleven recessive bits, the first of them the end of the last error frame."""
    bus, _, sender, receiver = bus_of("sender", "receiver", corrupts=script(*[20] * 32))
    sender.send(SENT)
    sender.send(SENT)
    active = 21 + FLAGS + DELIMITER + INTERMISSION
    off = 15 * active + 16 * (active + SUSPEND) + 21
    bus.advance_to(off * BIT - 1)
    assert counts(sender) == [(248, 0)]
    bus.advance_to(off * BIT)
    assert (sender.health(), sender.discarded) == (BusHealth(state=OFF, tx_errors=256, bus_off=1), 2)
    with pytest.raises(BusError, match="sender is bus-off: frame 0x155 was not sent"):
        sender.send(SENT)
    assert sender.refused == 1
    recovered = off + FLAGS + DELIMITER + INTERMISSION + 127 * 11
    bus.advance_to(recovered * BIT - 1)
    assert sender.health().state is OFF
    bus.advance_to(recovered * BIT)
    assert sender.health() == replace(HEALTHY, bus_off=1)
    sender.send(SENT)
    bus.advance_to(10**8)
    assert len(receiver.receive_all()) == 1


def test_recovery_counts_whole_sequences_between_frames():
    """Every frame comes 27 bits after the end of the one before: two sequences of eleven, and five bits for nothing."""
    bus, _, sender, one, _ = bus_of("sender", "one", "two", corrupts=script(*[20] * 32, only="sender"))
    sender.send(SENT)
    bus.advance_until(10**8, lambda: sender.health().state is OFF)
    free = bits(bus.now_ns) + FLAGS + DELIMITER + INTERMISSION
    for k in range(10):
        bus.call_at((free + (k + 1) * 27 + k * LENGTH) * BIT, lambda: one.send(SENT))
    bus.advance_until(10**8, lambda: sender.health().state is not OFF)
    # One behind the error frame, then two and one for each of the ten frames; the rest in the idle bus.
    assert bits(bus.now_ns) == free + 10 * (27 + LENGTH) + (128 - 1 - 10 * 3) * 11


def test_a_node_that_is_bus_off_neither_hears_nor_acknowledges():
    bus, _, sender, other = bus_of("sender", "other", corrupts=script(*[20] * 32, only="sender"))
    sender.send(SENT)
    bus.advance_until(10**8, lambda: sender.health().state is OFF)
    other.send(SENT)
    bus.advance_to(bus.now_ns + 500 * BIT)
    assert (sender.health().state, sender.receive_all()) == (OFF, [])
    assert other.health().tx_errors >= 8  # it is alone now
    bus.advance_to(10**8)
    assert sender.health().state is ACTIVE
    assert [frame.frame_id for frame in sender.receive_all()] == [0x155]


def test_a_receiver_alone_with_its_error_is_blamed_for_it_until_it_no_longer_disturbs_the_others():
    """Rules 1 and 2: it signals before the others, which answer."""
    nodes = ("sender", "sound", "faulty")
    bus, _, sender, sound, faulty = bus_of(*nodes, mishears=script(40, only="faulty"))
    sender.send(SENT)
    bus.advance_to(41 * BIT)
    assert counts(sender, sound, faulty) == [(8, 0), (0, 1), (0, 9)]
    bus.advance_to(10**7)
    assert counts(sender, sound, faulty) == [(7, 0), (0, 0), (0, 8)]
    assert len(sound.receive_all()) == len(faulty.receive_all()) == 1
    # Two that err together: the sender answers their flags, so both see one behind their own. Or one errs first.
    for first, second, expected in [(40, 40, [(8, 0), (0, 9), (0, 9)]), (40, 50, [(8, 0), (0, 9), (0, 1)])]:
        bus, _, sender, one, two = bus_of(*nodes, mishears=script(first, second))
        sender.send(SENT)
        bus.advance_to(41 * BIT)
        assert counts(sender, one, two) == expected, second
    # One that is always wrong: 9 up for every frame it destroys; once passive its flag is recessive.
    bus, _, sender, sound, faulty = bus_of(*nodes, mishears=script(*[40] * 99, only="faulty"))
    for _ in range(10):
        sender.send(SENT)
    bus.advance_to(10**8)
    assert faulty.health().state is PASSIVE
    assert bus.activity().error_frames == 15  # 15 x 9 = 135
    assert (len(sound.receive_all()), len(faulty.receive_all())) == (10, 0)
    assert (counts(sender), sender.health().state) == ([(15 * 8 - 10, 0)], ACTIVE)


def test_an_inverted_bit_of_the_identifier_counts_by_what_the_sender_takes_it_for():
    for frame_id, position, expected, what in [
        # Rule 3, second exception: the first stuff bit of 0x001, recessive, is behind five dominant bits.
        (0x001, 5, (0, 0), "stuff bit"),
        # No bit error for the sender (ISO 11898-1, bit error): it counts as the receivers do.
        (0x3FF, 2, (0, 1), "recessive bit: lost arbitration"),
        (0x3FF, 1, (8, 0), "dominant bit: bit error"),
    ]:
        bus, _, sender, receiver = bus_of("sender", "receiver", corrupts=script(position))
        sender.send(replace(SENT, frame_id=frame_id))
        bus.advance_to((position + 1) * BIT)
        assert counts(sender, receiver) == [expected, (0, 1)], what
        bus.advance_to(10**7)
        assert len(receiver.receive_all()) == 1, what


def test_an_error_in_the_last_bit_of_the_end_of_frame_doubles_the_frame():
    """Receivers take a frame as valid at the bit before the last, the sender at the last (ISO 11898-1, validation)."""
    for position, copies in [(10_000, 2), (LENGTH - INTERMISSION - 2, 1)]:
        bus, _, sender, receiver = bus_of("sender", "receiver", corrupts=script(position))
        sender.send(SENT)
        bus.advance_to(10**7)
        assert [frame.data for frame in receiver.receive_all()] == [SENT.data] * copies, position
        assert counts(sender, receiver) == [(7, 0), (0, 0)], position
