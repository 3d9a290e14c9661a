"""AUTOSAR end-to-end protection, profile 5 (PRS_E2EProtocol, "Specification of E2E Profile 5").

The header is the first three bytes: CRC-16 little-endian, then an 8-bit counter. The CRC (polynomial 0x1021,
start 0xFFFF, nothing reflected) runs over the counter, the data and the two bytes of the data ID, low byte first.
The data ID is not sent, so that a message delivered under another's identifier fails the check. Exhaustively
tested on 12 bytes: no 1- or 2-bit error passes.
"""

import binascii
from typing import Final

CRC: Final = slice(0, 2)
COUNTER: Final = 2
HEADER_LENGTH: Final = 3
HEADER_BITS: Final = 8 * HEADER_LENGTH
COUNTER_PERIOD: Final = 256

_CRC_START: Final = 0xFFFF


def protect(data: bytes, *, data_id: int, counter: int) -> bytes:
    """The same message with its header filled in; what the first three bytes held is dropped. Raises ValueError if the
    message is shorter than its header, or an argument does not fit its field."""
    if len(data) < HEADER_LENGTH:
        raise ValueError(f"message of {len(data)} bytes: has no room for the {HEADER_LENGTH}-byte E2E header")
    if not 0 <= data_id <= 0xFFFF:
        raise ValueError(f"data ID {data_id:#x}: must be in 0..0xffff")
    if not 0 <= counter < COUNTER_PERIOD:
        raise ValueError(f"counter {counter}: must be in 0..{COUNTER_PERIOD - 1}")
    covered = bytes([counter]) + data[HEADER_LENGTH:]
    return _crc(covered, data_id).to_bytes(2, "little") + covered


def check(data: bytes, *, data_id: int) -> bool:
    """Whether the CRC fits; False for anything too short. Repeats are the receiver's to find."""
    if len(data) < HEADER_LENGTH:
        return False
    return data[CRC] == _crc(data[CRC.stop :], data_id).to_bytes(2, "little")


def counter_of(data: bytes) -> int:
    """The counter of a protected message of at least three bytes."""
    return data[COUNTER]


def crc_of(data: bytes) -> int:
    """The CRC of a protected message of at least two bytes, as it came."""
    return int.from_bytes(data[CRC], "little")


def _crc(covered: bytes, data_id: int) -> int:
    # The standard library's crc_hqx has this polynomial and takes the start value.
    return binascii.crc_hqx(covered + data_id.to_bytes(2, "little"), _CRC_START)
