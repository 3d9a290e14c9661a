"""What a run's bus carried besides: load, errors, and how long the loop's own frames waited for it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from can_bridge.bus.interface import BusHealth
from can_bridge.bus.simulated.medium import BusActivity, Transmission
from can_bridge.wire.message_sets import MessageSet


@dataclass(frozen=True, kw_only=True)
class NodeErrors:
    """A node's CAN controller at the end of the run.

    Attributes:
        state: name of a `can_bridge.bus.interface.BusState`.
        tx_errors, rx_errors: its error counters.
        refused: frames that it could not send: its queue was full, or it was bus-off.
    """

    state: str
    tx_errors: int
    rx_errors: int
    bus_off: int
    refused: int

    @classmethod
    def of(cls, health: BusHealth, refused: int) -> "NodeErrors":
        """Take what the controller reports."""
        return cls(**{**asdict(health), "state": health.state.name}, refused=refused)


@dataclass(frozen=True, kw_only=True)
class BusTraffic:
    """Everything on the bus, other nodes' frames included.

    Attributes:
        load: share of the time in which the bus was not free, 0 to 1.
        frames: all that went over it.
        error_frames: attempts that were destroyed, or that no node acknowledged.
        longest_wait_ms: of our messages, by their names: the longest time from the hand-over of a frame to the begin of
            the attempt that succeeded. A message of which none was sent is not in it.
    """

    load: float
    frames: int
    error_frames: int
    longest_wait_ms: Mapping[str, float]
    nodes: Mapping[str, NodeErrors]


@dataclass(kw_only=True)
class WaitingTimes:
    """Keeps the longest wait of each message of a set; an observer of the simulated bus."""

    messages: MessageSet
    _longest_ns: dict[int, int] = field(default_factory=dict)

    def __call__(self, seen: Transmission) -> None:
        if seen.frame.is_extended:
            return
        frame_id, waited_ns = seen.frame.frame_id, seen.begin_ns - seen.queued_ns
        self._longest_ns[frame_id] = max(waited_ns, self._longest_ns.get(frame_id, 0))

    def traffic(self, activity: BusActivity, nodes: Mapping[str, NodeErrors]) -> BusTraffic:
        """The traffic with what the bus and the nodes counted."""
        sent = (spec for spec in self.messages.specs if spec.frame_id in self._longest_ns)
        longest = {spec.name: self._longest_ns[spec.frame_id] / 1e6 for spec in sent}
        return BusTraffic(
            load=activity.load,
            frames=activity.frames,
            error_frames=activity.error_frames,
            longest_wait_ms=longest,
            nodes=dict(nodes),
        )
