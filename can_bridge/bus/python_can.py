"""A bus of python-can behind this room's own frames and errors.

The adapter exists for the traps: `virtual` blocks for ever in `send` without a timeout when a peer stops reading,
one garbage datagram ends python-can's own Notifier, and garbage on a serial line comes out as a bare ValueError.
Here sending always ends, and what cannot be read is counted and skipped.
"""

import time
from collections.abc import Collection
from types import TracebackType
from typing import Any, Final, Self

import can

from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError

QUEUE_SIZE: Final = 1024
"""Frames a virtual bus holds for a reader, and the most one `receive_all` returns."""

GARBAGE_LIMIT: Final = 1000
"""Unreadable receptions in a row, without an idle moment or a good frame between them, after which the bus counts as
failed: a dead backend that raises on every call would otherwise look like endless noise."""

_SAMPLE_POINT: Final = 80.0
"""Percent, for both bit rates, where this adapter sets the bit timing."""
_CLOCK_HZ: Final = 80_000_000

_EXTRAS: Final = {"udp_multicast": "python-can[multicast]", "slcan": "python-can[serial]"}


class PythonCanBus:
    """One node's connection. Use as a context manager, or `close` it.

    One thread may send while another receives.

    Attributes:
        rejected: receptions that were no data frame with an 11-bit identifier: garbage, error and remote frames.
    """

    def __init__(self, bus: can.BusABC, *, accept: Collection[int] | None = None) -> None:
        """Take over an open python-can bus.

        Args:
            bus: closed together with this object.
            accept: frame ids to receive, None for all. python-can's own filter would make a reception without
                waiting stop at the first frame it drops, and udp_multicast hears its own frames.
        """
        self._bus = bus
        self._accept = None if accept is None else frozenset(accept)
        self._garbage_in_a_row = 0
        self.rejected = 0

    @classmethod
    def open(cls, config: BusConfig, *, accept: Collection[int] | None = None) -> Self:
        """Connect as configured.

        A `virtual` bus keeps the timestamps that frames are sent with; the others stamp on reception, in ns since the
        epoch, to the resolution of a float. `socketcan` takes the bit rates that its network device was set up with.
        `udp_multicast` stays on this machine.

        Raises:
            BusError: naming interface and channel, if that cannot be opened.
        """
        try:
            bus = can.Bus(interface=config.interface, channel=config.channel, ignore_config=True, **_options(config))
        except (can.CanError, OSError, ValueError) as error:
            hint = ""
            if isinstance(error, can.CanInterfaceNotImplementedError) and config.interface in _EXTRAS:
                hint = f"; try pip install '{_EXTRAS[config.interface]}'"
            raise BusError(f"CAN bus {config.interface} {config.channel!r}: {error}{hint}") from error
        return cls(bus, accept=accept)

    def send(self, frame: Frame, *, timeout_s: float = 0.005) -> None:
        """Send one frame, waiting at most `timeout_s`.

        On a virtual bus, peers other than the one that does not read have received the frame even if this fails.

        Raises:
            BusError: if the bus does not take the frame in time, or failed.
            ValueError: for a negative timeout.
        """
        if timeout_s < 0:
            raise ValueError(f"timeout_s = {timeout_s}: must not be negative")
        try:
            self._bus.send(to_message(frame), timeout=timeout_s)
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(f"frame {frame.frame_id:#05x} was not sent: {_reason(error)}") from error

    def receive(self, timeout_s: float) -> Frame | None:
        """The next frame, or None if none came within `timeout_s`.

        Raises:
            BusError: if the bus failed, or yields nothing but garbage.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            left = max(0.0, deadline - time.monotonic())
            frame, idle = self._poll(left)
            if frame is not None or idle or left == 0.0:
                return frame

    def receive_all(self) -> list[Frame]:
        """Frames that have already arrived, oldest first, at most QUEUE_SIZE; never waits.

        Raises:
            BusError: as `receive`.
        """
        frames: list[Frame] = []
        while len(frames) < QUEUE_SIZE:
            frame, idle = self._poll(0.0)
            if idle:
                break
            if frame is not None:
                frames.append(frame)
        return frames

    def close(self) -> None:
        """Disconnect; closing twice does nothing more."""
        self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _poll(self, timeout_s: float) -> tuple[Frame | None, bool]:
        """One reception: the frame if an accepted one came, and whether nothing came at all."""
        try:
            message = self._bus.recv(timeout=timeout_s)
        except (can.CanError, OSError, ValueError, TypeError, LookupError, AttributeError) as error:
            self._reject_or_fail(error)
            return None, False
        if message is None:
            self._garbage_in_a_row = 0
            return None, True
        frame = from_message(message)
        if frame is None:
            self.rejected += 1
            return None, False
        self._garbage_in_a_row = 0
        if self._accept is not None and frame.frame_id not in self._accept:
            return None, False
        return frame, False

    def _reject_or_fail(self, error: Exception) -> None:
        # Backends wrap what went wrong. A fault of the system or of python-can itself ends the bus; anything else is
        # an error of their parser on what it was sent.
        root = error.__cause__ or error
        if isinstance(root, OSError | can.CanError):
            raise BusError(f"CAN bus failed: {_reason(error)}") from error
        self.rejected += 1
        self._garbage_in_a_row += 1
        if self._garbage_in_a_row > GARBAGE_LIMIT:
            raise BusError(f"CAN bus failed: {GARBAGE_LIMIT} unreadable receptions in a row, last: {error}") from error
        # slcan keeps an undecodable line in its buffer and would fail on it at every call.
        flush = getattr(self._bus, "flush", None)
        if flush is not None:
            flush()


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__


def to_message(frame: Frame) -> can.Message:
    """The frame as python-can's; times become float seconds, exact to the ns for the first weeks after zero."""
    return can.Message(
        arbitration_id=frame.frame_id,
        data=frame.data,
        timestamp=frame.timestamp_ns / 1e9,
        is_extended_id=frame.is_extended,
        is_fd=frame.is_fd,
        bitrate_switch=frame.is_fd,
    )


def from_message(message: can.Message) -> Frame | None:
    """The frame in a python-can message; None unless it is a sound data frame with an 11-bit identifier.

    Whether an FD frame switched its bit rate is not kept.
    """
    if message.is_extended_id or message.is_remote_frame or message.is_error_frame:
        return None
    # A backend shows a cut-off line only by the two lengths.
    if message.dlc != len(message.data):
        return None
    try:
        return Frame(
            frame_id=message.arbitration_id,
            data=bytes(message.data),
            timestamp_ns=round(message.timestamp * 1e9),
            is_fd=message.is_fd,
        )
    except (ValueError, OverflowError, TypeError):
        # udp_multicast passes on a datagram's values whatever their type and range.
        return None


def _options(config: BusConfig) -> dict[str, Any]:
    match config.interface:
        case "virtual":
            return {"rx_queue_size": QUEUE_SIZE, "preserve_timestamps": True, "protocol": can.CanProtocol.CAN_FD}
        case "udp_multicast":
            return {"fd": True, "hop_limit": 0}
        case "slcan":
            timing = can.BitTimingFd.from_sample_point(
                f_clock=_CLOCK_HZ,
                nom_bitrate=config.nominal_bitrate,
                nom_sample_point=_SAMPLE_POINT,
                data_bitrate=config.data_bitrate,
                data_sample_point=_SAMPLE_POINT,
            )
            return {"timing": timing}
        case "socketcan":
            return {"fd": True}
        case _:
            return {}
