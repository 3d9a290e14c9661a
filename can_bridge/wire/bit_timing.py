"""How long a frame occupies the bus at worst, whatever it contains, the intermission included.

Classic CAN: the bound of Davis, Burns, Bril and Lukkien, "Controller Area Network (CAN) schedulability analysis:
refuted, revisited and revised", Real-Time Systems 35 (2007), equation 1. CAN FD: the same reasoning on the frame of
ISO 11898-1:2015 with bit-rate switching; the CRC field there carries fixed stuff bits instead of dynamic ones.
One dynamic stuff bit after the first five equal bits and then after every fourth is the most there can be.
"""

from typing import Final

from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import FD_CRC_LONG, FD_CRC_SHORT, FD_LONGEST_SHORT, TAIL, bits_ns

_STUFF_EVERY: Final = 4

_CLASSIC_HEAD: Final = 19
"""Start, identifier, RTR, IDE, r0, DLC."""
_CLASSIC_HEAD_EXTENDED: Final = 39
"""Start, base identifier, SRR, IDE, extension, RTR, r1, r0, DLC."""
_CLASSIC_CRC: Final = 15

_FD_ARBITRATION: Final = 17
"""Start, identifier, RRS, IDE, FDF, res, BRS; the last is charged at the nominal rate as a whole."""
_FD_ARBITRATION_EXTENDED: Final = 36
"""Start, base identifier, SRR, IDE, extension, RRS, FDF, res, BRS."""
_FD_CONTROL: Final = 5
"""ESI and DLC."""


def worst_case_bits(frame: Frame) -> tuple[int, int]:
    """Bits at the nominal and at the data bit rate, with the most stuff bits any content could need.

    The CRC delimiter, during which an FD frame switches back, is charged at the nominal rate as a whole.
    """
    payload = 8 * len(frame.data)
    if not frame.is_fd:
        head = _CLASSIC_HEAD_EXTENDED if frame.is_extended else _CLASSIC_HEAD
        stuffed = head + payload + _CLASSIC_CRC
        return stuffed + _most_stuff_bits(stuffed) + TAIL, 0
    # As many of the stuff bits as can fall into the arbitration phase are charged there, where they cost most.
    arbitration = _FD_ARBITRATION_EXTENDED if frame.is_extended else _FD_ARBITRATION
    early = _most_stuff_bits(arbitration)
    late = _most_stuff_bits(arbitration + _FD_CONTROL + payload) - early
    crc = FD_CRC_SHORT if len(frame.data) <= FD_LONGEST_SHORT else FD_CRC_LONG
    return arbitration + early + TAIL, _FD_CONTROL + payload + late + crc


def worst_case_ns(frame: Frame, *, nominal_bitrate: int, data_bitrate: int) -> int:
    """The same as a time, rounded up to whole ns. Bit rates in bit/s; classic frames ignore the second. Raises
    ValueError for a bit rate that is not positive."""
    nominal, data = worst_case_bits(frame)
    return bits_ns(nominal, data, nominal_bitrate=nominal_bitrate, data_bitrate=data_bitrate)


def _most_stuff_bits(bits: int) -> int:
    return (bits - 1) // _STUFF_EVERY
