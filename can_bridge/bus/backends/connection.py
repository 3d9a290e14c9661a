"""A connection to an open python-can bus. It sends and receives single messages, and can close a failed bus."""

import struct
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, ClassVar, Final, Self

import can

from can_bridge.bus.conversion import id_text, to_message
from can_bridge.bus.interface import Rejection, UnusableReceptionError
from can_bridge.wire.frame import Frame
from contract.config.vehicle import SIMULATED, BusConfig
from contract.errors import BusError, ConfigError, install
from contract.runtime.copies import NeverCopied

QUEUE_SIZE: Final = 1024
"""Largest number of frames in the receive queue of a virtual bus, and in the result of one call of `receive_all`."""

SETTLE_S: Final = 2.0
"""Time in s for a serial adapter to start after its port is opened, because many adapters then reset."""

OWN_CONFIGURATION: Final = "python-can"
"""Value of `bus.interface` that lets python-can's own configuration (can.conf, environment) select the interface."""


def open_backend(config: BusConfig) -> tuple[can.BusABC, str]:
    """Open the configured bus, and return it with its python-can interface. Raises BusError if it cannot be opened."""
    _check_known(config.interface)
    # Vendors' drivers raise exceptions of any type, for example if the driver's library is missing.
    try:
        if config.interface == OWN_CONFIGURATION:
            loaded: dict[str, Any] = {**can.util.load_config(context=config.channel)}
            interface, options = loaded.pop("interface"), {k: v for k, v in loaded.items() if v is not None}
        else:
            interface, options = config.interface, {"channel": config.channel, **_options(config)}
        return _constructed(interface, options), interface
    except Exception as error:
        is_missing = isinstance(error, ImportError | can.CanInterfaceNotImplementedError)
        hint = f"; {install('bus')}" if is_missing and config.interface in ("udp_multicast", "slcan") else ""
        raise BusError(f"CAN bus {config.interface} {config.channel!r}: {one_line(error)}{hint}") from error


def one_line(error: BaseException) -> str:
    """Return an error's message on one line, or the name of its type if it has no message."""
    return " ".join(str(error).split()) or type(error).__name__


def _check_known(interface: str) -> None:
    known = (OWN_CONFIGURATION, *sorted(can.VALID_INTERFACES))
    if interface not in known:
        reason, allowed = "python-can does not know it", (SIMULATED, *known)
        if interface == SIMULATED:
            reason, allowed = "it runs in virtual time, without real devices", known
        raise BusError(f"bus.interface = {interface}: {reason}; must be one of {', '.join(allowed)}")


def _options(config: BusConfig) -> Mapping[str, Any]:
    is_fd = config.frames == "fd"
    match config.interface:
        case "virtual":
            protocol = can.CanProtocol.CAN_FD if is_fd else can.CanProtocol.CAN_20
            return {"rx_queue_size": QUEUE_SIZE, "preserve_timestamps": True, "protocol": protocol}
        case "udp_multicast":
            return {"hop_limit": 0}
        case "slcan" if is_fd:
            # The clock in Hz; then each phase's bit rate, and the position of its sample point in a bit, in percent.
            phases = config.nominal_bitrate, 80.0, config.data_bitrate, 80.0
            timing = can.BitTimingFd.from_sample_point(80_000_000, *phases)
            return {"timing": timing, "sleep_after_open": SETTLE_S}
        case "slcan":
            return {"bitrate": config.nominal_bitrate, "sleep_after_open": SETTLE_S}
        case "socketcan":
            return {"fd": is_fd}
    return {"fd": is_fd, "bitrate": config.nominal_bitrate} | ({"data_bitrate": config.data_bitrate} if is_fd else {})


def _constructed(interface: str, options: dict[str, Any]) -> can.BusABC:
    """Open the bus. Our own backends replace the backends of python-can that fail on some received data."""
    if interface == "udp_multicast":
        from can_bridge.bus.backends.udp_multicast import UdpMulticastBus

        return UdpMulticastBus(**options)
    if interface == "slcan":
        from can_bridge.bus.backends.slcan import SlcanBus

        return SlcanBus(**options)
    return can.Bus(interface=interface, ignore_config=True, **options)


GARBAGE_LIMIT: Final = 1000
"""Largest number of consecutive errors of a backend's parser; at the next error the bus counts as failed. A call that
receives a message or nothing resets the count. Without this limit, a failed backend that raises an error in every call
would look like endless noise. `UnusableReceptionError`, which only our own backends raise, is not counted."""

_UNREADABLE: Final = (ValueError, IndexError, struct.error)
"""Exceptions that the backends' parsers raise for invalid data."""


class OpenBus(NeverCopied):
    INSTEAD: ClassVar = "it belongs to this process; open another connection"

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._unreadable_in_a_row = 0

    def close(self) -> None:
        """Disconnect from the bus. A second call does nothing. An adapter that was removed causes no error."""
        # Closing an unplugged adapter may raise an error, which would hide the error that ended the work.
        with suppress(can.CanError, OSError):
            self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, message: can.Message, name: str, timeout_s: float) -> None:
        try:
            self._bus.send(message, timeout=timeout_s)
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(f"frame {name} was not sent: {one_line(error)}") from error

    def _received(self, timeout_s: float) -> can.Message | Rejection | None:
        """Receive once: return a message, why the data are none, or None. Raises BusError if only garbage arrives."""
        try:
            message = self._bus.recv(timeout=timeout_s)
        except UnusableReceptionError as refused:
            return refused.reason
        except (can.CanError, OSError, *_UNREADABLE) as error:
            # Backends wrap the original error, so the `__cause__` of a CanError shows whether invalid data caused it.
            if not isinstance(error.__cause__ or error, _UNREADABLE):
                raise BusError(f"CAN bus failed: {one_line(error)}") from error
            self._unreadable_in_a_row += 1
            if self._unreadable_in_a_row > GARBAGE_LIMIT:
                text = f"CAN bus failed: {GARBAGE_LIMIT} unreadable receptions in a row; the last error is: {error}"
                raise BusError(text) from error
            return Rejection.GARBAGE
        self._unreadable_in_a_row = 0
        return message


class RawBus(OpenBus):
    """A bus for tools. It delivers all received data as python-can's messages, including remote and error frames. A
    node uses `can_bridge.bus.backends.python_can` instead, to receive only valid data frames that the node selected."""

    def receive_message(self, timeout_s: float) -> can.Message | None:
        """Return the next message, valid or not; None if none came or it is unreadable. Raises BusError if it fails."""
        message = self._received(timeout_s)
        return None if isinstance(message, Rejection) else message

    def send_frame(self, frame: Frame) -> None:
        """Send one frame. Raises BusError if the bus failed or does not accept the frame within 0.1 s."""
        self._send(to_message(frame), id_text(frame), 0.1)


def open_bus(config: BusConfig) -> RawBus:
    """Connect to a bus. Raises ConfigError for the simulated bus, and BusError as `open_backend` does."""
    if config.interface == SIMULATED:
        raise ConfigError(
            "bus.interface = simulated: that bus exists only within a run; name a real bus, e.g. "
            "--set bus.interface=socketcan --set bus.channel=can0, or a log if the command accepts a log"
        )
    return RawBus(open_backend(config)[0])
