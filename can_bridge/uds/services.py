"""The numbers of UDS that this ECU uses (ISO 14229-1:2020), and its own identifiers and routines."""

from enum import IntEnum
from typing import Final

P2_MS: Final = 50
"""Until the first answer to a request, at most."""
P2_EXTENDED_MS: Final = 5000
"""After a response-pending, at most."""
S3_MS: Final = 5000
"""Without any request after which a session ends by itself."""
MAX_REQUEST: Final = 4095
"""Bytes of one request: what ISO-TP's 12-bit length carries."""
LONGEST_ANSWER: Final = 768
"""Bytes of an answer with several identifiers; a longer one is refused as too long. One alone is always answered."""
BESIDE: Final = 24
"""Bytes of other answers that may wait when a request is begun; behind more it is refused as busy."""
MAX_BLOCK: Final = 4080
"""Bytes of a TransferData request, its two of header included."""


class Service(IntEnum):
    """Service identifiers; a positive response has 0x40 more."""

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
    """Diagnostic sessions."""

    DEFAULT = 1
    PROGRAMMING = 2
    EXTENDED = 3


class Nrc(IntEnum):
    """Negative response codes (ISO 14229-1:2020, table A.1)."""

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
    {
        Nrc.SERVICE_NOT_SUPPORTED,
        Nrc.SUB_FUNCTION_NOT_SUPPORTED,
        Nrc.OUT_OF_RANGE,
        Nrc.SUB_FUNCTION_NOT_IN_SESSION,
        Nrc.SERVICE_NOT_IN_SESSION,
    }
)
"""Refusals of functional requests that are not sent (section 7.5): each ECU would send what others answer."""


class Routine(IntEnum):
    """RoutineControl identifiers, all started by sub-function 1. Results are in `can_bridge.uds.ecu_services`."""

    PRECONDITIONS = 0x0203
    """Whether the ECU may be programmed now; refused with CONDITIONS_NOT_CORRECT if not."""
    SELF_TEST = 0x0204
    """Run the controller of the release that runs on what must lead to a finite plan."""
    ACTIVATE = 0x0205
    """Boot the checked image from the next reset on, on trial."""
    CONFIRM = 0x0206
    """Keep the release that runs; it is no longer on trial."""
    REVERT = 0x0207
    """Go back to the release before from the next reset on."""
    ERASE = 0xFF00
    """Announce an image, and make room for it: option record length (4), SHA-256 (32); the answer has the offset (4)
    from which it is wanted, more than zero if an earlier transfer of it was interrupted."""
    CHECK = 0xFF01
    """Check the transferred image; the answer has a `Verdict` (1)."""


class Did(IntEnum):
    """Data identifiers."""

    ACTIVE_SESSION = 0xF186
    SERIAL_NUMBER = 0xF18C
    HARDWARE = 0xF191
    """Name of the hardware, UTF-8."""
    SOFTWARE_VERSION = 0xF195
    """Version of stillwake, UTF-8."""
    DBC_SHA256 = 0xFD00
    """(32)"""
    STORE = 0xFD01
    """What the slots hold: `can_bridge.flashing.report`."""
    KEY_LIST = 0xFD02
    """To be written: a signed key list. Read: its version (4)."""
    CAPACITY = 0xFD03
    """Bytes of the greatest image (4)."""
    PERIOD_NS = 0xFD04
    """Control period (8)."""
    CALIBRATION = 0xFD10
    """The whole calibration as `contract.controller.calibration` packs it: reading gives the one in force; writing
    changes it at the next control period, until reset."""
    CALIBRATION_LIMITS = 0xFD11
    """Least and greatest allowed value of each, then the release's own: three calibrations, packed."""
    CALIBRATION_STORED = 0xFD12
    """1: store the one in force; 0: back to the release's own. Read: whether one is stored (1)."""


class Refused(Exception):  # noqa: N818  (a negative response is an answer, no error)
    """The request is answered by this code."""

    def __init__(self, code: Nrc, why: str = "") -> None:
        super().__init__(why or code.name)
        self.code = code
