"""The ECU's connection to a bus that may be lost and return, such as an adapter that is unplugged.

A thread opens the bus, because this can take seconds with a serial adapter. Meanwhile the control steps continue and
report BUS_OFF, which is a fault. So when the bus is back, control starts only after the enable request has risen again.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from threading import Event, Lock, Thread
from typing import Final, Self

from can_bridge.bus.backends.python_can import PythonCanBus, ReceiveThread
from can_bridge.bus.interface import HEALTHY, BusHealth, BusState, Rejection
from can_bridge.wire.frame import Frame
from contract.errors import BusError
from ecu.real_time.privileges import step_back

LONGEST_PAUSE_S: Final = 5.0
"""Longest pause in s between two attempts to open a bus again. Pauses double until they reach this length."""
SEND_TIMEOUT_S: Final = 0.003
"""Longest time in s to send a frame. A period of 20 ms has two frames; if both time out, 14 ms of the period remain."""


Tell = Callable[..., None]
"""A function that reports an event. It is called with the event's name, its text, and its fields."""


class Connection:
    """A connection that is open in its `with` block; entering the block raises BusError if the bus cannot be opened.
    The thread that reads the bus calls `deliver` with every received frame.

    Attributes:
        not_sent, why_not_sent: number of unsent frames, and why the last frame was not sent (empty if it was sent).
    """

    def __init__(
        self, open_bus: Callable[[], PythonCanBus], deliver: Callable[[Frame], None], *, first_pause_s: float = 0.1
    ) -> None:
        self._open, self._deliver, self._first_pause_s = open_bus, deliver, first_pause_s
        self._bus: ReceiveThread | None = None
        self._opened = deque[PythonCanBus]()  # filled by the opener, with one bus at most
        self._opener: Thread | None = None
        self._closing, self._sending = Event(), Lock()
        self._lost_at_s = 0.0
        self._before = self._health = HEALTHY
        self.losses = self.not_sent = 0
        self.why_not_sent = ""

    def __enter__(self) -> Self:
        self._bus = ReceiveThread(self._open(), self._deliver).__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        if self._opener is not None:
            self._opener.join()
        with ExitStack() as stack:
            while self._opened:
                stack.callback(self._opened.pop().close)
            if self._bus is not None:
                stack.callback(self._bus.close)
        self._bus = None

    def look(self, tell: Tell) -> bool:
        """Report if the bus was lost or has returned since the last call; return whether it has returned now."""
        if self._bus is None:
            if not self._opened:
                return False
            self._bus = ReceiveThread(self._opened.pop(), self._deliver).__enter__()
            after_s = time.monotonic() - self._lost_at_s
            again = "for control, the enable request must rise again"
            tell("bus_back", f"bus open again after {after_s:.1f} s; {again}", after_s=after_s)
            return True
        if (fault := self._bus.fault) is not None:
            tell("bus_lost", f"bus lost, jets shut, reopening the bus: {fault}", why=str(fault))
            self._lose(self._bus)
        return False

    def health(self) -> BusHealth:
        """Return state and counters of the CAN controller since the process started; a lost bus counts as bus-off."""
        if self._bus is not None:
            now = self._bus.bus.health()
            self._health = replace(now, bus_off=self._before.bus_off + now.bus_off)
        return self._health

    def rejected(self) -> Mapping[Rejection, int]:
        """Return the number of unusable items received since the bus was opened, for each reason of the rejection."""
        return {} if self._bus is None else self._bus.bus.rejected

    def send(self, frames: Sequence[Frame]) -> bool:
        """Send frames; return whether the bus accepted all. If two threads send, their frames may alternate."""
        sent = True
        for frame in frames:
            with self._sending:
                # While the diagnosis thread sends, the control thread may find the bus lost, and set `_bus` to None.
                read, why_not = self._bus, ""
                try:
                    if read is None:
                        raise BusError("the bus is lost")
                    read.bus.send(frame, timeout_s=SEND_TIMEOUT_S)
                except BusError as error:
                    why_not, sent = str(error), False
                    self.not_sent += 1
                self.why_not_sent = why_not
        return sent

    def _lose(self, read: ReceiveThread) -> None:
        health = self.health()
        self._before = replace(health, bus_off=health.bus_off + 1)
        self._health = replace(self._before, state=BusState.BUS_OFF)
        self._bus, self._lost_at_s = None, time.monotonic()
        self.losses += 1
        self._opener = Thread(target=self._reopen, args=(read,), name="can-open", daemon=True)
        self._opener.start()

    def _reopen(self, lost: ReceiveThread) -> None:
        step_back()
        lost.close()
        pause_s = self._first_pause_s
        while not self._closing.wait(pause_s):
            try:
                self._opened.append(self._open())
            except BusError:
                pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
            else:
                return
