"""Two nodes on a bus, simulated or python-can's, and streams of frames over it with faults at either end."""

from collections.abc import Callable, Sequence

from can_bridge.bus.faults.fault import BusFault, FaultyBus, wrap
from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig

PERIOD_NS = 20_000_000
PERIOD_S = 0.02


def numbered(number: int, *, frame_id: int = 0x120, now_ns: int = 0) -> Frame:
    """A frame that differs from all others."""
    return Frame(frame_id=frame_id, data=number.to_bytes(8, "little"), timestamp_ns=now_ns)


def number_of(frame: Frame) -> int:
    return int.from_bytes(frame.data[:8], "little")


def numbers(received: Sequence[Sequence[Frame]]) -> list[int]:
    return [number_of(frame) for frames in received for frame in frames]


class Link:
    """Two nodes, a third that only listens, and the time."""

    def __init__(self, ports: Sequence[Bus], advance_to: Callable[[int], None] = lambda t_ns: None) -> None:
        self.one, self.other, self.listener = ports
        self._advance_to = advance_to
        self.now_ns = 0

    def clock(self) -> int:
        return self.now_ns

    def advance(self, by_ns: int = PERIOD_NS) -> None:
        self.now_ns += by_ns
        self._advance_to(self.now_ns)

    def wrapped(self, port: Bus, *faults: BusFault, seed: int = 1) -> FaultyBus:
        return wrap(port, faults, self.clock, seed=seed)

    def stream(self, sender: Bus, receiver: Bus, periods: int, *, frame_ids: Sequence[int] = (0x120,)) -> list[list]:
        """A numbered frame of each identifier a period; what was received by the end of each period."""
        received = []
        for _ in range(periods):
            for frame_id in frame_ids:
                sender.send(numbered(self.now_ns // PERIOD_NS, frame_id=frame_id, now_ns=self.now_ns))
            self.advance()
            received.append(receiver.receive_all())
        return received


def simulated_link() -> Link:
    bus = SimulatedBus(BusConfig())
    return Link([bus.port() for _ in range(3)], bus.advance_to)
