"""In which sessions each service, identifier and routine is there, and which security level it needs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from can_bridge.flashing.access_level import Level
from can_bridge.uds.services import Did, Routine, Service, Session
from contract.controller.calibration import PACKED_BYTES

_ALL: Final = frozenset(Session)
_BEYOND_DEFAULT: Final = frozenset({Session.PROGRAMMING, Session.EXTENDED})
_PROGRAMMING: Final = frozenset({Session.PROGRAMMING})
_EXTENDED: Final = frozenset({Session.EXTENDED})


@dataclass(frozen=True)
class Permission:
    """Who may, and with how many bytes.

    Attributes:
        level: that must be unlocked; None if none need be.
        length: of the value or option record in bytes; None for any.
    """

    sessions: frozenset[Session] = _ALL
    level: Level | None = None
    length: int | None = None


SERVICES: Final[Mapping[int, Permission]] = {
    Service.SESSION: Permission(),
    # The programming session begins only while the jets are shut; `Diagnostics.before_reset` looks again.
    Service.RESET: Permission(_PROGRAMMING),
    Service.CLEAR_FAULTS: Permission(),
    Service.REPORT_FAULTS: Permission(),
    Service.READ: Permission(),
    Service.SECURITY: Permission(_BEYOND_DEFAULT),
    Service.COMMUNICATION: Permission(_BEYOND_DEFAULT),
    Service.WRITE: Permission(_BEYOND_DEFAULT),
    Service.ROUTINE: Permission(_BEYOND_DEFAULT),
    Service.DOWNLOAD: Permission(_PROGRAMMING, Level.PROGRAMMING),
    Service.TRANSFER: Permission(_PROGRAMMING, Level.PROGRAMMING),
    Service.EXIT: Permission(_PROGRAMMING, Level.PROGRAMMING),
    Service.TESTER_PRESENT: Permission(),
    Service.FAULT_SETTING: Permission(_BEYOND_DEFAULT),
}
LEVELS: Final[Mapping[int, Permission]] = {
    Level.PROGRAMMING: Permission(_PROGRAMMING),
    Level.CALIBRATION: Permission(_EXTENDED),
}
"""Sessions in which a level can be unlocked."""
WRITABLE: Final[Mapping[int, Permission]] = {
    Did.KEY_LIST: Permission(_PROGRAMMING, Level.PROGRAMMING),
    Did.CALIBRATION: Permission(_EXTENDED, Level.CALIBRATION, length=PACKED_BYTES),
    Did.CALIBRATION_STORED: Permission(_EXTENDED, Level.CALIBRATION, length=1),
}
ROUTINES: Final[Mapping[int, Permission]] = {
    Routine.PRECONDITIONS: Permission(_BEYOND_DEFAULT, length=0),
    Routine.SELF_TEST: Permission(_PROGRAMMING, Level.PROGRAMMING, length=0),
    Routine.ACTIVATE: Permission(_PROGRAMMING, Level.PROGRAMMING, length=0),
    Routine.CONFIRM: Permission(_PROGRAMMING, Level.PROGRAMMING, length=0),
    Routine.REVERT: Permission(_PROGRAMMING, Level.PROGRAMMING, length=0),
    Routine.ERASE: Permission(_PROGRAMMING, Level.PROGRAMMING, length=4 + 32),
    Routine.CHECK: Permission(_PROGRAMMING, Level.PROGRAMMING, length=0),
}
