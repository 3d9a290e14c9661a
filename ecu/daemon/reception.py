"""The frames received between two control steps, with times of the ECU's clock.

The software that receives from a bus stamps a frame with the date and time of the computer, which NTP sets. When NTP
changes them, fresh pressures must not count as old, nor old pressures as fresh. So the stamp is used only to compute
the age of a frame when the frame is read; this age is limited. The time of a frame is CLOCK_MONOTONIC minus this age.
"""

import time
from collections.abc import Callable
from typing import Final

from can_bridge.bus.heard import Heard
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import MessageSet
from ecu.real_time.inbox import Inbox

LONGEST_AGE_NS: Final = 1_000_000_000
"""Limit of a frame's computed age in ns. If the age is larger, the frame is too old to be used, or the date was set."""
STAMPED_WITH_THE_DATE: Final = frozenset({"socketcan", "udp_multicast", "slcan"})
"""Interfaces that stamp a received frame with the computer's date. A `virtual` bus has the sender's stamp, and vendors'
drivers have clocks of their own. On all other interfaces a frame counts as received when it is read."""
ROOM: Final = 256
"""Largest number of stored pressure frames, and of other stored frames. To check a flood of so many takes 2 ms."""


def received_ns(stamp_ns: int, *, monotonic_ns: int, date_ns: int) -> int:
    """Convert the date of a frame's reception, `stamp_ns`, to a time of the monotonic clock; both are in ns."""
    age_ns = min(max(0, date_ns - stamp_ns), LONGEST_AGE_NS)
    return max(0, monotonic_ns - age_ns)


class FrameReception:
    """A store of received frames for the control step. `heard` counts frames since a caller last reset this count."""

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
        """The number of received frames of the ECU's messages."""
        return self._pressures.received + self._others.received

    @property
    def dropped(self) -> int:
        """The number of pressure frames dropped because the queue was full; the oldest frames are dropped first."""
        return self._pressures.dropped

    def put(self, frame: Frame) -> None:
        """Add a frame; the code that reads the bus calls this, in one thread at a time."""
        self.heard.add([frame])
        if self._pressure.names(frame):
            self._pressures.put(frame)
        elif any(spec.names(frame) for spec in self._rest):
            self._others.put(frame)

    def take(self) -> tuple[list[Frame], list[Frame]]:
        """Remove and return the frames since the last step as (pressures, others), oldest first, in the ECU's clock.
        The others are VehicleSpeed frames, and frames with the ECU's own identifiers, which another ECU has sent."""
        return self._pressures.take(), self._others.take()

    def _stamp(self, frame: Frame) -> int:
        monotonic_ns = self._monotonic_ns()
        if not self._believes_stamps:
            return monotonic_ns
        return received_ns(frame.timestamp_ns, monotonic_ns=monotonic_ns, date_ns=self._date_ns())
