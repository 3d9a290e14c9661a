"""What a bus offers to a node; real, virtual and simulated buses share it."""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, Protocol

from can_bridge.wire.frame import Frame


class BusState(Enum):
    """The state of a CAN controller (ISO 11898-1, fault confinement)."""

    ERROR_ACTIVE = auto()
    ERROR_PASSIVE = auto()
    BUS_OFF = auto()


@dataclass(frozen=True, kw_only=True)
class BusHealth:
    """What a node's CAN controller knows of its errors.

    Attributes:
        tx_errors, rx_errors: its error counters; above 127 it is error-passive, from 256 transmit errors on bus-off.
        bus_off: how often it went bus-off since power-on.
    """

    state: BusState = BusState.ERROR_ACTIVE
    tx_errors: int = 0
    rx_errors: int = 0
    bus_off: int = 0


HEALTHY: Final = BusHealth()
"""Also the health that a bus reports without knowing it."""


class Bus(Protocol):
    """One node's connection: sends frames, and returns received ones without waiting."""

    def send(self, frame: Frame) -> None:
        """Hand over one frame; raises BusError if the bus does not take it."""

    def receive_all(self) -> list[Frame]:
        """Everything that has arrived, oldest first, without waiting; raises BusError if the bus failed."""


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
