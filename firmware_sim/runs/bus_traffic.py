"""The traffic on the bus in a run: load, errors, and the longest waits of the project's own frames."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from can_bridge.bus.interface import BusHealth
from can_bridge.bus.simulated.medium import BusActivity, Transmission
from can_bridge.wire.message_sets import MessageSet


@dataclass(frozen=True, kw_only=True)
class NodeErrors:
    """The state of a node's CAN controller at the end of the run: the name of a `can_bridge.bus.interface.BusState`,
    error counters, and the numbers of bus-offs and of frames that the controller could not send."""

    state: str
    tx_errors: int
    rx_errors: int
    bus_off: int
    refused: int

    @classmethod
    def of(cls, health: BusHealth, refused: int) -> "NodeErrors":
        return cls(**{**asdict(health), "state": health.state.name}, refused=refused)


@dataclass(frozen=True, kw_only=True)
class BusTraffic:
    """All traffic on the bus, including other nodes' frames.

    Attributes:
        load: share of the time in which the bus was not free, 0 to 1.
        error_frames: number of attempts to send that were destroyed by an error, or that no node acknowledged.
        longest_wait_ms: longest time from the send queue to the successful transmission, by name of our message.
    """

    load: float
    frames: int
    error_frames: int
    longest_wait_ms: Mapping[str, float]
    nodes: Mapping[str, NodeErrors]


@dataclass(kw_only=True)
class WaitingTimes:
    """An observer of the simulated bus that records the longest wait of a frame, for each message of a set."""

    messages: MessageSet
    _longest_ns: dict[int, int] = field(default_factory=dict)

    def __call__(self, seen: Transmission) -> None:
        if seen.frame.is_extended:
            return
        frame_id, waited_ns = seen.frame.frame_id, seen.begin_ns - seen.queued_ns
        self._longest_ns[frame_id] = max(waited_ns, self._longest_ns.get(frame_id, 0))

    def traffic(self, activity: BusActivity, nodes: Mapping[str, NodeErrors]) -> BusTraffic:
        sent = (spec for spec in self.messages.specs if spec.frame_id in self._longest_ns)
        longest = {spec.name: self._longest_ns[spec.frame_id] / 1e6 for spec in sent}
        counts = {name: getattr(activity, name) for name in ("load", "frames", "error_frames")}
        return BusTraffic(**counts, longest_wait_ms=longest, nodes=dict(nodes))
