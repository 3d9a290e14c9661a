"""Pseudo-terminals in place of a serial adapter."""

import os
import pty
import select
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from unittest.mock import patch

PATIENCE_S = 10.0
"""How long a test waits before it fails; never reached when all is well."""


@dataclass(frozen=True)
class Adapter:
    """The adapter's end of a serial line; `port` is the name of the computer's end."""

    fd: int
    port: str

    def write(self, content: bytes) -> None:
        """Send all of it."""
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
