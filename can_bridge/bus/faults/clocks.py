"""Clocks that run apart: a node's own, and the one that stamps the frames it receives."""

from dataclasses import dataclass, replace
from typing import Annotated

from can_bridge.bus.faults.fault import NS, Fault
from can_bridge.bus.faults.injector import Injector
from can_bridge.wire.frame import Frame
from contract.config.rules import Finite, Rule


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
