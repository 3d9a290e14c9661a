"""What a bus offers to a node; real, virtual and simulated buses share it."""

from typing import Protocol

from can_bridge.wire.frame import Frame


class Bus(Protocol):
    """One node's connection: sends frames, and returns received ones without waiting."""

    def send(self, frame: Frame) -> None:
        """Hand over one frame; raises BusError if the bus does not take it."""

    def receive_all(self) -> list[Frame]:
        """Everything that has arrived, oldest first, without waiting; raises BusError if the bus failed."""
