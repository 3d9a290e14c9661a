"""Wrong data: on the wire, behind the end-to-end protection and ahead of it, and a node that is stuck."""

from dataclasses import replace
from itertools import product
from typing import Literal

from can_bridge.bus.faults.frame_faults import FlipBits, StuckAt, WireErrors, payload_bits
from can_bridge.e2e.profiles import PROFILE_5, profile_of
from can_bridge.e2e.sender import E2eSender, SenderState, protected_frame
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import sent_bits
from can_bridge.wire.message_specs import PRESSURE, PRESSURE_SECURED, SPECS
from contract.errors import BusError
from tests.can_bridge.bus.faults.links import PERIOD_S, number_of, numbered, simulated_link
from tests.refused import refused

FRAME = Frame(frame_id=0x555, data=bytes([0x55] * 8), is_fd=False)
BITS = sum(sent_bits(FRAME).total) - 3
OURS = [spec for spec in SPECS if not spec.is_secured]


def test_so_many_different_bits_flip_behind_the_protection_in_the_span_on_either_side():
    sides: tuple[Literal["send", "receive"], ...] = ("send", "receive")
    for bits, at in product((1, 2, 3, 64), sides):
        link = simulated_link()
        fault = FlipBits(bits=bits, at=at, start_s=2.5 * PERIOD_S, end_s=6.5 * PERIOD_S)
        faulty = link.wrapped(link.one if at == "send" else link.other, fault)
        sender, receiver = (faulty, link.other) if at == "send" else (link.one, faulty)
        received = link.stream(sender, receiver, 10)
        flipped = [(number_of(frames[0]) ^ number).bit_count() for number, frames in enumerate(received)]
        assert flipped == [0] * 3 + [bits] * 4 + [0] * 3, (bits, at)


def test_every_message_of_ours_can_be_wrong_and_protected():
    for spec in OURS:
        profile = profile_of(spec)
        # The header's bits are laid out by the standard: 12 of profile 2, the CRC-8 first; 24 of profile 5.
        header = 0xFFF if spec.profile == 2 else 0xFFFFFF
        for bits in (1, 7, len(payload_bits(spec))):
            right = protected_frame(SenderState(counter=5), bytes(range(spec.protected)), spec=spec, now_ns=0)
            link = simulated_link()
            link.wrapped(link.one, FlipBits(bits=bits, before_crc=True)).send(right)
            link.advance()
            (wrong,) = link.other.receive_all()
            assert profile.check(wrong.data, data_id=spec.data_id), spec
            assert profile.counter_of(wrong.data) == 5, spec
            differ = int.from_bytes(right.data, "little") ^ int.from_bytes(wrong.data, "little")
            assert (differ & ~header).bit_count() == bits, (spec, bits)


def test_ahead_of_the_protection_others_pass_and_what_would_need_the_key_is_refused():
    for fault in (FlipBits(before_crc=True), StuckAt(counter_runs=True)):
        link = simulated_link()
        faulty = link.wrapped(link.one, fault)
        for number, frame_id in ((1, 0x7E0), (2, 0x7E0), (3, PRESSURE.frame_id)):
            faulty.send(numbered(number, frame_id=frame_id))
            link.advance()
        assert [number_of(frame) for frame in link.other.receive_all()] == [1, 2, 3], fault
        assert faulty.injectors[0].acted == 0, fault
        frame = Frame(frame_id=PRESSURE_SECURED.frame_id, data=bytes(PRESSURE_SECURED.length))
        with refused(BusError, r"PressureSecured is authenticated: .* would need the key"):
            faulty.send(frame)


def test_a_frozen_node_sends_the_first_frame_of_the_span_or_its_message_with_a_counter_that_runs():
    for runs in (False, True):
        link = simulated_link()
        fault = StuckAt(counter_runs=runs, start_s=2.5 * PERIOD_S, end_s=6.5 * PERIOD_S)
        faulty, sender = link.wrapped(link.one, fault), E2eSender(PRESSURE)
        sent, received = [], []
        for step in range(10):
            sent.append(sender.frame(bytes([step]) * PRESSURE.protected, now_ns=link.now_ns).data)
            faulty.send(replace(FRAME, frame_id=PRESSURE.frame_id, data=sent[-1], is_fd=True))
            link.advance()
            received += [frame.data for frame in link.other.receive_all()]
        frozen = [3 if 3 <= step <= 6 else step for step in range(10)]
        if not runs:
            assert received == [sent[step] for step in frozen]
            continue
        assert [data[3:] for data in received] == [sent[step][3:] for step in frozen]
        assert all(PROFILE_5.check(data, data_id=PRESSURE.data_id) for data in received)
        assert [data[2] for data in received] == list(range(10))


def test_frames_are_hit_as_often_as_independent_bits_make_them():
    for rate in [1e-4, 1e-2, 0.5]:
        hook = WireErrors(bit_error_rate=rate).hook(1)
        n = 2_000
        places = [place for _ in range(n) if (place := hook(FRAME, "any", 0)) is not None]
        hit = 1 - (1 - rate) ** BITS
        # Five standard deviations of a binomial number.
        assert abs(len(places) - n * hit) < 5 * (n * hit * (1 - hit)) ** 0.5 + 1e-9, rate
        assert 0 <= min(places) <= max(places) < BITS, rate
        # Place k is first with (1 - rate)^k rate: the mean over a frame that is hit, by summation.
        law = [(1 - rate) ** k * rate / hit for k in range(BITS)]
        mean = sum(k * p for k, p in enumerate(law))
        spread = sum((k - mean) ** 2 * p for k, p in enumerate(law)) ** 0.5
        assert abs(sum(places) / len(places) - mean) < 5 * spread / len(places) ** 0.5, rate


def test_only_the_named_nodes_and_frames_are_hit_in_the_span():
    hook = WireErrors(bit_error_rate=1.0, nodes=("ecu",), frame_ids=(0x555,), start_s=1.0, end_s=2.0).hook(1)
    hit = [hook(FRAME, "ecu", at) for at in (999_999_999, 10**9, 2 * 10**9 - 1, 2 * 10**9)]
    assert hit == [None, 0, 0, None]
    assert hook(FRAME, "vehicle", 10**9) is None
    assert hook(Frame(frame_id=0x120, data=b""), "ecu", 10**9) is None
