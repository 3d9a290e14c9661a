"""What the bus delivers between two control steps, in the time of the ECU.

Backends stamp a reception with the date, which NTP sets: a step of it must not make fresh pressures old, nor old ones
fresh. Only the age of a frame when it is taken from the bus is believed of it, and that within bounds; the rest is
CLOCK_MONOTONIC.
"""

import time
from collections.abc import Callable
from typing import Final, NamedTuple

from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import MessageSpec
from firmware_sim.ecu.real_time.inbox import Inbox

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
        foreign: frames of another ECU on the bus.
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


class Reception:
    """Pressures for the control step, and a count of what only another ECU can have sent.

    Args:
        pressure: the message that the ECU reads.
        of_another_ecu: whether a frame can only be another ECU's (`firmware_sim.ecu.other_ecu`).
        interface: python-can's name of the bus.
        monotonic_ns, date_ns: the two clocks.

    Attributes:
        foreign: frames of another ECU so far.
    """

    def __init__(
        self,
        *,
        pressure: MessageSpec,
        of_another_ecu: Callable[[Frame], bool],
        interface: str,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        date_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._pressure, self._of_another_ecu = pressure, of_another_ecu
        self._believes_stamps = interface in STAMPED_WITH_THE_DATE
        self._monotonic_ns, self._date_ns = monotonic_ns, date_ns
        self._pressures = Inbox(self._stamp, room=ROOM)
        self._foreign_taken = 0
        self.foreign = 0

    @property
    def received(self) -> int:
        """Pressures, and frames of another ECU, so far."""
        return self._pressures.received + self.foreign

    @property
    def dropped(self) -> int:
        """Pressures for which there was no room; the oldest ones give way."""
        return self._pressures.dropped

    def put(self, frame: Frame) -> None:
        """Leave a frame; called where the bus is read, by one thread at a time."""
        if self._pressure.names(frame):
            self._pressures.put(frame)
        elif self._of_another_ecu(frame):
            self.foreign += 1

    def take(self) -> Taken:
        """Everything, once."""
        foreign, before = self.foreign, self._foreign_taken
        self._foreign_taken = foreign
        return Taken(self._pressures.take(), foreign - before)

    def _stamp(self, frame: Frame) -> int:
        monotonic_ns = self._monotonic_ns()
        if not self._believes_stamps:
            return monotonic_ns
        return received_ns(frame.timestamp_ns, monotonic_ns=monotonic_ns, date_ns=self._date_ns())
