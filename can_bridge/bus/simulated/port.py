"""A node's connection to the simulated bus: its two queues and its controller's error counters."""

import heapq
from collections.abc import Callable
from typing import Final, NamedTuple

from can_bridge.bus.interface import HEALTHY, BusHealth, BusState
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
"""Largest numbers of frames in a node's transmit queue and in its receive queue."""

RECOVERY: Final = 128
"""Number of sequences of `RECESSIVE_BITS` recessive bits that end bus-off."""
RECESSIVE_BITS: Final = 11


class Recovery(NamedTuple):
    """The recovery from bus-off: from `since_ns` on, the node needs `left` more sequences of 11 recessive bits."""

    left: int
    since_ns: int


class SimulatedPort:
    """A node's connection to a simulated bus, created by `SimulatedBus.port`. As the response-time analysis assumes, no
    frame in the transmit queue waits for an earlier frame of lower priority.

    Attributes:
        refused: number of frames that the bus refused because the queue was full or the node was bus-off.
        discarded: number of frames that were in the queue when the node went bus-off.
    """

    def __init__(self, name: str, clock: Callable[[], int]) -> None:
        self.name = name
        self.refused = self.discarded = 0
        self._clock = clock
        self._serial = 0
        self._received: list[Frame] = []
        # Only the bus uses the attributes below.
        self.waiting: list[Queued] = []
        self.errors = HEALTHY
        self.ready_ns = 0
        self.recovery: Recovery | None = None

    @property
    def is_off(self) -> bool:
        return self.errors.state is BusState.BUS_OFF

    @property
    def is_passive(self) -> bool:
        return self.errors.state is BusState.ERROR_PASSIVE

    def send(self, frame: Frame) -> None:
        """Queue one frame now; its timestamp is ignored. Raises BusError if the node is bus-off or the queue full."""
        waiting = len(self.waiting)
        if self.is_off or waiting >= TRANSMIT_CAPACITY:
            self.refused += 1
            why = "is bus-off" if self.is_off else f"has {waiting} frames waiting for the bus, so its queue is full"
            raise BusError(f"{self.name} {why}: frame {frame.frame_id:#x} was not sent")
        if not self.waiting:
            self.ready_ns = max(self.ready_ns, self._clock())
        self._serial += 1
        heapq.heappush(self.waiting, Queued(priority(frame), self._serial, self._clock(), frame))

    def receive_all(self) -> list[Frame]:
        """Return all frames that have arrived up to the bus's present time, in the order of arrival."""
        frames, self._received = self._received, []
        return frames

    def health(self) -> BusHealth:
        return self.errors

    def deliver(self, frame: Frame) -> None:
        """Put a frame into this node's receive queue; a full queue loses it. Only the bus calls this method."""
        if len(self._received) < RECEIVE_CAPACITY:
            self._received.append(frame)

    def sent(self, item: Queued) -> None:
        """Remove a frame from the transmit queue. Only the bus calls this method."""
        self.waiting.remove(item)
        heapq.heapify(self.waiting)

    def recover(self) -> None:
        """End bus-off, and reset both error counters (rule 12). Only the bus calls this method."""
        self.recovery, self.errors = None, BusHealth(bus_off=self.errors.bus_off)

    def settle(self, now_ns: int) -> None:
        """Empty the queue of a node that went bus-off, and begin its recovery. Called by the bus after each attempt."""
        if self.is_off and self.recovery is None:
            self.discarded += len(self.waiting)
            self.waiting.clear()
            self.recovery = Recovery(left=RECOVERY, since_ns=now_ns)
