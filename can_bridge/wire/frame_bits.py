"""How many bits a frame has on the wire, its stuff bits counted from its content (ISO 11898-1:2015).

A stuff bit of the other value follows five equal bits and counts as the first of the next run. Classic CAN stuffs from
the start of frame to the end of the CRC. CAN FD stuffs so to the end of the data only; its stuff count and CRC carry
fixed stuff bits, as many for every content. `can_bridge.wire.bit_timing` bounds the same lengths for all contents.
"""

from typing import Final

from can_bridge.wire.frame import FD_LENGTHS, Frame

_RUN: Final = 5
_CRC15: Final = 0x4599

TAIL: Final = 13
"""CRC delimiter, acknowledge and its delimiter, end of frame (7), intermission (3); never stuffed."""
FD_CRC_SHORT: Final = 4 + 17 + 6
"""Stuff count with parity, CRC-17, fixed stuff bits: up to 16 data bytes."""
FD_CRC_LONG: Final = 4 + 21 + 7
"""The same with CRC-21, for more than 16."""
FD_LONGEST_SHORT: Final = 16


def frame_bits(frame: Frame) -> tuple[int, int]:
    """Bits at the nominal and at the data bit rate, from the start of frame to the end of the intermission.

    An FD frame changes its rate at the sample points of BRS and of the CRC delimiter; both bits are counted at the
    nominal rate as a whole, as the bound does.
    """
    if not frame.is_fd:
        head = _classic_head(frame) + _bits_of(frame.data)
        stuffed = head + _to_bits(crc15(head), 15)
        return len(stuffed) + stuff_bits(stuffed) + TAIL, 0
    arbitration = _fd_arbitration(frame)
    # ESI: the sender is error-active.
    rest = "0" + _to_bits(FD_LENGTHS.index(len(frame.data)), 4) + _bits_of(frame.data)
    early = stuff_bits(arbitration)
    late = stuff_bits(arbitration + rest) - early
    crc = FD_CRC_SHORT if len(frame.data) <= FD_LONGEST_SHORT else FD_CRC_LONG
    return len(arbitration) + early + TAIL, len(rest) + late + crc


def frame_ns(frame: Frame, *, nominal_bitrate: int, data_bitrate: int) -> int:
    """The same as a time, rounded up to whole ns. Bit rates in bit/s; classic frames ignore the second."""
    nominal, data = frame_bits(frame)
    return bits_ns(nominal, data, nominal_bitrate=nominal_bitrate, data_bitrate=data_bitrate)


def bits_ns(nominal: int, data: int, *, nominal_bitrate: int, data_bitrate: int) -> int:
    """The time of so many bits at each rate, rounded up to whole ns.

    Raises:
        ValueError: for a bit rate that is not positive.
    """
    for name, rate in (("nominal", nominal_bitrate), ("data", data_bitrate)):
        if rate <= 0:
            raise ValueError(f"{name} bit rate {rate}: must be positive")
    # In whole numbers: -(-a // b) rounds up.
    return -(-(10**9) * (nominal * data_bitrate + data * nominal_bitrate) // (nominal_bitrate * data_bitrate))


def stuff_bits(bits: str) -> int:
    """Stuff bits that a sequence of "0" and "1" needs."""
    count = run = 0
    last = ""
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        if run == _RUN:
            count += 1
            last, run = ("1" if bit == "0" else "0"), 1
    return count


def crc15(bits: str) -> int:
    """The CRC of a classic frame over a sequence of "0" and "1" (polynomial 0x4599, start 0)."""
    crc = 0
    for bit in bits:
        top = crc >> 14 ^ (bit == "1")
        crc = (crc << 1 & 0x7FFF) ^ (_CRC15 if top else 0)
    return crc


def _classic_head(frame: Frame) -> str:
    length = _to_bits(len(frame.data), 4)
    if frame.is_extended:
        # Start, base identifier, SRR, IDE, extension, RTR, r1, r0.
        return "0" + _to_bits(frame.frame_id >> 18, 11) + "11" + _to_bits(frame.frame_id & 0x3FFFF, 18) + "000" + length
    # Start, identifier, RTR, IDE, r0.
    return "0" + _to_bits(frame.frame_id, 11) + "000" + length


def _fd_arbitration(frame: Frame) -> str:
    """Up to BRS, which is 1."""
    if frame.is_extended:
        # Start, base identifier, SRR, IDE, extension, RRS, FDF, res, BRS.
        return "0" + _to_bits(frame.frame_id >> 18, 11) + "11" + _to_bits(frame.frame_id & 0x3FFFF, 18) + "0101"
    # Start, identifier, RRS, IDE, FDF, res, BRS.
    return "0" + _to_bits(frame.frame_id, 11) + "00101"


def _to_bits(value: int, width: int) -> str:
    return format(value, f"0{width}b")


def _bits_of(data: bytes) -> str:
    # The most significant bit of each byte goes first.
    return "".join(format(byte, "08b") for byte in data)
