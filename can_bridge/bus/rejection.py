"""Why a reception did not become a frame."""

from enum import Enum


class Rejection(Enum):
    """One reason a reception; the values are what tables and reports show."""

    GARBAGE = "unreadable"
    """No CAN frame: a datagram or line of another making, an identifier or a time out of range."""
    WRONG_LENGTH = "wrong length"
    """Cut off, or a length that the frame's format does not have. Of a length that CAN has but its message has not,
    the end-to-end check refuses it."""
    REMOTE = "remote frame"
    ERROR_FRAME = "error frame"
    """The controller's report on the bus or on itself; see `PythonCanBus.health`."""
    EXTENDED = "29-bit identifier"
    WRONG_FORMAT = "CAN FD for classic, or the reverse"
    """A CAN FD frame where `bus.frames` is classic, or one of our messages in the format that it does not have."""
    OTHER_ID = "another identifier"
    OWN = "own frame heard again"
    ADAPTER = "adapter refused a command"
    """A serial adapter answered BEL: to a frame that it did not send, or to a command at its opening."""


class UnusableReceptionError(Exception):
    """What a backend of ours received and cannot hand over; the backend itself is sound."""

    def __init__(self, reason: Rejection) -> None:
        super().__init__(reason.value)
        self.reason = reason
