"""Frames between the thread that receives them and the loop that uses them a period at a time."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from can_bridge.wire.frame import Frame
from firmware_sim.ecu.real_time.clock import now_ns

CAPACITY: Final = 4096
"""Frames kept: a second of a full classic bus. In a flood the oldest are lost, and counted."""


class Inbox:
    """Stamps frames on arrival and hands them over in order.

    Arrival is when the receiving thread has the frame, on the monotonic clock: a step of the computer's date does not
    reach it. What the frame waited for in the kernel counts as being under way.

    Attributes:
        lost: frames that found the inbox full.
    """

    def __init__(self, clock_ns: Callable[[], int] = now_ns) -> None:
        self._clock_ns = clock_ns
        # A deque's ends may be used from two threads.
        self._frames: deque[Frame] = deque()
        self.lost = 0

    def put(self, frame: Frame) -> None:
        """Leave a frame; never waits."""
        if len(self._frames) >= CAPACITY:
            self._frames.popleft()
            self.lost += 1
        self._frames.append(replace(frame, timestamp_ns=self._clock_ns()))

    def before(self, until_ns: int) -> list[Frame]:
        """Take out what arrived before an instant, oldest first."""
        taken: list[Frame] = []
        while self._frames and self._frames[0].timestamp_ns < until_ns:
            taken.append(self._frames.popleft())
        return taken
