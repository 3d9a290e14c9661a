"""A bus for tools. It delivers all received data as python-can's messages, including remote and error frames.

A node uses `can_bridge.bus.backends.python_can` instead, to receive only valid data frames that the node selected.
"""

from copy import copy

import can

from can_bridge.bus import conversion
from can_bridge.bus.backends.connection import OpenBus, open_backend
from can_bridge.bus.interface import Rejection
from can_bridge.wire.frame import Frame
from contract.config.vehicle import SIMULATED, BusConfig
from contract.errors import ConfigError


class RawBus(OpenBus):
    def receive_message(self, timeout_s: float) -> can.Message | None:
        """Return the next message, valid or not; None if none came or it is unreadable. Raises BusError if it fails."""
        message = self._received(timeout_s)
        return None if isinstance(message, Rejection) else message

    def send_frame(self, frame: Frame) -> None:
        """Send one frame. Raises BusError if the bus failed or does not accept the frame within 0.1 s."""
        self._send(conversion.to_message(frame), id_text(frame), 0.1)


def open_bus(config: BusConfig) -> RawBus:
    """Connect to a bus. Raises ConfigError for the simulated bus, and BusError as `open_backend` does."""
    if config.interface == SIMULATED:
        raise ConfigError(
            "bus.interface = simulated: that bus exists only within a run; name a real bus, e.g. "
            "--set bus.interface=socketcan --set bus.channel=can0, or a log if the command accepts a log"
        )
    return RawBus(open_backend(config)[0])


def frame_of(message: can.Message) -> Frame | None:
    """Return the data frame in a message, with an 11- or 29-bit identifier; None for remote, error and invalid frames.
    A time below 0 becomes 0; a log has such times before a trigger."""
    if message.timestamp < 0.0:
        message = copy(message)
        message.timestamp = 0.0
    frame = conversion.frame_of(message)
    return frame if isinstance(frame, Frame) else None


def id_text(frame: Frame) -> str:
    """Return an identifier as candump writes it: three hexadecimal digits, or eight for 29 bits."""
    return f"{frame.frame_id:08X}" if frame.is_extended else f"{frame.frame_id:03X}"
