"""Exact lengths and bounds against published numbers and a plain bit-by-bit construction."""

from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire import frame_bits
from can_bridge.wire.frame import FD_LENGTHS, Frame, priority
from can_bridge.wire.frame_bits import is_arbitration_stuff_bit, sent_bits, stuffed, worst_case_bits
from tests.can_bridge.can_messages import frames
from tests.refused import refused


def header(frame: Frame) -> str:
    """Start of frame to the bit before the length code, field by field (ISO 11898-1:2015, frame formats)."""
    if frame.is_extended:
        # RRS, FDF, res, BRS, ESI; or RTR, r1, r0.
        end = "01010" if frame.is_fd else "000"
        return f"0{frame.frame_id >> 18:011b}11{frame.frame_id & 0x3FFFF:018b}{end}"
    # RRS, IDE, FDF, res, BRS, ESI; or RTR, IDE, r0.
    return f"0{frame.frame_id:011b}{'001010' if frame.is_fd else '000'}"


def content(frame: Frame) -> str:
    return f"{FD_LENGTHS.index(len(frame.data)):04b}" + "".join(f"{byte:08b}" for byte in frame.data)


def on_the_wire(body: str) -> tuple[str, list[int]]:
    """The bits as sent, and the places of those that are no stuff bits; a stuff bit due at the end is sent."""
    sent, plain = "", list[int]()
    for bit in body:
        plain.append(len(sent))
        sent += bit
        if sent[-5:] in ("00000", "11111"):
            sent += "1" if bit == "0" else "0"
    return sent, plain


def crc_by_division(body: str) -> int:
    """The remainder of the polynomial division, in whole numbers."""
    rest = int(body, 2) << 15
    while rest.bit_length() > 15:
        rest ^= 0xC599 << (rest.bit_length() - 16)
    return rest


@given(frame=frames(st.just(False)))
def test_a_classic_frame_has_the_bits_of_its_fields(frame):
    body = header(frame) + content(frame)
    sent, _ = on_the_wire(f"{body}{crc_by_division(body):015b}")
    assert sent_bits(frame).stuffed == sent
    # CRC delimiter, acknowledge, its delimiter, end of frame, intermission.
    assert sent_bits(frame).total == (len(sent) + 1 + 1 + 1 + 7 + 3, 0)
    assert sent_bits(frame, error_passive=True) == sent_bits(frame)


@given(frame=frames(st.just(True)), passive=st.booleans())
def test_a_can_fd_frame_has_the_bits_of_its_fields(frame, passive):
    before = header(frame)[:-1] + str(int(passive))
    sent, plain = on_the_wire(before + content(frame))
    sent = sent[: plain[-1] + 1]  # the fixed stuff bit before the stuff count stands there anyway
    switch = plain[len(before) - 1]  # ESI is the first bit at the data bit rate
    crc = 17 if len(frame.data) <= 16 else 21
    fixed = -(-(4 + crc) // 4)  # before the stuff count, then after every fourth bit of stuff count and CRC
    assert sent_bits(frame, error_passive=passive).stuffed == sent
    total = switch + 1 + 2 + 7 + 3, len(sent) - switch + 4 + crc + fixed
    assert sent_bits(frame, error_passive=passive).total == total


def test_the_published_worst_case_of_stuffing_and_check_value():
    """Figure 1 of Davis et al. (2007): five bits, then runs of four, each of which a stuff bit makes five."""
    body = "111110000111100001111"
    assert stuffed(body) == "11111000001111100000111110"
    assert len(stuffed(body)) - len(body) == (len(body) - 1) // 4
    # The check value of CRC-15/CAN in the RevEng catalogue.
    assert frame_bits.crc15("".join(format(byte, "08b") for byte in b"123456789")) == 0x059E


def test_every_stuff_bit_in_the_identifier_is_known():
    # Start of frame and ten zeros: stuff bits after the 5th and, with the first of them ending a run, the 10th bit.
    frame = Frame(frame_id=0x001, data=b"")
    assert sent_bits(frame).stuffed.startswith("00000100000101")
    assert [k for k in range(20) if is_arbitration_stuff_bit(frame, k)] == [5, 11]
    assert [k for k in range(20) if frame_bits.is_arbitration_bit(frame, k)] == list(range(1, 14))
    assert not any(is_arbitration_stuff_bit(Frame(frame_id=0x555, data=b""), k) for k in range(40))


@given(frame=frames())
def test_every_bit_is_counted_once_and_in_order_and_not_more_than_the_bound(frame):
    sent = sent_bits(frame)
    assert sent.through(0) == (1, 0)
    counts = [sent.through(k) for k in range(sum(sent.total))]
    assert [sum(count) for count in counts] == list(range(1, sum(sent.total) + 1))
    assert counts[-1] == sent.total
    assert all(a <= b and c <= d for (a, c), (b, d) in pairwise(counts))
    most = worst_case_bits(frame)
    assert sent.total[0] <= most[0] and sum(sent.total) <= sum(most)


@given(one=frames(), other=frames(), meet=st.booleans())
def test_the_smaller_priority_is_the_one_whose_bits_win(one, other, meet):
    """The dominant one, 0, prevails at the first bit in which two frames with stuff bits differ."""
    if meet:  # in their first 11 bits
        base = priority(one)[0]
        other = replace(other, frame_id=base << 18 | other.frame_id & 0x3FFFF if other.is_extended else base)
    if priority(one) != priority(other):
        assert (priority(one) < priority(other)) == (sent_bits(one).stuffed < sent_bits(other).stuffed)
    else:
        assert one.identifier == other.identifier


def test_times_are_the_bits_at_their_rates_rounded_up():
    assert frame_bits.bits_ns(4, 2, nominal_bitrate=500_000, data_bitrate=2_000_000) == 4 * 2000 + 2 * 500
    assert frame_bits.bits_ns(1, 0, nominal_bitrate=3, data_bitrate=1) == 333_333_334


def test_the_classic_bound_is_the_published_one_and_that_of_can_fd_is_a_sum_by_hand():
    """55 + 10 n bits for 11-bit identifiers (Davis et al. 2007)."""
    for length, bits in ((0, 55), (1, 65), (4, 95), (8, 135)):
        assert worst_case_bits(Frame(frame_id=1, data=bytes(length), is_fd=False)) == (bits, 0), length
    # ESI and DLC, data, stuff bits after the 4 charged to the arbitration phase, CRC field.
    sums = {0: 5 + 0 + 1 + 27, 16: 5 + 128 + 33 + 27, 20: 5 + 160 + 41 + 32, 64: 5 + 512 + 129 + 32}
    for length, data_bits in sums.items():
        assert worst_case_bits(Frame(frame_id=1, data=bytes(length))) == (17 + 4 + 13, data_bits), length


def test_exists_only_if_a_controller_could_send_it():
    # Lengths of a CAN FD length code, ISO 11898-1: written out once more on purpose.
    for is_fd, lengths in ((False, {*range(9)}), (True, {*range(9), 12, 16, 20, 24, 32, 48, 64})):
        for length in range(70):
            with nullcontext() if length in lengths else refused(ValueError, f"frame of {length} bytes"):
                Frame(frame_id=1, data=bytes(length), is_fd=is_fd)
    wrong: list[tuple[dict[str, Any], str]] = [
        *(({"frame_id": -1}, "frame id -0x1"), ({"frame_id": 0x800}, "0x800"), ({"timestamp_ns": -1}, "timestamp -1")),
        *(({"frame_id": 0x20000000, "is_extended": True}, "0x20000000"), ({"data": bytearray(8)}, "bytearray")),
    ]
    for fields, culprit in wrong:
        with refused(ValueError, culprit):
            Frame(**{"frame_id": 1, "data": b"", **fields})
