"""The interface of an observer of a run, which sees the nodes' frames and the plant, but no state of the nodes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from can_bridge.bus.interface import Bus
from can_bridge.wire.frame import Frame
from wake.plant.sample import Sample


@dataclass(frozen=True, kw_only=True)
class SeenFrame:
    """A frame that a node sends or receives, as the node's software sees it. The port's faults act between the software
    and the bus.

    Attributes:
        sent: True if the node sent the frame, False if the node received the frame.
        now_ns: time of the run in ns, independent of the frame's timestamp.
    """

    node: Literal["vehicle", "ecu"]
    sent: bool
    frame: Frame
    now_ns: int


class Observer(Protocol):
    """An object whose methods the loop calls in the order of time. It must not change anything in the loop."""

    def frame(self, seen: SeenFrame) -> None:
        """Process a frame that a node sent or received."""

    def period(self, sample: Sample, *, requested: bool) -> None:
        """Process an ended control period: the sample at its start, and whether the vehicle requested control in it."""

    def finished(self, sample: Sample) -> None:
        """Process the sample at the end of the run."""


@dataclass(frozen=True, kw_only=True)
class WatchedBus:
    """A wrapper around a node's port that also passes the port's frames to an observer."""

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
