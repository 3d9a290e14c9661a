"""A node that sends at high priority without end."""

from dataclasses import dataclass
from typing import Any, Final

from can_bridge.bus.faults.fault import NS, Fault
from can_bridge.bus.faults.injector import Injector
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, MAX_FRAME_ID, Frame
from contract.config.rules import NonNegative, Positive, require
from contract.errors import BusError

MOST_AT_ONCE: Final = 1000
"""Frames in one call: more than the deepest transmit queue here takes, and a bound on what a long pause leads to."""


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
