"""What the bus delivers between two control steps, in the time of the ECU.

Backends stamp a reception with the date, which NTP sets: a step of it must not make fresh pressures old, nor old ones
fresh. Only the age of a frame when it is taken from the bus is believed of it, and that within bounds; the rest is
CLOCK_MONOTONIC.
"""

import time
from collections.abc import Callable
from typing import Final, NamedTuple

from can_bridge.bus.heard import Heard
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import MessageSet
from ecu.real_time.inbox import Inbox

LONGEST_AGE_NS: Final = 1_000_000_000
"""Largest age of a frame when it is taken from the bus: an older one is of no use, and its clock may have been set."""
STAMPED_WITH_THE_DATE: Final = frozenset({"socketcan", "udp_multicast", "slcan"})
"""Interfaces whose stamps are known to be of the reception, in the computer's date. A `virtual` bus passes on the
sender's, and vendors' drivers have clocks of their own: there a frame counts as received when it is taken."""
ROOM: Final = 256
"""Frames kept for a step: with one pressure frame in a period, what a flood of others of its name may bring. Looking
at all of them takes 2 ms."""


class Taken(NamedTuple):
    """What came since the last step.

    Attributes:
        pressures: oldest first, stamped in the ECU's clock.
        others: the vehicle's speed, and frames by the names of what the ECU sends: those only another ECU can send.
    """

    pressures: list[Frame]
    others: list[Frame]


def received_ns(stamp_ns: int, *, monotonic_ns: int, date_ns: int) -> int:
    """When a frame was received, in the monotonic clock. `stamp_ns` is of the reception, in ns of the date."""
    age_ns = min(max(0, date_ns - stamp_ns), LONGEST_AGE_NS)
    return max(0, monotonic_ns - age_ns)


class FrameReception:
    """Frames of the ECU's messages for the control step. `heard` has everything received since it was set, for a silent
    bus's line."""

    def __init__(
        self,
        *,
        messages: MessageSet,
        interface: str,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        date_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._pressure, *self._rest = messages.specs
        self._believes_stamps = interface in STAMPED_WITH_THE_DATE
        self._monotonic_ns, self._date_ns = monotonic_ns, date_ns
        self.heard = Heard()
        self._pressures, self._others = Inbox(self._stamp, room=ROOM), Inbox(self._stamp, room=ROOM)

    @property
    def received(self) -> int:
        """Frames of the ECU's messages so far."""
        return self._pressures.received + self._others.received

    @property
    def dropped(self) -> int:
        """Pressures for which there was no room; the oldest ones give way."""
        return self._pressures.dropped

    def put(self, frame: Frame) -> None:
        """Leave a frame; called where the bus is read, by one thread at a time."""
        self.heard.add([frame])
        if self._pressure.names(frame):
            self._pressures.put(frame)
        elif any(spec.names(frame) for spec in self._rest):
            self._others.put(frame)

    def take(self) -> Taken:
        """Everything, once."""
        return Taken(self._pressures.take(), self._others.take())

    def _stamp(self, frame: Frame) -> int:
        monotonic_ns = self._monotonic_ns()
        if not self._believes_stamps:
            return monotonic_ns
        return received_ns(frame.timestamp_ns, monotonic_ns=monotonic_ns, date_ns=self._date_ns())
