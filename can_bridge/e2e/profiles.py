"""AUTOSAR end-to-end protection: the profiles in use, by their number in AUTOSAR and in the DBC (PRS_E2EProtocol).

The header is a CRC, little-endian, then a counter, which in profile 2 has the low half of its byte. The CRC runs over
everything behind it and a data ID, which is not sent, so that a message delivered under another's identifier fails the
check.
"""

import binascii
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from can_bridge.wire.message_specs import MessageSpec


@dataclass(frozen=True, kw_only=True)
class Profile:
    """What sender and receiver need of one profile.

    Attributes:
        crc_length: bytes of the CRC, and of a data ID; the counter's byte follows.
        counter_period: after so many frames the counter begins again; a power of two.
        crc: of what is covered, with a data ID.
    """

    crc_length: int
    counter_period: int
    crc: Callable[[bytes, int], int]

    @property
    def header_bits(self) -> int:
        """Bits at the start of the message, the least significant bit of a byte first."""
        return 8 * self.crc_length + (self.counter_period - 1).bit_length()

    def protect(self, data: bytes, *, data_id: int, counter: int) -> bytes:
        """The same message with its header filled in; what the header's bits held is dropped. Raises ValueError if the
        message is shorter than its header, or an argument does not fit its field."""
        length, largest_id = self.crc_length, (1 << 8 * self.crc_length) - 1
        if len(data) <= length:
            raise ValueError(f"message of {len(data)} bytes: has no room for the {length + 1}-byte E2E header")
        if not 0 <= data_id <= largest_id:
            raise ValueError(f"data ID {data_id:#x}: must be in 0..{largest_id:#x}")
        if not 0 <= counter < self.counter_period:
            raise ValueError(f"counter {counter}: must be in 0..{self.counter_period - 1}")
        covered = bytes([data[length] & -self.counter_period & 0xFF | counter]) + data[length + 1 :]
        return self.crc(covered, data_id).to_bytes(length, "little") + covered

    def check(self, data: bytes, *, data_id: int) -> bool:
        """Whether the CRC fits; False for anything too short. Repeats are the receiver's to find."""
        length = self.crc_length
        return len(data) > length and data[:length] == self.crc(data[length:], data_id).to_bytes(length, "little")

    def counter_of(self, data: bytes) -> int:
        """The counter of a protected message that has its header."""
        return data[self.crc_length] & self.counter_period - 1

    def crc_of(self, data: bytes) -> int:
        """The CRC of a protected message that has one, as it came."""
        return int.from_bytes(data[: self.crc_length], "little")


def _table_entry(value: int) -> int:
    for _ in range(8):
        value = (value << 1 ^ (0x2F if value & 0x80 else 0)) & 0xFF
    return value


_TABLE: Final = bytes(_table_entry(value) for value in range(256))


def _crc_8(covered: bytes, data_id: int) -> int:
    """Polynomial 0x2F, start and final exclusive-or 0xFF, nothing reflected.

    The standard takes the data ID from a list by the counter; here all 16 entries are the message's own. The code is
    then linear, and the Hamming distance of this polynomial, 4 up to 119 bits, holds for every content: a list that
    changes with the counter lets some 2-bit errors in the counter and the data pass.
    """
    value = 0xFF
    for byte in covered:
        value = _TABLE[value ^ byte]
    return _TABLE[value ^ data_id] ^ 0xFF


def _crc_16(covered: bytes, data_id: int) -> int:
    """Polynomial 0x1021, start 0xFFFF, nothing reflected, which is the standard library's; the data ID's low byte
    first. Exhaustively tested on 12 bytes: no 1- or 2-bit error passes."""
    return binascii.crc_hqx(covered + data_id.to_bytes(2, "little"), 0xFFFF)


PROFILE_2: Final = Profile(crc_length=1, counter_period=16, crc=_crc_8)
PROFILE_5: Final = Profile(crc_length=2, counter_period=256, crc=_crc_16)
_PROFILES: Final[Mapping[int, Profile]] = {2: PROFILE_2, 5: PROFILE_5}


def profile_of(spec: MessageSpec) -> Profile:
    """The profile that protects a message."""
    return _PROFILES[spec.profile]
