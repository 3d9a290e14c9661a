"""A python-can bus with this package's frames and errors, and a thread that reads it.

A node must avoid these defects of python-can: on a `virtual` bus, `send` without a timeout waits for ever if another
node stops reading; one garbage datagram ends python-can's Notifier; garbage on a serial line raises a bare ValueError.
Here `send` never waits for ever, and each reception is returned, or counted by the reason for its rejection.
"""

import os
import socket
import struct
import sys
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from threading import Event, Thread
from typing import Final, Self

import can

from can_bridge.bus.backends.connection import QUEUE_SIZE, OpenBus, open_backend
from can_bridge.bus.conversion import frame_of, to_message
from can_bridge.bus.interface import HEALTHY, BusHealth, BusState, Rejection
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import SPECS
from contract.config.diagnosis import CanId
from contract.config.vehicle import BusConfig
from contract.errors import BusError

_CONTROLLER, _BUS_OFF, _RESTARTED, _COUNTERS = 0x004, 0x040, 0x100, 0x200
"""Error classes of Linux: CAN_ERR_CRTL (data byte 1 has the controller's state), CAN_ERR_BUSOFF, CAN_ERR_RESTARTED
(from bus-off) and, since kernel 6.0, CAN_ERR_CNT (data bytes 6 and 7 are the transmit and receive error counters)."""
_RX_OVERFLOW, _PASSIVE, _ACTIVE = 0x01, 0x10 | 0x20, 0x40
"""Bits of data byte 1 (CAN_ERR_CRTL_...): the controller lost received frames, is error-passive, is error-active."""
_LENGTH: Final = 8
"""Length of an error frame's data in bytes (CAN_ERR_DLC)."""


def health_after(health: BusHealth, classes: int, data: bytes) -> BusHealth:
    """Return the health after one error frame; `classes` is its identifier without flags. Only eight bytes count."""
    if len(data) != _LENGTH:
        return health
    controller = data[1] if classes & _CONTROLLER else 0
    # Kernels before 6.0 have no flag for the counters, and leave the bytes zero if a driver cannot read the counters.
    if classes & _COUNTERS or (classes & _CONTROLLER and any(data[6:8])):
        health = replace(health, tx_errors=data[6], rx_errors=data[7])
    if classes & _BUS_OFF:
        return replace(health, state=BusState.BUS_OFF, bus_off=health.bus_off + 1)
    if classes & _RESTARTED:
        # After recovery from bus-off, a controller is error-active with zero counters (ISO 11898-1, fault confinement).
        return replace(health, state=BusState.ERROR_ACTIVE, tx_errors=0, rx_errors=0)
    if health.state is BusState.BUS_OFF:
        return health
    if controller & _PASSIVE:
        return replace(health, state=BusState.ERROR_PASSIVE)
    if controller & _ACTIVE:
        return replace(health, state=BusState.ERROR_ACTIVE)
    return health


def lost_frames(classes: int, data: bytes) -> bool:
    """Return whether the controller reports that it dropped received frames."""
    return len(data) == _LENGTH and bool(classes & _CONTROLLER and data[1] & _RX_OVERFLOW)


_SO_MEMINFO: Final = 55
"""Linux socket option that returns nine numbers of 32 bits; the last one counts dropped receptions (sock_diag.h)."""
_MEMINFO: Final = struct.Struct("=9I")


def _dropped(fileno: int) -> int:
    """Return the number of receptions that a socket's full queue dropped; 0 if the system does not count them."""
    if sys.platform != "linux":
        return 0
    try:
        with socket.socket(fileno=os.dup(fileno)) as sock:
            return int(_MEMINFO.unpack(sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))[-1])
    except (OSError, struct.error):
        # The descriptor does not belong to a socket, or the kernel is older than 4.12.
        return 0


RECEPTION_LIMIT: Final = 4 * QUEUE_SIZE
"""Largest number of receptions that one call of `receive_all` reads, so that it ends even in a flood of frames."""

_IS_FD: Final = {CanId(spec.frame_id): spec.is_fd for spec in SPECS}

_Accept = Collection[CanId | int] | None
_Keep = Callable[[Frame, bool], None]


class PythonCanBus(OpenBus):
    """A node's connection to a python-can bus. One thread may send while another thread receives."""

    def __init__(
        self,
        bus: can.BusABC,
        *,
        accept: _Accept = None,
        is_classic: bool = False,
        linux_error_frames: bool = False,
        keep: _Keep = lambda frame, received: None,
    ) -> None:
        """Take over an open python-can bus. Closing this object closes the bus.

        Args:
            accept: identifiers to receive (an int means an 11-bit identifier); None for all 11-bit identifiers.
                python-can's own filter is not used, because a call that waits would end when the filter drops a frame.
            is_classic: whether to refuse CAN FD frames, sent and received.
            linux_error_frames: whether error frames have the form of `linux/can/error.h` and report on the controller.
            keep: called with each sent or accepted frame, and with True for a received frame or False for a sent frame.
        """
        super().__init__(bus)
        self._accept = None if accept is None else {CanId(one) if isinstance(one, int) else one for one in accept}
        self._is_classic = is_classic
        self._linux_error_frames = linux_error_frames
        self._keep = keep
        self._rejected = dict.fromkeys(Rejection, 0)
        self._health = HEALTHY
        self._overflow_reports = 0
        self._driver_was_off = False
        self.received = 0
        self.accepted = 0

    @classmethod
    def open(cls, config: BusConfig, *, accept: _Accept = None, keep: _Keep = lambda frame, received: None) -> Self:
        """Open the configured bus; for `accept` and `keep` see the constructor. Raises BusError as `open_backend` does.

        A `virtual` bus passes on the senders' timestamps; others stamp frames on reception, in ns since the epoch, with
        a float's resolution. `socketcan` uses its device's bit rates; frames on `udp_multicast` stay on this machine.
        """
        bus, interface = open_backend(config)
        is_classic, is_linux = config.frames == "classic", interface == "socketcan"
        return cls(bus, accept=accept, is_classic=is_classic, linux_error_frames=is_linux, keep=keep)

    @property
    def rejected(self) -> Mapping[Rejection, int]:
        """The number of rejected receptions for each reason; 0 for a reason that did not occur."""
        return dict(self._rejected)

    @property
    def overflows(self) -> int:
        """The known number of receptions lost because a queue was full. Linux counts the losses of `udp_multicast` and
        `socketcan`. Each report of a SocketCAN controller that it lost frames also counts as one loss."""
        try:
            in_kernel = _dropped(self._bus.fileno())
        except (can.CanError, OSError, NotImplementedError):
            in_kernel = 0
        return in_kernel + self._overflow_reports

    def health(self) -> BusHealth:
        """Return the CAN controller's health as far as SocketCAN's error frames and python-can's `state` show it. Only
        the value ERROR (bus-off) of `state` is used, because its other values differ between drivers."""
        try:
            is_off = self._bus.state is can.BusState.ERROR
        except (can.CanError, OSError, NotImplementedError):
            is_off = False
        if is_off != self._driver_was_off:
            self._driver_was_off = is_off
            state = BusState.BUS_OFF if is_off else BusState.ERROR_ACTIVE
            self._health = replace(self._health, state=state, bus_off=self._health.bus_off + is_off)
        return self._health

    def send(self, frame: Frame, *, timeout_s: float = 0.005) -> None:
        """Send one frame. Raises BusError if the bus fails or is too slow, or for a CAN FD frame on a classic bus."""
        if frame.is_fd and self._is_classic:
            raise BusError(f"frame {frame.frame_id:#05x} was not sent: it is CAN FD, but bus.frames = classic")
        self._send(to_message(frame), f"{frame.frame_id:#05x}", timeout_s)
        self._keep(frame, False)

    def receive(self, timeout_s: float) -> Frame | None:
        """Return the next frame, or None after `timeout_s`. Raises BusError if the bus failed or delivers garbage."""
        deadline = time.monotonic() + timeout_s
        while True:
            left = max(0.0, deadline - time.monotonic())
            message = self._received(left)
            frame = None if message is None else self._taken(message)
            if frame is not None or message is None or left == 0.0:
                return frame

    def receive_all(self) -> list[Frame]:
        """Return up to QUEUE_SIZE arrived frames, oldest first, without waiting. Raises BusError as `receive` does."""
        frames: list[Frame] = []
        for _ in range(RECEPTION_LIMIT):
            if len(frames) == QUEUE_SIZE or (message := self._received(0.0)) is None:
                break
            if (frame := self._taken(message)) is not None:
                frames.append(frame)
        return frames

    def _taken(self, message: can.Message | Rejection) -> Frame | None:
        frame = message if isinstance(message, Rejection) else self._judged(message)
        self.received += 1
        if isinstance(frame, Rejection):
            self._rejected[frame] += 1
            return None
        self.accepted += 1
        self._keep(frame, True)
        return frame

    def _judged(self, message: can.Message) -> Frame | Rejection:
        frame = frame_of(message)
        if isinstance(frame, Rejection):
            # An error frame may have an identifier that is not an int.
            is_report = frame is Rejection.ERROR_FRAME and isinstance(message.arbitration_id, int)
            if is_report and self._linux_error_frames:
                data = bytes(message.data)
                self._health = health_after(self._health, message.arbitration_id, data)
                self._overflow_reports += lost_frames(message.arbitration_id, data)
            return frame
        if frame.is_extended if self._accept is None else frame.identifier not in self._accept:
            return Rejection.EXTENDED if frame.is_extended else Rejection.OTHER_ID
        if (frame.is_fd and self._is_classic) or _IS_FD.get(frame.identifier, frame.is_fd) != frame.is_fd:
            return Rejection.WRONG_FORMAT
        return frame


class ReceiveThread:
    """A thread that reads `bus` during a `with` block, or until `close`. `fault` is the error that ended the thread."""

    def __init__(self, bus: PythonCanBus, deliver: Callable[[Frame], None]) -> None:
        """Prepare the thread, which calls `deliver` with each frame; `deliver` must return without waiting."""
        self.bus = bus
        self._deliver = deliver
        self._stop = Event()
        self._thread = Thread(target=self._run, name="can-receive", daemon=True)
        self.fault: BaseException | None = None

    def check(self) -> None:
        """Raise BusError if an error ended the thread. Call this method wherever the thread's frames are used."""
        if self.fault is not None:
            raise BusError(f"CAN reception ended: {self.fault}") from self.fault

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def close(self) -> None:
        self.__exit__()
        self.bus.close()

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                if (frame := self.bus.receive(0.05)) is not None:  # stopping takes at most this time in s
                    self._deliver(frame)
        except BaseException as error:  # noqa: BLE001 - an error that ends a thread is lost unless it is stored
            self.fault = error
