"""A node without its bus or that does not keep up with it, clocks that run apart, a node that sends without end."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Annotated, Final, Literal

from can_bridge.bus.faults.fault import NS, BusFault, Injector, Receive, Send
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, MAX_FRAME_ID, Frame
from contract.config.rules import AtLeastOne, Finite, NonNegative, Positive, Rule, require
from contract.errors import BusError

MOST_BABBLED: Final = 1000
"""Frames in one call: more than the deepest transmit queue here takes, and a bound on what a long pause leads to."""


@dataclass(frozen=True, kw_only=True)
class Disconnect(BusFault, section="disconnect"):
    """The node sends and receives nothing. `acted` counts the frames lost in both directions.

    What would have arrived in the span never comes; what a device that is gone had received before comes after it.
    """

    kind: Literal["open_wire", "device_gone"] = "open_wire"
    """An open wire is silence: sending succeeds as far as the node can see. A device that is gone, such as an adapter
    pulled out, makes every call raise BusError."""

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        """See `BusFault.acting`; both raise BusError while the device is gone."""
        kept: list[Frame] = []

        def send(frame: Frame) -> None:
            if not self.is_active(port.clock()):
                port.beneath.send(frame)
                return
            port.acted += 1
            if self.kind == "device_gone":
                raise BusError(f"frame {frame.frame_id:#05x} was not sent: the device is gone")

        def receive() -> list[Frame]:
            now_ns = port.clock()
            # The bus goes on without the node: what it would have received must not come later.
            for arrived_ns, frame in port.arrived(now_ns):
                if self.is_active(arrived_ns):
                    port.acted += 1
                else:
                    kept.append(frame)
            if self.kind == "device_gone" and self.is_active(now_ns):
                raise BusError("CAN bus failed: the device is gone")
            frames = kept.copy()
            kept.clear()
            return frames

        return send, receive


@dataclass(frozen=True, kw_only=True)
class SlowConsumer(BusFault, section="slow_consumer"):
    """The node takes few frames at a time from a short queue. `acted` counts the frames lost to a full queue.

    A full queue keeps what it has and loses the newest, as python-can's buses and CAN controllers in FIFO mode do. When
    the span ends, all that is left is received at once.
    """

    frames_per_call: AtLeastOne[int] = 1
    queue: AtLeastOne[int] = 16
    """Frames that it holds."""

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        """See `BusFault.acting`: the oldest frames of the queue are received."""
        waiting = deque[Frame]()

        def receive() -> list[Frame]:
            received = port.beneath.receive_all()
            if not self.is_active(port.clock()):
                frames = [*waiting, *received]
                waiting.clear()
                return frames
            room = self.queue - len(waiting)
            waiting.extend(received[:room])
            port.acted += max(0, len(received) - room)
            return [waiting.popleft() for _ in range(min(self.frames_per_call, len(waiting)))]

        return port.beneath.send, receive


@dataclass(frozen=True, kw_only=True)
class ClockDrift(BusFault, section="clock_drift"):
    """A clock that runs fast or slow, or is wrong by a constant; right again when the span ends, with a jump.

    As a fault of a bus it stamps what the node receives. A whole node whose clock drifts also reads its time through
    `local_ns`. With only one of the two, stamps and time disagree, as where an adapter stamps by a clock of its own.
    `acted` counts the frames with another stamp.
    """

    ppm: Annotated[float, Rule(wording="above -10^6", holds=lambda value: value > -1e6)] = 0.0
    """Parts per million by which it is fast. A crystal is within some 100; CAN's resynchronisation bears 15,800 at
    most (Bosch, CAN specification 2.0, oscillator tolerance)."""
    offset_s: Finite[float] = 0.0
    """The time by which it is ahead at the start of the span."""

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        """See `BusFault.acting`: frames get stamps of the drifting clock; their own are taken for the true time."""

        def receive() -> list[Frame]:
            received = port.beneath.receive_all()
            frames = [replace(frame, timestamp_ns=self.local_ns(frame.timestamp_ns)) for frame in received]
            port.acted += sum(one != other for one, other in zip(received, frames, strict=True))
            return frames

        return port.beneath.send, receive

    def local_ns(self, true_ns: int) -> int:
        """What the clock shows at this time; never below zero."""
        if not self.is_active(true_ns):
            return true_ns
        gained_ns = round(self.offset_s * NS + (true_ns - self.start_s * NS) * self.ppm / 1e6)
        return max(0, true_ns + gained_ns)


@dataclass(frozen=True, kw_only=True)
class Babble(BusFault, section="babble"):
    """The node sends frames of random content in addition to its own. `acted` counts those that the bus took.

    They are handed over at the node's next call, ahead of its own frame, as many as the rate makes due since the call
    before, until the bus takes no more: what does not fit into the transmit queue is not sent later. A node that does
    nothing but babble is a port of its own, which has to be called often.
    """

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

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        """See `BusFault.acting`: each call sends first what is due."""
        since_ns, due = round(self.start_s * NS), 0.0

        def babble() -> None:
            nonlocal since_ns, due
            now_ns = port.clock()
            if not self.is_active(now_ns):
                return
            due = min(MOST_BABBLED, due + (now_ns - since_ns) * self.rate_hz / NS)
            since_ns = now_ns
            while due >= 1.0:
                data = port.random.randbytes(self.length)
                try:
                    port.beneath.send(Frame(frame_id=self.frame_id, data=data, timestamp_ns=now_ns, is_fd=self.is_fd))
                except BusError:
                    due = 0.0
                    return
                due -= 1.0
                port.acted += 1

        def send(frame: Frame) -> None:
            babble()
            port.beneath.send(frame)

        def receive() -> list[Frame]:
            babble()
            return port.beneath.receive_all()

        return send, receive
