"""A node without its bus, and a node that does not keep up with it."""

from collections import deque
from dataclasses import dataclass
from typing import Any, Literal

from can_bridge.bus.faults.fault import Fault
from can_bridge.bus.faults.injector import Injector
from can_bridge.wire.frame import Frame
from contract.config.rules import AtLeastOne
from contract.errors import BusError


class _Disconnected(Injector["Disconnect"]):
    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._kept: list[Frame] = []

    def send(self, frame: Frame) -> None:
        """Raises BusError while the device is gone."""
        if not self._fault.is_active(self._clock()):
            self._bus.send(frame)
            return
        self.acted += 1
        if self._fault.kind == "device_gone":
            raise BusError(f"frame {frame.frame_id:#05x} was not sent: the device is gone")

    def receive_all(self) -> list[Frame]:
        """Raises BusError while the device is gone."""
        now_ns = self._clock()
        # The bus goes on without the node: what it would have received must not come later.
        for arrived_ns, frame in self._arrivals.of(self._bus.receive_all(), now_ns):
            if self._fault.is_active(arrived_ns):
                self.acted += 1
            else:
                self._kept.append(frame)
        if self._fault.kind == "device_gone" and self._fault.is_active(now_ns):
            raise BusError("CAN bus failed: the device is gone")
        frames, self._kept = self._kept, []
        return frames


@dataclass(frozen=True, kw_only=True)
class Disconnect(Fault, section="disconnect"):
    """The node sends and receives nothing. `acted` counts the frames lost in both directions.

    What would have arrived in the span never comes; what a device that is gone had received before comes after it.
    """

    injector = _Disconnected

    kind: Literal["open_wire", "device_gone"] = "open_wire"
    """An open wire is silence: sending succeeds as far as the node can see. A device that is gone, such as an adapter
    pulled out, makes every call raise BusError."""


class _Slow(Injector["SlowConsumer"]):
    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._queue: deque[Frame] = deque()

    def receive_all(self) -> list[Frame]:
        """The oldest frames of the queue."""
        received = self._bus.receive_all()
        if not self._fault.is_active(self._clock()):
            frames = [*self._queue, *received]
            self._queue.clear()
            return frames
        room = self._fault.queue - len(self._queue)
        self._queue.extend(received[:room])
        self.acted += max(0, len(received) - room)
        return [self._queue.popleft() for _ in range(min(self._fault.frames_per_call, len(self._queue)))]


@dataclass(frozen=True, kw_only=True)
class SlowConsumer(Fault, section="slow_consumer"):
    """The node takes few frames at a time from a short queue. `acted` counts the frames lost to a full queue.

    A full queue keeps what it has and loses the newest, as python-can's buses and CAN controllers in FIFO mode do. When
    the span ends, all that is left is received at once.
    """

    injector = _Slow

    frames_per_call: AtLeastOne[int] = 1
    queue: AtLeastOne[int] = 16
    """Frames that it holds."""
