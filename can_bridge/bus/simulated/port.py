"""A node's connection to the simulated bus: its two queues and its controller's error counters."""

import heapq
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from can_bridge.bus.interface import BusHealth
from can_bridge.bus.simulated.attempt import RECOVERY, FaultConfinement
from can_bridge.wire.frame import Frame, Priority, priority
from contract.errors import BusError


class Queued(NamedTuple):
    """A waiting frame. `serial` numbers the frames of a queue, so that frames of equal priority keep their order."""

    priority: Priority
    serial: int
    queued_ns: int
    frame: Frame


TRANSMIT_CAPACITY: Final = 64
RECEIVE_CAPACITY: Final = 4096
"""Largest numbers of frames in a node's two queues."""


class TransmitQueue:
    """A queue of limited length, as in a controller with many mailboxes or a sorted FIFO. As the response-time analysis
    assumes, no frame waits for an earlier frame of lower priority. A frame stays in the queue until it was sent."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._waiting: list[Queued] = []
        self._serial = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, frame: Frame, now_ns: int) -> bool:
        """Add a frame; return False if the queue is full and the frame was not added."""
        if len(self._waiting) >= self._capacity:
            return False
        self._serial += 1
        heapq.heappush(self._waiting, Queued(priority(frame), self._serial, now_ns, frame))
        return True

    @property
    def head(self) -> Queued:
        """Return the frame to be sent next; raises IndexError if the queue is empty."""
        return self._waiting[0]

    def remove(self, sent: Queued) -> None:
        if self._waiting[0] is sent:
            heapq.heappop(self._waiting)
        else:
            self._waiting.remove(sent)
            heapq.heapify(self._waiting)

    def clear(self) -> int:
        """Empty the queue; return the number of frames that were in it."""
        count = len(self._waiting)
        self._waiting.clear()
        return count

    def count(self, frame_id: int) -> int:
        """Return the number of frames in the queue that have this 11-bit identifier."""
        return sum(item.frame.frame_id == frame_id and not item.frame.is_extended for item in self._waiting)


class Recovery(NamedTuple):
    """The recovery from bus-off: how many sequences of eleven recessive bits are missing, counted from `since_ns`."""

    left: int
    since_ns: int


class SimulatedPort:
    """A node's connection to a simulated bus, created by `SimulatedBus.port`.

    Attributes:
        refused: number of frames that the bus refused because the queue was full or the node was bus-off.
        discarded: number of frames that were in the queue when the node went bus-off.
        overruns: number of frames lost because they arrived while the receive queue was full.
    """

    def __init__(self, name: str, clock: Callable[[], int]) -> None:
        self.name = name
        self.refused = self.discarded = self.overruns = 0
        self._clock = clock
        self._received: deque[Frame] = deque()
        # Only the bus uses the attributes below.
        self.queue = TransmitQueue(TRANSMIT_CAPACITY)
        self.faults = FaultConfinement()
        self.ready_ns = 0
        self.recovery: Recovery | None = None

    def send(self, frame: Frame) -> None:
        """Put one frame into the transmit queue, at the bus's present time; the frame's timestamp is ignored. Raises
        BusError if the node is bus-off or the queue is full."""
        if self.faults.is_off:
            self.refused += 1
            raise BusError(f"{self.name} is bus-off: frame {frame.frame_id:#x} was not sent")
        was_empty = not self.queue
        if not self.queue.put(frame, self._clock()):
            self.refused += 1
            raise BusError(
                f"{self.name} has {len(self.queue)} frames waiting for the bus, so its queue is full: frame "
                f"{frame.frame_id:#x} was not sent"
            )
        if was_empty:
            self.ready_ns = max(self.ready_ns, self._clock())

    def receive_all(self) -> list[Frame]:
        """Return all frames that have arrived up to the bus's present time, in the order of arrival."""
        frames = list(self._received)
        self._received.clear()
        return frames

    def health(self) -> BusHealth:
        return self.faults.health

    def deliver(self, frame: Frame) -> None:
        """Put a frame into this node's receive queue. Only the bus calls this method."""
        if len(self._received) < RECEIVE_CAPACITY:
            self._received.append(frame)
        else:
            self.overruns += 1

    def recover(self) -> None:
        """End bus-off. Only the bus calls this method."""
        self.recovery, self.faults = None, self.faults.recovered()

    def settle(self, now_ns: int) -> None:
        """Empty the queue of a node that went bus-off, and begin its recovery. The bus calls this after every error."""
        if self.faults.is_off and self.recovery is None:
            self.discarded += self.queue.clear()
            self.recovery = Recovery(left=RECOVERY, since_ns=now_ns)
