"""A bus as a tool sees it: whatever is on the wire, as python-can's messages, remote and error frames among them.

A node needs `can_bridge.bus.backends.python_can`, which lets nothing through but sound data frames that it asked for.
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
    """One connection. Use as a context manager, or `close` it."""

    def receive_message(self, timeout_s: float) -> can.Message | None:
        """The next message of any kind, sound or not, or None if none that could be read came within `timeout_s`.
        Raises BusError if the bus failed, or yields nothing but garbage."""
        message = self._received(timeout_s)
        return None if isinstance(message, Rejection) else message

    def send_message(self, message: can.Message, *, timeout_s: float = 0.1) -> None:
        """Send one message of any kind, waiting at most `timeout_s`. Raises BusError if the bus does not take it in
        time, or failed."""
        self._send(message, id_text(message), timeout_s)


def open_bus(config: BusConfig) -> RawBus:
    """Connect to a bus that others are on. Raises ConfigError for the simulated bus, which no other process can join;
    BusError naming interface and channel, if that cannot be opened."""
    if config.interface == SIMULATED:
        raise ConfigError(
            "bus.interface = simulated: that bus exists within a run only; name a real one, e.g. "
            "--set bus.interface=socketcan --set bus.channel=can0, or a log where the command takes one"
        )
    return RawBus(open_backend(config)[0])


def frame_of(message: can.Message) -> Frame | None:
    """The frame in a message, its identifier of either length; None for remote, error and unsound frames. A time before
    0, as logs have them before a trigger, becomes 0."""
    if message.timestamp < 0.0:
        message = copy(message)
        message.timestamp = 0.0
    frame = conversion.frame_of(message)
    return frame if isinstance(frame, Frame) else None


def id_text(message: can.Message | Frame) -> str:
    """An identifier as candump writes it: three hexadecimal digits, or eight if it is extended."""
    if isinstance(message, Frame):
        return f"{message.frame_id:08X}" if message.is_extended else f"{message.frame_id:03X}"
    return f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"
