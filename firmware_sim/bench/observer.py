"""Who watches a run from outside: frames at the nodes, and the plant; neither the ECU's state nor the vehicle's."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from can_bridge.bus.interface import Bus
from can_bridge.wire.frame import Frame
from wake.plant.sample import Sample


@dataclass(frozen=True, kw_only=True)
class SeenFrame:
    """A frame between a node and its port, faults of the port on the other side.

    Attributes:
        sent: by the node; otherwise received by it.
        now_ns: time of the run, whatever the frame's stamp is.
    """

    node: Literal["vehicle", "ecu"]
    sent: bool
    frame: Frame
    now_ns: int


class Observer(Protocol):
    """Called in the order of time; changes nothing."""

    def frame(self, seen: SeenFrame) -> None:
        """A node sent or received a frame."""

    def period(self, sample: Sample, *, requested: bool) -> None:
        """A control period ended, which began with this sample and this request of the vehicle."""

    def finished(self, sample: Sample) -> None:
        """The run ended; the sample is of its end."""


@dataclass(frozen=True, kw_only=True)
class WatchedBus:
    """A node's port with an observer."""

    port: Bus
    node: Literal["vehicle", "ecu"]
    observer: Observer
    clock: Callable[[], int]

    def send(self, frame: Frame) -> None:
        """See `Bus.send`."""
        self.observer.frame(SeenFrame(node=self.node, sent=True, frame=frame, now_ns=self.clock()))
        self.port.send(frame)

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        frames = self.port.receive_all()
        for frame in frames:
            self.observer.frame(SeenFrame(node=self.node, sent=False, frame=frame, now_ns=self.clock()))
        return frames
