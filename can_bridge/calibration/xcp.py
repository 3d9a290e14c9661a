"""The numbers of XCP (ASAM MCD-1 XCP 1.x, part 2) that the slave uses."""

from enum import IntEnum
from typing import Final

MAX_CTO: Final = 8
"""Bytes of a command or an answer: of a classic frame, which CAN FD can carry as well."""
PROTOCOL_VERSION: Final = 1
TRANSPORT_VERSION: Final = 1
DRIVER_VERSION: Final = 0x10
COMM_MODE: Final = 0x80
"""Mode in CONNECT's answer: little-endian, addresses of bytes, no block mode; GET_COMM_MODE_INFO has the rest."""
CAL_PAG: Final = 0x01
"""The resource of calibration and of its pages; we have no other."""

RESPONSE: Final = 0xFF
ERROR: Final = 0xFE
EVENT: Final = 0xFD
"""First byte of a packet to the tool."""
STORED_EVENT: Final = 0x03
"""Storing the calibration has ended."""
STORE_REQUEST: Final = 0x01
"""Bit of SET_REQUEST's mode and of GET_STATUS's session status: the calibration."""
CRC_32: Final = 0x09
"""Kind of checksum: the CRC of Ethernet."""

ECU_MODE: Final = 0x01
XCP_MODE: Final = 0x02
ALL_MODE: Final = 0x80
"""Modes of SET_CAL_PAGE: the page that the control uses, the page that the tool sees, all segments."""


class Command(IntEnum):
    """First byte of a packet from the tool."""

    CONNECT = 0xFF
    DISCONNECT = 0xFE
    GET_STATUS = 0xFD
    SYNCH = 0xFC
    GET_COMM_MODE_INFO = 0xFB
    GET_ID = 0xFA
    SET_REQUEST = 0xF9
    GET_SEED = 0xF8
    UNLOCK = 0xF7
    SET_MTA = 0xF6
    UPLOAD = 0xF5
    SHORT_UPLOAD = 0xF4
    BUILD_CHECKSUM = 0xF3
    DOWNLOAD = 0xF0
    SET_CAL_PAGE = 0xEB
    GET_CAL_PAGE = 0xEA
    GET_PAG_PROCESSOR_INFO = 0xE9
    GET_SEGMENT_INFO = 0xE8
    GET_PAGE_INFO = 0xE7
    COPY_CAL_PAGE = 0xE4


SHORTEST: Final = {
    Command.CONNECT: 2,
    Command.GET_ID: 2,
    Command.SET_REQUEST: 2,
    Command.GET_SEED: 3,
    Command.UNLOCK: 3,
    Command.SET_MTA: 8,
    Command.UPLOAD: 2,
    Command.SHORT_UPLOAD: 8,
    Command.BUILD_CHECKSUM: 8,
    Command.DOWNLOAD: 3,
    Command.SET_CAL_PAGE: 4,
    Command.GET_CAL_PAGE: 3,
    Command.GET_SEGMENT_INFO: 5,
    Command.GET_PAGE_INFO: 4,
    Command.COPY_CAL_PAGE: 5,
}
"""Bytes of a command; longer ones are padded. Those left out have one."""

PROTECTED: Final = frozenset(
    {Command.SET_REQUEST, Command.DOWNLOAD, Command.SET_CAL_PAGE, Command.GET_CAL_PAGE, Command.COPY_CAL_PAGE}
)
"""Commands that need the resource unlocked. Reading does not: UDS shows the same values to all."""


class Error(IntEnum):
    """Second byte of an error packet."""

    CMD_SYNCH = 0x00
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


class Denied(Exception):  # noqa: N818  (an error packet is an answer, no error)
    """The command is answered by this code."""

    def __init__(self, code: Error) -> None:
        super().__init__(code.name)
        self.code = code
