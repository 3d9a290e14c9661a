"""What the bus delivers between two control steps, in the time of the ECU.

Backends stamp a reception with the date, which NTP sets: a step of it must not make fresh pressures old, nor old ones
fresh. Only the age of a frame when it is taken from the bus is believed of it, and that within bounds; the rest is
CLOCK_MONOTONIC.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from threading import Lock
from typing import Final, NamedTuple

from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec

LONGEST_AGE_NS: Final = 1_000_000_000
"""Of a frame when it is taken from the bus: any longer would be too old all the same, and may be a clock set on."""
STAMPED_WITH_THE_DATE: Final = frozenset({"socketcan", "udp_multicast", "slcan"})
"""Interfaces whose stamps are known to be of the reception, in the computer's date. A `virtual` bus passes on the
sender's, and vendors' drivers have clocks of their own: there a frame counts as received when it is taken."""
ROOM: Final = 256
"""Frames kept for a step: with one pressure frame in a period, what a flood of others of its name may bring. Looking
at all of them takes 2 ms."""


class Taken(NamedTuple):
    """What came since the last step.

    Attributes:
        frames: pressures, oldest first, stamped in the ECU's clock.
        foreign: commands of another ECU on the bus: this one does not hear its own.
    """

    frames: list[Frame]
    foreign: int


def received_ns(stamp_ns: int, *, monotonic_ns: int, date_ns: int) -> int:
    """When a frame was received, in the monotonic clock.

    Args:
        stamp_ns: of the reception, in ns of the date.
        monotonic_ns, date_ns: of now.
    """
    age_ns = min(max(0, date_ns - stamp_ns), LONGEST_AGE_NS)
    return max(0, monotonic_ns - age_ns)


class Inbox:
    """Between the thread that reads the bus and the control step; neither waits for the other.

    Args:
        pressure: the message that the ECU reads.
        command: the one that it alone sends.
        interface: python-can's name of the bus.
        monotonic_ns, date_ns: the two clocks.

    Attributes:
        received: frames of the two messages so far.
        dropped: pressures for which there was no room; the oldest ones give way.
        foreign: commands of another ECU so far.
    """

    def __init__(
        self,
        *,
        pressure: MessageSpec,
        command: MessageSpec,
        interface: str,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        date_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._pressure, self._command = pressure, command
        self._believes_stamps = interface in STAMPED_WITH_THE_DATE
        self._monotonic_ns, self._date_ns = monotonic_ns, date_ns
        self._lock = Lock()
        self._frames: deque[Frame] = deque(maxlen=ROOM)
        self._foreign_taken = 0
        self.received = self.dropped = self.foreign = 0

    def put(self, frame: Frame) -> None:
        """Leave a frame; called where the bus is read."""
        monotonic_ns = self._monotonic_ns()
        if self._believes_stamps:
            monotonic_ns = received_ns(frame.timestamp_ns, monotonic_ns=monotonic_ns, date_ns=self._date_ns())
        with self._lock:
            if self._command.names(frame):
                self.received += 1
                self.foreign += 1
            elif self._pressure.names(frame):
                self.received += 1
                self.dropped += len(self._frames) == ROOM
                self._frames.append(replace(frame, timestamp_ns=monotonic_ns))

    def take(self) -> Taken:
        """Everything, once."""
        with self._lock:
            frames, foreign = list(self._frames), self.foreign - self._foreign_taken
            self._frames.clear()
            self._foreign_taken = self.foreign
        return Taken(frames, foreign)
