"""A queue of frames between the thread that reads a bus and the loop that takes them once a period."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from threading import Lock

from can_bridge.wire.frame import Frame


class Inbox:
    """A queue that stamps frames on arrival and returns them in order; neither thread waits for the other. The reading
    thread calls `stamp`, which returns the arrival in ns. If `room` frames wait, a new frame replaces the oldest."""

    def __init__(self, stamp: Callable[[Frame], int], *, room: int) -> None:
        self._stamp, self._lock = stamp, Lock()
        self._frames: deque[Frame] = deque(maxlen=room)
        self._room = room
        self.received = self.dropped = 0

    def put(self, frame: Frame) -> None:
        stamped = replace(frame, timestamp_ns=self._stamp(frame))
        with self._lock:
            self.received += 1
            self.dropped += len(self._frames) == self._room
            self._frames.append(stamped)

    def take(self) -> list[Frame]:
        """Remove and return all frames, oldest first."""
        with self._lock:
            taken = list(self._frames)
            self._frames.clear()
        return taken

    def before(self, until_ns: int) -> list[Frame]:
        """Remove and return the frames that arrived before an instant, oldest first."""
        taken: list[Frame] = []
        with self._lock:
            while self._frames and self._frames[0].timestamp_ns < until_ns:
                taken.append(self._frames.popleft())
        return taken
