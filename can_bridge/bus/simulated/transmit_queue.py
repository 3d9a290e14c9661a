"""The frames that a CAN controller has yet to send: the one of highest priority goes first, equals in order."""

import heapq
from typing import NamedTuple

from can_bridge.wire.frame import Frame
from can_bridge.wire.priority import Priority, priority


class Queued(NamedTuple):
    """A frame that waits. `serial` counts the queue's frames, so that equals keep their order."""

    priority: Priority
    serial: int
    queued_ns: int
    frame: Frame


class TransmitQueue:
    """Bounded; what a controller with many mailboxes or a sorted FIFO does.

    No frame in it waits for one of lower priority behind which it was queued, which is what the analysis of response
    times assumes. A frame stays until it has been sent: one of higher priority may come before its repetition.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._waiting: list[Queued] = []
        self._serial = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, frame: Frame, now_ns: int) -> bool:
        """Add a frame; False if the queue is full and the frame is not in it."""
        if len(self._waiting) >= self._capacity:
            return False
        self._serial += 1
        heapq.heappush(self._waiting, Queued(priority(frame), self._serial, now_ns, frame))
        return True

    @property
    def head(self) -> Queued:
        """What goes next; IndexError if nothing waits."""
        return self._waiting[0]

    def remove(self, sent: Queued) -> None:
        """Take out a frame that was sent."""
        if self._waiting[0] is sent:
            heapq.heappop(self._waiting)
        else:
            self._waiting.remove(sent)
            heapq.heapify(self._waiting)

    def clear(self) -> int:
        """Empty it, and return how many frames were in it."""
        count = len(self._waiting)
        self._waiting.clear()
        return count

    def count(self, frame_id: int) -> int:
        """Frames of an 11-bit identifier in it."""
        return sum(item.frame.frame_id == frame_id and not item.frame.is_extended for item in self._waiting)
