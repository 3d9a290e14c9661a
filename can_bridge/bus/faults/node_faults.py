"""A node without its bus or that does not keep up with it, clocks that run apart, a node that sends without end."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Annotated, Any, Final, Literal

from can_bridge.bus.faults.fault import NS, Fault, Injector
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, MAX_FRAME_ID, Frame
from contract.config.rules import AtLeastOne, Finite, NonNegative, Positive, Rule, require
from contract.errors import BusError

MOST_AT_ONCE: Final = 1000
"""Frames in one call: more than the deepest transmit queue here takes, and a bound on what a long pause leads to."""


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


class _Restamping(Injector["ClockDrift"]):
    def receive_all(self) -> list[Frame]:
        """The frames with stamps of the drifting clock; their own are taken for the true time."""
        received = self._bus.receive_all()
        frames = [replace(frame, timestamp_ns=self._fault.local_ns(frame.timestamp_ns)) for frame in received]
        self.acted += sum(one != other for one, other in zip(received, frames, strict=True))
        return frames


@dataclass(frozen=True, kw_only=True)
class ClockDrift(Fault, section="clock_drift"):
    """A clock that runs fast or slow, or is wrong by a constant; right again when the span ends, with a jump.

    As a fault of a bus it stamps what the node receives. A whole node whose clock drifts also reads its time through
    `local_ns`. With only one of the two, stamps and time disagree, as where an adapter stamps by a clock of its own.
    `acted` counts the frames with another stamp.
    """

    injector = _Restamping

    ppm: Annotated[float, Rule(wording="above -10^6", holds=lambda value: value > -1e6)] = 0.0
    """Parts per million by which it is fast. A crystal is within some 100; CAN's resynchronisation bears 15,800 at
    most (Bosch, CAN specification 2.0, oscillator tolerance)."""
    offset_s: Finite[float] = 0.0
    """By which it is ahead, at the start of the span."""

    def local_ns(self, true_ns: int) -> int:
        """What the clock shows at this time; never below zero."""
        if not self.is_active(true_ns):
            return true_ns
        gained_ns = round(self.offset_s * NS + (true_ns - self.start_s * NS) * self.ppm / 1e6)
        return max(0, true_ns + gained_ns)


class _Babbling(Injector["Babble"]):
    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._since_ns = round(self._fault.start_s * NS)
        self._due = 0.0

    def send(self, frame: Frame) -> None:
        """See `Bus.send`."""
        self._babble()
        self._bus.send(frame)

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        self._babble()
        return self._bus.receive_all()

    def _babble(self) -> None:
        now_ns = self._clock()
        if not self._fault.is_active(now_ns):
            return
        self._due = min(MOST_AT_ONCE, self._due + (now_ns - self._since_ns) * self._fault.rate_hz / NS)
        self._since_ns = now_ns
        while self._due >= 1.0:
            data = self._random.randbytes(self._fault.length)
            frame = Frame(frame_id=self._fault.frame_id, data=data, timestamp_ns=now_ns, is_fd=self._fault.is_fd)
            try:
                self._bus.send(frame)
            except BusError:
                self._due = 0.0
                return
            self._due -= 1.0
            self.acted += 1


@dataclass(frozen=True, kw_only=True)
class Babble(Fault, section="babble"):
    """The node sends frames of random content in addition to its own. `acted` counts those that the bus took.

    They are handed over at the node's next call, ahead of its own frame, as many as the rate makes due since the call
    before, until the bus takes no more: what does not fit into the transmit queue is not sent later. A node that does
    nothing but babble is a port of its own, which has to be called often.
    """

    injector = _Babbling

    frame_id: NonNegative[int] = 0
    """0 wins every arbitration."""
    length: NonNegative[int] = 8
    is_fd: bool = False
    rate_hz: Positive[float] = 5000.0
    """Frames a second; the default is more than 500 kbit/s carry of classic frames of 8 bytes (4,504 at most)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.frame_id <= MAX_FRAME_ID, self, "frame_id", f"in 0..{MAX_FRAME_ID:#x}")
        lengths = FD_LENGTHS if self.is_fd else CLASSIC_LENGTHS
        require(self.length in lengths, self, "length", f"one of {', '.join(map(str, lengths))}")
