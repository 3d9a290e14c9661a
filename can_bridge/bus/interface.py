"""The interface through which a node uses a bus. Real, virtual and simulated buses have this interface."""

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
        tx_errors, rx_errors: error counters; error-passive if one is above 127, bus-off if `tx_errors` is above 255.
        bus_off: number of times that the controller went bus-off since power-on.
    """

    state: BusState = BusState.ERROR_ACTIVE
    tx_errors: int = 0
    rx_errors: int = 0
    bus_off: int = 0


HEALTHY: Final = BusHealth()
"""Health without errors. A bus whose controller does not report its health also has this value."""


class Bus(Protocol):
    """A node's connection to a bus. It sends frames, and returns received frames without waiting."""

    def send(self, frame: Frame) -> None:
        """Send one frame; raises BusError if the bus does not accept the frame."""

    def receive_all(self) -> list[Frame]:
        """Return all frames that have arrived, oldest first, without waiting; raises BusError if the bus failed."""


class Rejection(Enum):
    """The reasons to reject a reception. Tables and reports show the values as text."""

    GARBAGE = "unreadable"
    """No CAN frame: a datagram or line of another format, or an identifier or time out of range."""
    WRONG_LENGTH = "wrong length"
    """A length that is impossible in the frame's format; the end-to-end check rejects any other wrong length."""
    REMOTE = "remote frame"
    ERROR_FRAME = "error frame"
    """The controller's report on the bus or on itself; see `PythonCanBus.health`."""
    EXTENDED = "29-bit identifier"
    WRONG_FORMAT = "CAN FD for classic, or the reverse"
    """A CAN FD frame on a bus whose setting `bus.frames` is classic, or one of our messages in the wrong format."""
    OTHER_ID = "another identifier"
    OWN = "own frame received again"
    ADAPTER = "adapter refused a command"
    """A serial adapter answered BEL: it refused to send a frame, or a command while it was being opened."""


class UnusableReceptionError(Exception):
    """An error that our own backends raise for unusable received data. The backend continues to work."""

    def __init__(self, reason: Rejection) -> None:
        super().__init__(reason.value)
        self.reason = reason
