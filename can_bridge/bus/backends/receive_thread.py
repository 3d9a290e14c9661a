"""A thread that reads a bus and delivers its frames."""

from collections.abc import Callable
from threading import Event, Thread
from typing import Final, Self

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.wire.frame import Frame
from contract.errors import BusError

POLL_S: Final = 0.05
"""Longest time in s that the thread waits for one frame, and so the longest time that it takes to stop."""


class ReceiveThread:
    """A thread that reads a bus in its `with` block; close the bus afterwards. `fault` is the error that ended it."""

    def __init__(self, bus: PythonCanBus, deliver: Callable[[Frame], None]) -> None:
        """Prepare the thread, which calls `deliver` with each frame; `deliver` must return without waiting."""
        self._bus = bus
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

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                frame = self._bus.receive(POLL_S)
                if frame is not None:
                    self._deliver(frame)
        except BaseException as error:  # noqa: BLE001 - an error that ends a thread is lost unless it is kept
            self.fault = error
