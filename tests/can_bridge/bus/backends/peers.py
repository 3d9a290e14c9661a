"""What a bus is connected to: a serial adapter on a pseudo-terminal, or given receptions; and what the bus got."""

import os
import pty
import select
import time
import tty
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from unittest.mock import patch

import can

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.interface import Rejection
from can_bridge.wire.frame import Frame

PATIENCE_S = 10.0
"""How long a test waits before it fails; never reached when all is well."""


@dataclass(frozen=True)
class Adapter:
    """The adapter's end of a serial line; `port` is the name of the computer's end."""

    fd: int
    port: str

    def write(self, content: bytes) -> None:
        while content:
            content = content[os.write(self.fd, content) :]

    def read(self, until: bytes, count: int = 1) -> bytes:
        """What was sent to it, up to the `count`-th `until`; less after PATIENCE_S.

        The kernel hands a terminal's bytes over in a thread of its own: they need not be there at once.
        """
        heard = b""
        while heard.count(until) < count and select.select([self.fd], [], [], PATIENCE_S)[0]:
            heard += os.read(self.fd, 4096)
        return heard


@contextmanager
def adapter() -> Iterator[Adapter]:
    """One serial line, which needs no time to start; both ends are closed with the block."""
    controller, port = pty.openpty()
    tty.setraw(port)
    try:
        with patch("can_bridge.bus.backends.connection.SETTLE_S", 0.0):
            yield Adapter(controller, os.ttyname(port))
    finally:
        for fd in (controller, port):
            with suppress(OSError):  # a test may have pulled the plug
                os.close(fd)


class ScriptedBus(can.BusABC):
    """A backend whose receptions are given: a message, None, or an error to raise."""

    state = can.BusState.ACTIVE

    def __init__(self, script: Iterable[can.Message | BaseException | None]) -> None:
        self.script = list(script)
        self.channel_info = "scripted"
        super().__init__(channel="scripted")
        self.shutdown()  # nothing to close: python-can would remind us of it

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        item = self.script.pop(0) if self.script else None
        if isinstance(item, BaseException):
            raise item
        return item, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanTimeoutError


def rejections(bus: PythonCanBus) -> dict[Rejection, int]:
    """The reasons that occurred; checks the books on the way."""
    assert bus.received == bus.accepted + sum(bus.rejected.values())
    return {reason: count for reason, count in bus.rejected.items() if count}


def collected(bus: PythonCanBus, count: int, frame_id: int = 0x120) -> list[Frame]:
    """Frames of one identifier, as many as are wanted; fewer after PATIENCE_S."""
    got: list[Frame] = []
    deadline = time.monotonic() + PATIENCE_S
    while len(got) < count and time.monotonic() < deadline:
        frame = bus.receive(0.1)
        if frame is not None and frame.frame_id == frame_id:
            got.append(frame)
    return got
