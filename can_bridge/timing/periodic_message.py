"""A message that a node sends periodically, and its timing."""

from dataclasses import dataclass
from typing import Final

from can_bridge.wire.frame import Frame, Priority, priority
from can_bridge.wire.frame_bits import worst_case_ns
from can_bridge.wire.message_specs import SPECS
from contract.config.vehicle import BusConfig

NS_PER_MS: Final = 10**6

OUR_IDS: Final = frozenset(spec.frame_id for spec in SPECS)
"""Identifiers of our messages in all message sets, used or not. No message of another node may have one of them."""


@dataclass(frozen=True, kw_only=True)
class PeriodicMessage:
    """A periodic message of a node.

    Attributes:
        period_ns: shortest time between two releases.
        offset_ns: time of the first release.
        jitter_ns: largest delay from a release until the frame is queued.
        deadline_ns: time after a release by which the frame has to arrive; 0 means the period.
    """

    name: str
    frame_id: int
    is_extended: bool = False
    is_fd: bool
    length: int
    period_ns: int
    offset_ns: int = 0
    jitter_ns: int = 0
    deadline_ns: int = 0

    @property
    def priority(self) -> Priority:
        return priority(self.frame(bytes(self.length)))

    def frame(self, data: bytes) -> Frame:
        """Return a frame of the message; `data` must have `length` bytes."""
        return Frame(frame_id=self.frame_id, data=data, is_fd=self.is_fd, is_extended=self.is_extended)

    def worst_ns(self, bus: BusConfig) -> int:
        """Return the longest time in ns for which a frame of the message occupies the bus."""
        return worst_case_ns(
            self.frame(bytes(self.length)), nominal_bitrate=bus.nominal_bitrate, data_bitrate=bus.data_bitrate
        )
