"""The number of bits of a frame on the bus, with the stuff bits of its content (ISO 11898-1:2015).

After five equal bits the sender inserts a stuff bit of the opposite value, which counts as the first bit of the next
run. In classic CAN, stuff bits are inserted from the start of frame to the end of the CRC. In CAN FD they are inserted
up to the end of the data; the stuff count and the CRC have fixed stuff bits, whose number does not depend on the
content. The first fixed stuff bit always follows the data, so five equal bits at the end of the data need no further
stuff bit. `worst_case_bits` is an upper bound for all contents.
"""

import re
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from can_bridge.wire.frame import FD_LENGTHS, Frame

_RUN: Final = re.compile("0{5}|1{5}")
_RUN_INSIDE: Final = re.compile("(?:0{5}|1{5})(?=.)")


def _crc15_entry(byte: int) -> int:
    crc = byte << 7
    for _ in range(8):
        crc = (crc << 1 & 0x7FFF) ^ (0x4599 if crc >> 14 else 0)
    return crc


_CRC15: Final = tuple(map(_crc15_entry, range(256)))

TAIL: Final = 13
"""Bits after the CRC, without stuff bits: CRC delimiter, acknowledge (2), end of frame (7), intermission (3)."""


@dataclass(frozen=True, kw_only=True)
class SentBits:
    """The bits of a frame as sent.

    Attributes:
        stuffed: the part with stuff bits by content, to the CRC (CAN FD: the data); "0" dominant, "1" recessive.
        nominal: number of bits at the nominal bit rate before the tail.
        data: number of bits at the data bit rate.
    """

    stuffed: str
    nominal: int
    data: int

    @property
    def total(self) -> tuple[int, int]:
        """The number of bits at the nominal and at the data rate, from the start of frame through the intermission. BRS
        and CRC delimiter, in which the rate changes, count at the nominal rate, as in `worst_case_bits`."""
        return self.nominal + TAIL, self.data

    def through(self, position: int) -> tuple[int, int]:
        """Return the number of bits at each rate up to and including a position; the start of frame is 0."""
        before_tail = self.nominal + self.data
        fast = min(max(position + 1 - self.nominal, 0), self.data)
        return min(position + 1, self.nominal) + max(position + 1 - before_tail, 0), fast


def sent_bits(frame: Frame, *, error_passive: bool = False) -> SentBits:
    """Return the bits of a frame. In CAN FD the bit ESI shows whether the sender is error-passive."""
    if not frame.is_fd:
        head = _classic_head(frame) + _bits_of(frame.data)
        sent = stuffed(head + _to_bits(crc15(head), 15))
        return SentBits(stuffed=sent, nominal=len(sent), data=0)
    arbitration = _fd_arbitration(frame)
    rest = str(int(error_passive)) + _to_bits(FD_LENGTHS.index(len(frame.data)), 4) + _bits_of(frame.data)
    sent = stuffed(arbitration + rest, at_end=False)
    # The bit BRS follows a dominant bit, so no stuff bit comes between BRS and the first bit at the data bit rate.
    nominal = len(stuffed(arbitration))
    return SentBits(stuffed=sent, nominal=nominal, data=len(sent) - nominal + _fd_crc_bits(frame))


def frame_ns(frame: Frame, *, nominal_bitrate: int, data_bitrate: int) -> int:
    """Return the time in ns for which a frame occupies the bus, rounded up. Bit rates are in bit/s."""
    nominal, data = sent_bits(frame).total
    return bits_ns(nominal, data, nominal_bitrate=nominal_bitrate, data_bitrate=data_bitrate)


def bits_ns(nominal: int, data: int, *, nominal_bitrate: int, data_bitrate: int) -> int:
    """Return the time in ns of bits at both bit rates, rounded up."""
    # The integer expression -(-a // b) rounds up.
    return -(-(10**9) * (nominal * data_bitrate + data * nominal_bitrate) // (nominal_bitrate * data_bitrate))


def stuffed(bits: str, *, at_end: bool = True) -> str:
    """Return a sequence of "0" and "1" with its stuff bits; with `at_end`, also with a stuff bit after the last bit."""
    pattern, sent, rest = _RUN if at_end else _RUN_INSIDE, "", bits
    while run := pattern.search(rest):
        end = run.end()
        sent += rest[:end]
        rest = ("1" if rest[end - 1] == "0" else "0") + rest[end:]
    return sent + rest


def is_arbitration_stuff_bit(frame: Frame, position: int) -> bool:
    """Return whether the bit at a position is a stuff bit of the identifier (up to the bit before RTR or RRS)."""
    bits = _identifier_bits(frame)
    ends = [len(stuffed(bits[:count])) for count in range(len(bits) + 1)]
    return any(end == position + 1 and end == before + 2 for before, end in pairwise(ends))


def is_arbitration_bit(frame: Frame, position: int) -> bool:
    """Return whether another frame's dominant bit may replace a recessive bit at this position without an error."""
    return 0 < position < len(stuffed(_identifier_bits(frame)))


def crc15(bits: str) -> int:
    """Return the CRC of a classic frame over a sequence of "0" and "1" (polynomial 0x4599, start 0)."""
    crc = 0
    # Leading zeros do not change a CRC that starts at 0.
    for byte in int(bits or "0", 2).to_bytes(len(bits) // 8 + 1):
        crc = (crc << 8 & 0x7FFF) ^ _CRC15[crc >> 7 ^ byte]
    return crc


def _identifier_bits(frame: Frame) -> str:
    """Return the bits from the start of frame to the bit before RTR or RRS."""
    if frame.is_extended:
        return "0" + _to_bits(frame.frame_id >> 18, 11) + "11" + _to_bits(frame.frame_id & 0x3FFFF, 18)
    return "0" + _to_bits(frame.frame_id, 11)


def _classic_head(frame: Frame) -> str:
    """Return the bits from the start of frame to DLC; the bits before DLC are RTR, IDE (r1 with 29 bits) and r0."""
    return _identifier_bits(frame) + "000" + _to_bits(len(frame.data), 4)


def _fd_arbitration(frame: Frame) -> str:
    """Return the bits up to BRS: identifier, RRS, IDE (which a 29-bit identifier already includes), FDF, res, BRS."""
    return _identifier_bits(frame) + ("0101" if frame.is_extended else "00101")


def _to_bits(value: int, width: int) -> str:
    return format(value, f"0{width}b")


def _bits_of(data: bytes) -> str:
    # The most significant bit of each byte is sent first.
    return _to_bits(int.from_bytes(data), 8 * len(data)) if data else ""


def worst_case_bits(frame: Frame) -> tuple[int, int]:
    """Return the numbers of bits at the nominal and at the data bit rate, for the content with the most stuff bits.

    For classic CAN this is the bound of Davis, Burns, Bril and Lukkien, "Controller Area Network (CAN) schedulability
    analysis: refuted, revisited and revised", Real-Time Systems 35 (2007), equation 1. CAN FD has an equivalent bound.
    """
    payload = 8 * len(frame.data)
    if not frame.is_fd:
        sent = len(_classic_head(frame)) + payload + 15
        return sent + _most_stuff_bits(sent) + TAIL, 0
    # As many stuff bits as possible are counted in the arbitration phase, where a stuff bit takes longest.
    arbitration, esi_and_dlc = len(_fd_arbitration(frame)), 5
    early = _most_stuff_bits(arbitration)
    late = _most_stuff_bits(arbitration + esi_and_dlc + payload) - early
    return arbitration + early + TAIL, esi_and_dlc + payload + late + _fd_crc_bits(frame)


def worst_case_ns(frame: Frame, *, nominal_bitrate: int, data_bitrate: int) -> int:
    """Return the longest time in ns for which a frame of this format and length occupies the bus. See `frame_ns`."""
    nominal, data = worst_case_bits(frame)
    return bits_ns(nominal, data, nominal_bitrate=nominal_bitrate, data_bitrate=data_bitrate)


def _most_stuff_bits(bits: int) -> int:
    """Return the largest number of stuff bits for `bits` bits: one after the first five, then one after every four."""
    return (bits - 1) // 4


def _fd_crc_bits(frame: Frame) -> int:
    """Return the number of bits of the stuff count with parity, the CRC-17 or CRC-21, and their fixed stuff bits."""
    return 4 + 17 + 6 if len(frame.data) <= 16 else 4 + 21 + 7
