"""The faults of whole nodes: a lost connection, a slow consumer, a clock that drifts, frames sent without end."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Annotated, Final, Literal

from can_bridge.bus.faults.fault import NS, BusFault, Injector, Receive, Send
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, MAX_FRAME_ID, Frame
from contract.config.rules import AtLeastOne, Finite, NonNegative, Positive, Rule, require
from contract.errors import BusError

MOST_BABBLED: Final = 1000
"""Largest number of additional frames that one call sends; a simulated port's transmit queue holds fewer."""


@dataclass(frozen=True, kw_only=True)
class Disconnect(BusFault, section="disconnect"):
    """A node that sends and receives nothing. `acted` counts the frames lost in both directions. Frames that arrived
    before a "device_gone" span and were not read by then are delivered after the span."""

    kind: Literal["open_wire", "device_gone"] = "open_wire"
    """open_wire: the bus is silent, and sending causes no error; device_gone: every call raises BusError."""

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        """Discard the frames of the span. Both functions raise BusError while the device is gone."""
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
            # Frames that arrive during the fault are read now, so that the node does not receive them later.
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
    """A node that reads few frames at a time from a short queue. A full queue loses the newest frame, like queues of
    python-can's buses and of CAN controllers in FIFO mode. The first call of `receive_all` after the span returns all
    frames in the queue. `acted` counts the lost frames."""

    frames_per_call: AtLeastOne[int] = 1
    queue: AtLeastOne[int] = 16

    def acting(self, port: Injector) -> tuple[Send, Receive]:
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
    """A clock that runs fast or slow, or has a constant offset. When the span ends, the clock jumps to the true time.

    The fault replaces the time stamps of received frames with this clock's times. To simulate a node whose
    own clock drifts, also convert the node's time with `local_ns`. Otherwise only the stamps drift, as with an adapter
    that has a clock of its own. `acted` counts the frames with a changed stamp.
    """

    ppm: Annotated[float, Rule(wording="above -10^6", holds=lambda value: value > -1e6)] = 0.0
    """Drift in parts per million; positive if the clock is fast. A crystal has at most about 100; CAN's
    resynchronisation tolerates at most 15,800 (Bosch, CAN specification 2.0, oscillator tolerance)."""
    offset_s: Finite[float] = 0.0
    """Time in s by which the clock is ahead of the true time at the start of the span."""

    def acting(self, port: Injector) -> tuple[Send, Receive]:
        """Stamp received frames with the drifting clock's time; a frame's original stamp counts as the true time."""

        def receive() -> list[Frame]:
            received = port.beneath.receive_all()
            frames = [replace(frame, timestamp_ns=self.local_ns(frame.timestamp_ns)) for frame in received]
            port.acted += sum(one != other for one, other in zip(received, frames, strict=True))
            return frames

        return port.beneath.send, receive

    def local_ns(self, true_ns: int) -> int:
        """Return the time that this clock shows at a true time, both in ns; never negative."""
        if not self.is_active(true_ns):
            return true_ns
        gained_ns = round(self.offset_s * NS + (true_ns - self.start_s * NS) * self.ppm / 1e6)
        return max(0, true_ns + gained_ns)


@dataclass(frozen=True, kw_only=True)
class Babble(BusFault, section="babble"):
    """A node that sends additional frames with random content. `acted` counts the frames that the bus accepted.

    Each call of the port first sends the frames that became due since the previous call. If the bus refuses a frame,
    the remaining frames are discarded. A node that only babbles needs a separate port, and must call this port often.
    """

    frame_id: NonNegative[int] = 0
    """Identifier of the additional frames; 0 wins every arbitration."""
    length: NonNegative[int] = 8
    is_fd: bool = False
    rate_hz: Positive[float] = 5000.0
    """Number of additional frames per s; a bus with 500 kbit/s carries at most 4,504 classic frames of 8 bytes."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.frame_id <= MAX_FRAME_ID, self, "frame_id", f"in 0..{MAX_FRAME_ID:#x}")
        lengths = FD_LENGTHS if self.is_fd else CLASSIC_LENGTHS
        require(self.length in lengths, self, "length", f"one of {', '.join(map(str, lengths))}")

    def acting(self, port: Injector) -> tuple[Send, Receive]:
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
