"""The log of a node on a real bus: a text file while the node runs, and a measurement at its end.

A process that is killed leaves the text file `.NAME.PID.log`, in candump's format, in the measurement's folder.
"""

import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread
from typing import Final

import can

from can_bridge.bus.conversion import to_message
from can_bridge.logs.log_reader import CanLog
from can_bridge.tools.measurement import check_measurement, write_measurement
from can_bridge.wire.frame import Frame
from contract.atomic import leads_to
from contract.errors import StillwakeError

_PAUSE_S: Final = 0.05
"""Pause in s between two writes: short, because a control step may have to wait for a write."""


@contextmanager
def live_log(path: Path | None) -> Iterator[Callable[[Frame, bool], None]]:
    """Yield a function that stores a frame and whether the frame was received. Any thread may call this function, and
    the function never waits. When the `with` block ends, also by an error, the measurement is written. Without a path
    nothing is stored.

    Times are the computer's date and time at the start of the log, plus the time that its monotonic clock has measured
    since. Raises StillwakeError if the measurement cannot be written, unless the block has already raised an error.
    """
    if path is None:
        yield lambda frame, received: None
        return
    check_measurement(path)
    place = leads_to(path)
    place.parent.mkdir(parents=True, exist_ok=True)
    stream = place.with_name(f".{path.name}.{os.getpid()}.log")
    log = _Log(stream)
    try:
        try:
            yield log.put
        except BaseException:
            log.close()
            with suppress(StillwakeError):
                write_measurement(path, CanLog(stream))
            raise
        log.close()
        if log.fault is not None:
            raise StillwakeError(f"{path}: the log is not complete: {log.fault.strerror or log.fault}")
        write_measurement(path, CanLog(stream))
    finally:
        with suppress(OSError):
            stream.unlink()


class _Log:
    """A thread that writes frames. `fault` is the error that ended the thread."""

    def __init__(self, stream: Path) -> None:
        self.fault: OSError | None = None
        self._frames = deque[tuple[int, Frame, bool]]()
        self._from_ns = time.time_ns() - time.monotonic_ns()
        self._ends = Event()
        self._writer = can.CanutilsLogWriter(stream)
        self._thread = Thread(target=self._write, name="can-log", daemon=True)
        self._thread.start()

    def put(self, frame: Frame, received: bool) -> None:
        if self.fault is None:
            self._frames.append((self._from_ns + time.monotonic_ns(), frame, received))

    def close(self) -> None:
        self._ends.set()
        self._thread.join()

    def _write(self) -> None:
        try:
            with self._writer:
                ends = False
                while not ends:
                    ends = self._ends.wait(_PAUSE_S)
                    batch = [self._frames.popleft() for _ in range(len(self._frames))]
                    for time_ns, frame, received in sorted(batch, key=lambda one: one[0]):
                        message = to_message(frame)
                        message.timestamp, message.is_rx = time_ns / 1e9, received
                        self._writer.on_message_received(message)
                    self._writer.file.flush()
        except OSError as error:
            self.fault = error
