"""AUTOSAR end-to-end protection, profile 2 (PRS_E2EProtocol, "Specification of E2E Profile 2").

The header is 12 bits: CRC-8 in byte 0, then a 4-bit counter in the low half of byte 1. The CRC (polynomial 0x2F, start
and final exclusive-or 0xFF, nothing reflected) runs over everything behind it and one byte of a data ID, which is not
sent. The standard takes that byte from a list by the counter; here all 16 entries are the message's data ID. The code
is then linear, and the Hamming distance of this polynomial, 4 up to 119 bits, holds for every content: a list that
changes with the counter lets some 2-bit errors in the counter and the data pass.
"""

from typing import Final

HEADER_LENGTH: Final = 2
"""Bytes that the header reaches into; the upper half of the second belongs to the message."""
HEADER_BITS: Final = 12
"""The least significant bit of a byte first."""
COUNTER_PERIOD: Final = 16

_POLYNOMIAL: Final = 0x2F


def _table_entry(value: int) -> int:
    for _ in range(8):
        value = (value << 1 ^ (_POLYNOMIAL if value & 0x80 else 0)) & 0xFF
    return value


_TABLE: Final = bytes(_table_entry(value) for value in range(256))


def protect(data: bytes, *, data_id: int, counter: int) -> bytes:
    """The same message with its header filled in; what its 12 bits held is dropped. Raises ValueError if the message is
    shorter than its header, or an argument does not fit its field."""
    if len(data) < HEADER_LENGTH:
        raise ValueError(f"message of {len(data)} bytes: has no room for the {HEADER_LENGTH}-byte E2E header")
    if not 0 <= data_id <= 0xFF:
        raise ValueError(f"data ID {data_id:#x}: must be in 0..0xff")
    if not 0 <= counter < COUNTER_PERIOD:
        raise ValueError(f"counter {counter}: must be in 0..{COUNTER_PERIOD - 1}")
    covered = bytes([data[1] & 0xF0 | counter]) + data[HEADER_LENGTH:]
    return bytes([_crc(covered, data_id)]) + covered


def check(data: bytes, *, data_id: int) -> bool:
    """Whether the CRC fits; False for anything too short. Repeats are the receiver's to find."""
    return len(data) >= HEADER_LENGTH and data[0] == _crc(data[1:], data_id)


def counter_of(data: bytes) -> int:
    """The counter of a protected message of at least two bytes."""
    return data[1] & 0xF


def crc_of(data: bytes) -> int:
    """The CRC of a protected message of at least one byte, as it came."""
    return data[0]


def _crc(covered: bytes, data_id: int) -> int:
    value = 0xFF
    for byte in covered:
        value = _TABLE[value ^ byte]
    return _TABLE[value ^ data_id] ^ 0xFF
