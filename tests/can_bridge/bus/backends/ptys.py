"""Pseudo-terminals in place of a serial adapter."""

import os
import pty
import select
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass


@dataclass(frozen=True)
class Adapter:
    """The adapter's end of a serial line.

    Attributes:
        port: the name of the computer's end.
    """

    fd: int
    port: str

    def write(self, content: bytes) -> None:
        """Say something, whole."""
        while content:
            content = content[os.write(self.fd, content) :]

    def read(self) -> bytes:
        """All that was said to it."""
        heard = b""
        while select.select([self.fd], [], [], 0.0)[0]:
            heard += os.read(self.fd, 4096)
        return heard


@contextmanager
def adapter() -> Iterator[Adapter]:
    """One serial line; both ends are closed with the block."""
    controller, port = pty.openpty()
    tty.setraw(port)
    try:
        yield Adapter(controller, os.ttyname(port))
    finally:
        for fd in (controller, port):
            with suppress(OSError):  # a test may have pulled the plug
                os.close(fd)
