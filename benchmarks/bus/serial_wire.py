"""Two serial CAN adapters with a CAN bus between them, of pseudo-terminals and a thread, where there are none."""

import os
import pty
import re
import select
import tty
from collections.abc import Iterable
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Final, Self

_FRAME: Final = re.compile(rb"[tTdDbBrR].*", re.DOTALL)
_POLL_S: Final = 0.05


class SerialWire:
    """Runs while the `with` block does. What one computer sends the other receives; the sender gets `z` for it.

    Other lines are commands to the adapter, answered with an empty line.

    Attributes:
        ports: names of the two computers' serial ports.
        frames: lines forwarded so far.
    """

    def __init__(self) -> None:
        pairs = [pty.openpty() for _ in range(2)]
        self._adapters = [controller for controller, _ in pairs]
        self._computers = [port for _, port in pairs]
        for fd in self._computers:
            tty.setraw(fd)
        self.ports: tuple[str, ...] = tuple(os.ttyname(fd) for fd in self._computers)
        self.frames = 0
        self._lock = Lock()
        self._stop = Event()
        self._thread = Thread(target=self._run, name="serial-wire", daemon=True)

    def disturb(self, lines: Iterable[bytes]) -> None:
        """Put lines of no sender, ended as they are, between the frames to both computers."""
        for line in lines:
            for fd in self._adapters:
                self._say(fd, line)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        for fd in (*self._adapters, *self._computers):
            os.close(fd)

    def _run(self) -> None:
        waiting = {fd: b"" for fd in self._adapters}
        while not self._stop.is_set():
            for fd in select.select(self._adapters, [], [], _POLL_S)[0]:
                *lines, waiting[fd] = (waiting[fd] + os.read(fd, 4096)).split(b"\r")
                other = next(item for item in self._adapters if item != fd)
                for line in lines:
                    is_frame = _FRAME.fullmatch(line) is not None
                    if is_frame:
                        self._say(other, line + b"\r")
                        self.frames += 1
                    self._say(fd, b"z\r" if is_frame else b"\r")

    def _say(self, fd: int, content: bytes) -> None:
        with self._lock:
            while content:
                content = content[os.write(fd, content) :]
