"""The codes and bits of XCP (ASAM MCD-1 XCP 1.x, part 2) that the ECU's slave uses."""

from collections.abc import Callable
from enum import IntEnum
from hmac import compare_digest
from typing import Final, Self

from can_bridge.flashing.state import Level

MAX_CTO: Final = 8
"""Largest number of bytes in a command or an answer: the size of a classic frame, which also fits CAN FD."""
PROTOCOL_VERSION: Final = 1
TRANSPORT_VERSION: Final = 1
DRIVER_VERSION: Final = 0x10
COMM_MODE: Final = 0x80
"""Communication mode in CONNECT's answer: little-endian, byte addresses, no block mode."""
CAL_PAG: Final = 0x01
"""The bit of the XCP resource for calibration and its pages."""
RESOURCES: Final = CAL_PAG | 0x04
"""The bits of this ECU's resources: calibration, and measurement (DAQ), which needs no key."""

RESPONSE: Final = 0xFF
ERROR: Final = 0xFE
EVENT: Final = 0xFD
"""The values of the first byte of a packet to the tool: response, error and event."""
STORED_EVENT: Final = 0x03
STORE_REQUEST: Final = 0x01
"""The bit for storing the calibration, in SET_REQUEST's mode and in GET_STATUS's session status."""
DAQ_RUNNING: Final = 0x40
CRC_32: Final = 0x09

ECU_MODE: Final = 0x01
XCP_MODE: Final = 0x02
ALL_MODE: Final = 0x80
"""Mode bits of SET_CAL_PAGE: the page that the controller uses, the page that the tool accesses, all segments."""


class Command(IntEnum):
    """The first byte of a packet from the tool. A command has `shortest` bytes or more; padding may follow."""

    shortest: int

    def __new__(cls, code: int, shortest: int = 1) -> Self:
        command = int.__new__(cls, code)
        command._value_, command.shortest = code, shortest
        return command

    CONNECT = 0xFF, 2
    DISCONNECT = 0xFE
    GET_STATUS = 0xFD
    SYNCH = 0xFC
    GET_COMM_MODE_INFO = 0xFB
    GET_ID = 0xFA, 2
    SET_REQUEST = 0xF9, 2
    GET_SEED = 0xF8, 3
    UNLOCK = 0xF7, 3
    SET_MTA = 0xF6, 8
    UPLOAD = 0xF5, 2
    SHORT_UPLOAD = 0xF4, 8
    BUILD_CHECKSUM = 0xF3, 8
    DOWNLOAD = 0xF0, 3
    SET_CAL_PAGE = 0xEB, 4
    GET_CAL_PAGE = 0xEA, 3
    GET_PAG_PROCESSOR_INFO = 0xE9
    GET_SEGMENT_INFO = 0xE8, 5
    GET_PAGE_INFO = 0xE7, 4
    COPY_CAL_PAGE = 0xE4, 5
    SET_DAQ_PTR = 0xE2, 6
    WRITE_DAQ = 0xE1, 8
    SET_DAQ_LIST_MODE = 0xE0, 8
    GET_DAQ_LIST_MODE = 0xDF, 4
    START_STOP_DAQ_LIST = 0xDE, 4
    START_STOP_SYNCH = 0xDD, 2
    GET_DAQ_PROCESSOR_INFO = 0xDA
    GET_DAQ_RESOLUTION_INFO = 0xD9
    GET_DAQ_EVENT_INFO = 0xD7, 4
    FREE_DAQ = 0xD6
    ALLOC_DAQ = 0xD5, 4
    ALLOC_ODT = 0xD4, 5
    ALLOC_ODT_ENTRY = 0xD3, 6


PROTECTED: Final = frozenset(
    {Command.SET_REQUEST, Command.DOWNLOAD, Command.SET_CAL_PAGE, Command.GET_CAL_PAGE, Command.COPY_CAL_PAGE}
)
"""Commands that are refused while the resource is locked. Reading a value needs no key, as in UDS."""


class Error(IntEnum):
    """The second byte of an error packet."""

    CMD_SYNCH = 0x00
    DAQ_ACTIVE = 0x11
    CMD_UNKNOWN = 0x20
    CMD_SYNTAX = 0x21
    OUT_OF_RANGE = 0x22
    WRITE_PROTECTED = 0x23
    ACCESS_DENIED = 0x24
    ACCESS_LOCKED = 0x25
    PAGE_NOT_VALID = 0x26
    MODE_NOT_VALID = 0x27
    SEGMENT_NOT_VALID = 0x28
    SEQUENCE = 0x29
    DAQ_CONFIG = 0x2A
    MEMORY_OVERFLOW = 0x30
    GENERIC = 0x31


class Denied(Exception):  # noqa: N818  (an error packet is an answer, not an error)
    """The refusal of a command; the slave answers with the error `code`."""

    def __init__(self, code: Error) -> None:
        super().__init__(code.name)
        self.code = code


def deny_if(condition: bool, code: Error) -> None:
    if condition:
        raise Denied(code)


XCP_SEED_LENGTH: Final = 12
"""Length of a seed, in bytes: two packets. pyxcp 0.29 reads no third packet when it unlocks. A UDS seed has 16 bytes,
so the key for an XCP seed is never the key for a UDS seed."""
XCP_KEY_LENGTH: Final = 16
"""Length of a key, in bytes: an AES-CMAC."""
_PIECE: Final = MAX_CTO - 2


SeedAnswer = Callable[[Level, bytes], bytes]
"""A function that returns the key that is valid for a seed, such as `can_bridge.uds.security.AccessKey.answer`."""


class XcpAccess:
    """The lock of the calibration resource, with the progress of a tool that unlocks the resource."""

    def __init__(self, answer: SeedAnswer, random_bytes: Callable[[int], bytes]) -> None:
        self._answer, self._random_bytes = answer, random_bytes
        self.lock()

    @property
    def protected(self) -> int:
        return 0 if self.is_unlocked else CAL_PAG

    def lock(self) -> None:
        self.is_unlocked = False
        self._forget()

    def seed(self, mode: int, resource: int) -> bytes:
        """Return one byte with the number of seed bytes that are still to be sent, and as many of them as fit a packet;
        return a single zero if the resource is not locked. Raises Denied for an unknown resource or mode, if the tool
        requests more bytes than the seed has, or if the random source returns only zeros."""
        if mode == 0:
            self._forget()
            deny_if(resource != CAL_PAG, Error.OUT_OF_RANGE)
            if self.is_unlocked:
                return bytes([0])
            seed = self._random_bytes(XCP_SEED_LENGTH)
            deny_if(not any(seed), Error.GENERIC)
            self._seed = self._unsent = seed
        elif mode != 1:
            raise Denied(Error.OUT_OF_RANGE)
        elif not self._unsent:
            raise Denied(Error.SEQUENCE)
        left, piece = len(self._unsent), self._unsent[:_PIECE]
        self._unsent = self._unsent[_PIECE:]
        return bytes([left]) + piece

    def unlock(self, left: int, data: bytes) -> bool:
        """Process the next bytes of the key; `left` is the number of bytes still to come, including these. Return False
        for a complete wrong key. Raises Denied if bytes of the seed were not read, or bytes of the key are missing."""
        if not self._seed or self._unsent or left != XCP_KEY_LENGTH - len(self._key):
            self._forget()
            raise Denied(Error.SEQUENCE)
        piece = data[: min(left, _PIECE)]
        deny_if(len(piece) < min(left, _PIECE), Error.CMD_SYNTAX)
        self._key += piece
        if len(self._key) < XCP_KEY_LENGTH:
            return True
        self.is_unlocked = compare_digest(self._answer(Level.CALIBRATION, self._seed), self._key)
        self._forget()
        return self.is_unlocked

    def _forget(self) -> None:
        self._seed = self._unsent = self._key = b""
