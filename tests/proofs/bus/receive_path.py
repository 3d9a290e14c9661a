"""The whole receive path, from what a backend hears to a parsed message, fed by hand: no socket, no port, no clock.

The backends are the real ones; only the system's call that would hand over a datagram or bytes is ours.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any, Final

import can

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.backends.slcan import LINE_LIMIT, SlcanBus
from can_bridge.bus.backends.udp_multicast import UdpMulticastBus
from can_bridge.bus.interface import Rejection
from can_bridge.e2e.receiver import E2eReceiver
from can_bridge.secoc.key import KEY_LENGTH, Key
from can_bridge.secoc.securing import VerifierState, verified
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import CLASSIC, FD, SECURED
from can_bridge.wire.message_specs import MessageSpec
from contract.config.vehicle import E2eConfig
from tests.can_bridge.bus.backends.peers import ScriptedBus

_SENDER: Final = ("127.0.0.1", 1)
_E2E: Final = E2eConfig()
MESSAGES: Final = [
    message for used in (FD, CLASSIC, SECURED) for message in (used.pressure, used.speed, used.command, used.status)
]
KEY: Final = Key(bytes(range(KEY_LENGTH)))
"""The key of the secured messages."""


class ReceivePath:
    """One node for each backend; each call feeds one of them and follows what comes out to its end. `authentic` are the
    frames of secured messages that came as far as their end-to-end check; the caller may clear it."""

    def __init__(self) -> None:
        self._datagrams, self._port, self._messages = _FedUdpBus(), _FedPort(), ScriptedBus([])
        self._lines = _FedSlcanBus(self._port)
        self.udp, self.slcan = PythonCanBus(self._datagrams), PythonCanBus(self._lines)
        self.driver = PythonCanBus(self._messages, linux_error_frames=True)
        self.buses = (self.udp, self.slcan, self.driver)
        self._messages_in = [(E2eReceiver(message.spec, _E2E), message.parse) for message in MESSAGES]
        self._verifiers = {message.spec: VerifierState() for message in MESSAGES if message.spec.is_secured}
        self.authentic: list[Frame] = []
        self._time = 0.0

    def datagrams(self, contents: Iterable[bytes]) -> list[Frame]:
        """Datagrams a second apart, so that none passes for another's copy."""
        for content in contents:
            self._time += 1.0
            self._datagrams.waiting.append((content, _SENDER, self._time))
        return self._followed(self.udp, len(self._datagrams.waiting))

    def lines(self, content: bytes) -> list[Frame]:
        """Bytes of a serial line, whole lines or not."""
        self._port.waiting += content
        frames = self._followed(self.slcan)
        if self._lines.is_left_over:
            raise AssertionError("serial bytes were left over")
        return frames

    def messages(self, contents: Iterable[can.Message]) -> list[Frame]:
        """Messages as any driver of python-can's may give them."""
        self._messages.script.extend(contents)
        return self._followed(self.driver, len(self._messages.script))

    def totals(self) -> tuple[int, dict[Rejection, int]]:
        """Frames accepted by the three buses, and receptions refused by reason."""
        refused = {reason: sum(bus.rejected[reason] for bus in self.buses) for reason in Rejection}
        return sum(bus.accepted for bus in self.buses), refused

    def _followed(self, bus: PythonCanBus, fed: int | None = None) -> list[Frame]:
        """All frames that came, after end-to-end check and parser; AssertionError where the books do not balance. `fed`
        receptions went in; None for serial lines, whose number is a matter of their ends."""
        before, received = bus.accepted, -1
        expected = None if fed is None else bus.received + fed
        frames: list[Frame] = []
        while bus.received != received:
            received = bus.received
            frames += bus.receive_all()
        if len(frames) != bus.accepted - before or bus.received != bus.accepted + sum(bus.rejected.values()):
            raise AssertionError(f"{bus.received} received: {bus.accepted} accepted, {bus.rejected} refused")
        if expected not in (None, bus.received):
            raise AssertionError(f"{bus.received} received, {expected} went in")
        for receiver, parse in self._messages_in:
            spec = receiver.spec
            accepted = receiver.tick(self._authenticated(frames, spec)).accepted
            if accepted is not None:
                parse(accepted.data[: spec.protected])
            for frame in frames:
                # Damaged content must not harm a parser either, were it to pass the check.
                if frame.frame_id == spec.frame_id:
                    parse(frame.data)
                    parse(frame.data[: spec.protected])
        return frames

    def _authenticated(self, frames: list[Frame], spec: MessageSpec) -> Sequence[Frame]:
        """Those that a message's end-to-end check gets to see."""
        if spec not in self._verifiers:
            return frames
        self._verifiers[spec], passed, _ = verified(self._verifiers[spec], frames, spec=spec, key=KEY)
        self.authentic += [frame for frame in passed if frame.frame_id == spec.frame_id and not frame.is_extended]
        return passed


class _FedUdpBus(UdpMulticastBus):
    def __init__(self) -> None:
        can.BusABC.__init__(self, "fed")
        self.waiting: deque[tuple[bytes, tuple[str, int], float]] = deque()
        socket: Any = SimpleNamespace(recv=lambda timeout: self.waiting.popleft() if self.waiting else None)
        self._multicast = socket
        self._can_protocol = can.CanProtocol.CAN_FD
        self._remember_nothing()
        can.BusABC.shutdown(self)  # nothing to close: python-can would remind us of it


class _FedPort:
    """A stand-in for pyserial's port."""

    is_open = True

    def __init__(self) -> None:
        self.waiting = bytearray()

    @property
    def in_waiting(self) -> int:
        return len(self.waiting)

    def read(self, size: int) -> bytes:
        content = bytes(self.waiting[:size])
        del self.waiting[:size]
        return content


class _FedSlcanBus(SlcanBus):
    def __init__(self, port: _FedPort) -> None:
        can.BusABC.__init__(self, "fed")
        self.serialPortOrig = port
        self._buffer, self._queue = bytearray(), SimpleQueue[str]()
        can.BusABC.shutdown(self)

    @property
    def is_left_over(self) -> bool:
        """Whether more bytes wait than a line may have."""
        return bool(self.serialPortOrig.waiting) or len(self._buffer) > LINE_LIMIT
