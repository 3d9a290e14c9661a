"""The UDS numbers of this ECU (ISO 14229-1:2020), its own identifiers and routines, and the permissions for them."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from can_bridge.flashing.state import Level
from contract.controller.calibration import PACKED_BYTES

P2_MS: Final = 50
"""Longest time in ms from a request to its first answer."""
P2_EXTENDED_MS: Final = 5000
"""Longest time in ms from a response-pending to the next answer."""
S3_MS: Final = 5000
"""Time in ms without a request after which a session ends."""
MAX_REQUEST: Final = 4095
"""Largest length in bytes of a request: the greatest value of ISO-TP's 12-bit length."""
LONGEST_ANSWER: Final = 768
"""Largest length in bytes of an answer with several identifiers; a single identifier is always answered."""
BESIDE: Final = 24
"""Number of unsent answer bytes above which a new request is refused as busy."""
POSITIVE: Final = 0x40
"""Difference between a positive response's first byte and the service's identifier."""
NEGATIVE: Final = 0x7F
"""First byte of a negative response."""
MAX_BLOCK: Final = 4080
"""Largest length in bytes of a TransferData request, including two header bytes."""


class Service(IntEnum):
    SESSION = 0x10
    RESET = 0x11
    CLEAR_FAULTS = 0x14
    REPORT_FAULTS = 0x19
    READ = 0x22
    SECURITY = 0x27
    COMMUNICATION = 0x28
    WRITE = 0x2E
    ROUTINE = 0x31
    DOWNLOAD = 0x34
    TRANSFER = 0x36
    EXIT = 0x37
    TESTER_PRESENT = 0x3E
    FAULT_SETTING = 0x85


class Session(IntEnum):
    DEFAULT = 1
    PROGRAMMING = 2
    EXTENDED = 3


class Nrc(IntEnum):
    """A negative response code (ISO 14229-1:2020, table A.1)."""

    SERVICE_NOT_SUPPORTED = 0x11
    SUB_FUNCTION_NOT_SUPPORTED = 0x12
    INCORRECT_LENGTH = 0x13
    RESPONSE_TOO_LONG = 0x14
    BUSY_REPEAT_REQUEST = 0x21
    CONDITIONS_NOT_CORRECT = 0x22
    SEQUENCE_ERROR = 0x24
    OUT_OF_RANGE = 0x31
    SECURITY_ACCESS_DENIED = 0x33
    INVALID_KEY = 0x35
    EXCEEDED_ATTEMPTS = 0x36
    DELAY_NOT_EXPIRED = 0x37
    UPLOAD_DOWNLOAD_NOT_ACCEPTED = 0x70
    TRANSFER_SUSPENDED = 0x71
    PROGRAMMING_FAILURE = 0x72
    WRONG_BLOCK_COUNTER = 0x73
    RESPONSE_PENDING = 0x78
    SUB_FUNCTION_NOT_IN_SESSION = 0x7E
    SERVICE_NOT_IN_SESSION = 0x7F


UNSENT_TO_ALL: Final = frozenset(
    {Nrc.SERVICE_NOT_SUPPORTED, Nrc.SUB_FUNCTION_NOT_SUPPORTED, Nrc.OUT_OF_RANGE}
    | {Nrc.SERVICE_NOT_IN_SESSION, Nrc.SUB_FUNCTION_NOT_IN_SESSION}
)
"""Negative responses that a functional request does not get (section 7.5), because every ECU would send one."""


class Routine(IntEnum):
    """A RoutineControl identifier. Sub-function 1 starts a routine. For answers see `can_bridge.uds.ecu_services`."""

    PRECONDITIONS = 0x0203
    """Check whether the ECU may be programmed now."""
    SELF_TEST = 0x0204
    """Run the running release's controller on a test input; its plan must be finite."""
    ACTIVATE = 0x0205
    """Activate the checked image: from the next reset on, it boots on trial."""
    CONFIRM = 0x0206
    REVERT = 0x0207
    """Select the previous release: it boots from the next reset on."""
    ERASE = 0xFF00
    """Announce an image and prepare a slot. The option record has the image's length (4 bytes) and SHA-256 (32 bytes).
    The answer has the offset (4 bytes) of the first byte to send, above 0 if a transfer was interrupted."""
    CHECK = 0xFF01
    """Check the transferred image; the answer has a `Verdict`, 1 byte."""


class Did(IntEnum):
    """An identifier of data that UDS reads or writes."""

    ACTIVE_SESSION = 0xF186
    SERIAL_NUMBER = 0xF18C
    HARDWARE = 0xF191
    """Name of the hardware, UTF-8."""
    SOFTWARE_VERSION = 0xF195
    """Version of stillwake, UTF-8."""
    DBC_SHA256 = 0xFD00
    """SHA-256 of the DBC, 32 bytes."""
    STORE = 0xFD01
    """State of the slots, in the format of `can_bridge.flashing.report`."""
    KEY_LIST = 0xFD02
    """Writing replaces the signed key list; reading returns the version of the list, 4 bytes."""
    CAPACITY = 0xFD03
    """Size in bytes of the largest image, 4 bytes."""
    PERIOD_NS = 0xFD04
    """Control period in ns, 8 bytes."""
    CALIBRATION = 0xFD10
    """The calibration in force, packed by `contract.controller.calibration`; a written one stays until a reset."""
    CALIBRATION_LIMITS = 0xFD11
    """The least allowed values, the greatest allowed values and the release's own values: three packed calibrations."""
    CALIBRATION_STORED = 0xFD12
    """Writing 1 stores the values in force, 0 restores the release's values. Reading returns 1 if values are stored."""


class Refused(Exception):  # noqa: N818  (a negative response is an answer, not an error)
    """The refusal of a request, with a negative response code."""

    def __init__(self, code: Nrc, why: str = "") -> None:
        super().__init__(why or code.name)
        self.code = code


_BEYOND_DEFAULT: Final = frozenset({Session.PROGRAMMING, Session.EXTENDED})
_PROGRAMMING: Final = frozenset({Session.PROGRAMMING})
_EXTENDED: Final = frozenset({Session.EXTENDED})


@dataclass(frozen=True)
class Permission:
    """The conditions for a request: its sessions, the security level that must be unlocked, and the length in bytes of
    the value or option record; None for any length."""

    sessions: frozenset[Session] = frozenset(Session)
    level: Level | None = None
    length: int | None = None


_FLASHING: Final = Permission(_PROGRAMMING, Level.PROGRAMMING)
SERVICES: Final[Mapping[int, Permission]] = {
    Service.SESSION: Permission(),
    # The programming session begins only while the jets are shut; `EcuServices.before_reset` checks this again.
    Service.RESET: Permission(_PROGRAMMING),
    **dict.fromkeys((Service.CLEAR_FAULTS, Service.REPORT_FAULTS, Service.READ, Service.TESTER_PRESENT), Permission()),
    **dict.fromkeys((Service.SECURITY, Service.COMMUNICATION, Service.FAULT_SETTING), Permission(_BEYOND_DEFAULT)),
    **dict.fromkeys((Service.WRITE, Service.ROUTINE), Permission(_BEYOND_DEFAULT)),
    **dict.fromkeys((Service.DOWNLOAD, Service.TRANSFER, Service.EXIT), _FLASHING),
}
LEVELS: Final[Mapping[int, Permission]] = {
    Level.PROGRAMMING: Permission(_PROGRAMMING),
    Level.CALIBRATION: Permission(_EXTENDED),
}
"""The sessions in which each level can be unlocked."""
WRITABLE: Final[Mapping[int, Permission]] = {
    Did.KEY_LIST: _FLASHING,
    Did.CALIBRATION: Permission(_EXTENDED, Level.CALIBRATION, length=PACKED_BYTES),
    Did.CALIBRATION_STORED: Permission(_EXTENDED, Level.CALIBRATION, length=1),
}
ROUTINES: Final[Mapping[int, Permission]] = {
    **dict.fromkeys(Routine, Permission(_PROGRAMMING, Level.PROGRAMMING, length=0)),
    Routine.PRECONDITIONS: Permission(_BEYOND_DEFAULT, length=0),
    Routine.ERASE: Permission(_PROGRAMMING, Level.PROGRAMMING, length=4 + 32),
}
