"""Who watches a run from outside: frames on the bus, frames that the vehicle hears, and the plant."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated.medium import Transmission
from can_bridge.wire.frame import Frame
from wake.truck.sample import Sample


class Observer(Protocol):
    """Called in the order of time. It sees neither the ECU's state nor the vehicle's, and changes nothing."""

    def sent(self, transmission: Transmission) -> None:
        """A frame went over the bus."""

    def heard(self, frames: Sequence[Frame]) -> None:
        """The vehicle took these from its CAN controller; in a period with a disturbance of its port not what was
        sent."""

    def period(self, start_ns: int, sample: Sample, *, requested: bool) -> None:
        """A control period ended; it began at this time with this sample and the vehicle's request."""


@dataclass(frozen=True)
class HeardBus:
    """The vehicle's port, with someone who listens."""

    port: Bus
    observer: Observer

    def send(self, frame: Frame) -> None:
        """See `Bus.send`."""
        self.port.send(frame)

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        frames = self.port.receive_all()
        self.observer.heard(frames)
        return frames
