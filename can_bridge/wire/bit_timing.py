"""How long a frame occupies the bus at worst, with 11-bit identifiers and the intermission included.

Classic CAN: the bound of Davis, Burns, Bril and Lukkien, "Controller Area Network (CAN) schedulability analysis:
refuted, revisited and revised", Real-Time Systems 35 (2007), equation 1. CAN FD: the same reasoning on the frame of
ISO 11898-1:2015 with bit-rate switching; the CRC field there carries fixed stuff bits instead of dynamic ones.
One dynamic stuff bit after the first five equal bits and then after every fourth is the most there can be.
"""

from typing import Final

from can_bridge.wire.frame import Frame

_STUFF_EVERY: Final = 4

_CLASSIC_HEAD: Final = 19
"""Start, identifier, RTR, IDE, r0, DLC."""
_CLASSIC_CRC: Final = 15
_TAIL: Final = 13
"""CRC delimiter, acknowledge and its delimiter, end of frame (7), intermission (3); never stuffed."""

_FD_ARBITRATION: Final = 17
"""Start, identifier, RRS, IDE, FDF, res, BRS; the last is charged at the nominal rate as a whole."""
_FD_CONTROL: Final = 5
"""ESI and DLC."""
_FD_CRC_SHORT: Final = 4 + 17 + 6
"""Stuff count with parity, CRC-17, fixed stuff bits: up to 16 data bytes."""
_FD_CRC_LONG: Final = 4 + 21 + 7
"""The same with CRC-21, for more than 16."""
_FD_LONGEST_SHORT: Final = 16


def worst_case_bits(frame: Frame) -> tuple[int, int]:
    """Bits at the nominal and at the data bit rate, with the most stuff bits any content could need.

    The CRC delimiter, during which an FD frame switches back, is charged at the nominal rate as a whole.
    """
    payload = 8 * len(frame.data)
    if not frame.is_fd:
        stuffed = _CLASSIC_HEAD + payload + _CLASSIC_CRC
        return stuffed + _most_stuff_bits(stuffed) + _TAIL, 0
    # As many of the stuff bits as can fall into the arbitration phase are charged there, where they cost most.
    early = _most_stuff_bits(_FD_ARBITRATION)
    late = _most_stuff_bits(_FD_ARBITRATION + _FD_CONTROL + payload) - early
    crc = _FD_CRC_SHORT if len(frame.data) <= _FD_LONGEST_SHORT else _FD_CRC_LONG
    return _FD_ARBITRATION + early + _TAIL, _FD_CONTROL + payload + late + crc


def worst_case_ns(frame: Frame, *, nominal_bitrate: int, data_bitrate: int) -> int:
    """The same as a time, rounded up to whole ns. Bit rates in bit/s; classic frames ignore the second.

    Raises:
        ValueError: for a bit rate that is not positive.
    """
    for name, rate in (("nominal", nominal_bitrate), ("data", data_bitrate)):
        if rate <= 0:
            raise ValueError(f"{name} bit rate {rate}: must be positive")
    nominal, data = worst_case_bits(frame)
    # In whole numbers: -(-a // b) rounds up.
    return -(-(10**9) * (nominal * data_bitrate + data * nominal_bitrate) // (nominal_bitrate * data_bitrate))


def _most_stuff_bits(bits: int) -> int:
    return (bits - 1) // _STUFF_EVERY
