"""The interface of a bus to a node; real, virtual and simulated buses have it."""

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
    """The error state of a node's CAN controller.

    Attributes:
        tx_errors, rx_errors: error counters. Above 127 it is error-passive, from 256 transmit errors bus-off.
        bus_off: how often it went bus-off since power-on.
    """

    state: BusState = BusState.ERROR_ACTIVE
    tx_errors: int = 0
    rx_errors: int = 0
    bus_off: int = 0


HEALTHY: Final = BusHealth()
"""Health without errors; also reported by a bus that does not know its controller's health."""


class Bus(Protocol):
    """A node's connection to a bus: sends frames, and returns received frames without waiting."""

    def send(self, frame: Frame) -> None:
        """Send one frame; raises BusError if the bus does not take it."""

    def receive_all(self) -> list[Frame]:
        """Return all frames that have arrived, oldest first, without waiting; raises BusError if the bus failed."""


class Rejection(Enum):
    """Reasons to reject a reception; tables and reports show the values."""

    GARBAGE = "unreadable"
    """No CAN frame: a datagram or line of another format, or an identifier or time out of range."""
    WRONG_LENGTH = "wrong length"
    """The data are truncated, or their length is impossible in the frame's format. A length that is possible but not
    the message's fails the end-to-end check."""
    REMOTE = "remote frame"
    ERROR_FRAME = "error frame"
    """The controller's report on the bus or on itself; see `PythonCanBus.health`."""
    EXTENDED = "29-bit identifier"
    WRONG_FORMAT = "CAN FD for classic, or the reverse"
    """A CAN FD frame although `bus.frames` is classic, or one of our messages in the wrong format."""
    OTHER_ID = "another identifier"
    OWN = "own frame received again"
    ADAPTER = "adapter refused a command"
    """A serial adapter answered BEL: to a frame that it did not send, or to a command when it was opened."""


class UnusableReceptionError(Exception):
    """One of our backends received data that it cannot return; the backend itself still works."""

    def __init__(self, reason: Rejection) -> None:
        super().__init__(reason.value)
        self.reason = reason
