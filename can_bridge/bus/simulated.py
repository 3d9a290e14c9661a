"""A CAN bus in virtual time: deterministic, without clock, thread or python-can.

Every node holds a port. A frame sent at the bus's time t begins then, or when its own node's frame before it has ended,
and is in the queue of every other port one worst-case frame time later (`can_bridge.wire.bit_timing`). A receiver gets
the frame stamped with the time its transmission began. Nodes do not wait for each other: every frame is charged its
worst case on a bus that is idle otherwise. Frames that begin at the same time are ordered as arbitration orders them,
by identifier.

Time only passes in `advance_to`. Faults wrap a port, which is a `can_bridge.bus.interface.Bus`.
"""

import heapq
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from can_bridge.wire.bit_timing import worst_case_ns
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig


class SimulatedPort:
    """One node's connection to a `SimulatedBus`; made by `SimulatedBus.port`."""

    def __init__(self, bus: "SimulatedBus") -> None:
        self._bus = bus
        self._received: deque[Frame] = deque()
        self.sends_until_ns = 0

    def send(self, frame: Frame) -> None:
        """Hand over one frame at the bus's time; its own timestamp does not count."""
        self._bus.transmit(self, frame)

    def receive_all(self) -> list[Frame]:
        """Everything that has arrived by the bus's time, in order of arrival."""
        frames = list(self._received)
        self._received.clear()
        return frames

    def deliver(self, frame: Frame) -> None:
        """Put a frame into this node's queue; the bus does so when it has arrived."""
        self._received.append(frame)


@dataclass(frozen=True, order=True)
class _Transmission:
    """A frame on its way, in the order of `at_ns`: its begin while it waits, its end while it is on the bus."""

    at_ns: int
    frame_id: int
    serial: int
    frame: Frame = field(compare=False)
    sender: SimulatedPort = field(compare=False)


class SimulatedBus:
    """The wire between ports, at virtual time 0.

    Args:
        config: the bit rates; interface and channel are those of real and python-can's virtual buses.
        capture: called with every frame when its transmission begins, in the order of virtual time.

    Attributes:
        now_ns: the bus's time.
    """

    def __init__(self, config: BusConfig, capture: Callable[[Frame], None] = lambda frame: None) -> None:
        self._config = config
        self._capture = capture
        self._ports: list[SimulatedPort] = []
        self._waiting: list[_Transmission] = []
        self._on_bus: list[_Transmission] = []
        self._serial = 0
        self.now_ns = 0

    def port(self) -> SimulatedPort:
        """Connect one more node."""
        self._ports.append(SimulatedPort(self))
        return self._ports[-1]

    def frame_ns(self, frame: Frame) -> int:
        """How long the frame occupies the bus at worst."""
        return worst_case_ns(
            frame, nominal_bitrate=self._config.nominal_bitrate, data_bitrate=self._config.data_bitrate
        )

    def under_way(self, frame_id: int) -> int:
        """Frames of this identifier that were sent and have not arrived."""
        return sum(item.frame_id == frame_id for item in (*self._waiting, *self._on_bus))

    def advance_to(self, t_ns: int) -> None:
        """Let time pass: begin and deliver everything due up to and including `t_ns`.

        Raises:
            ValueError: for a time before the bus's.
        """
        if t_ns < self.now_ns:
            raise ValueError(f"cannot advance to {t_ns} ns: the bus is at {self.now_ns} ns already")
        self.now_ns = t_ns
        while self._waiting and self._waiting[0].at_ns <= t_ns:
            begun = heapq.heappop(self._waiting)
            self._capture(begun.frame)
            heapq.heappush(self._on_bus, replace(begun, at_ns=begun.at_ns + self.frame_ns(begun.frame)))
        while self._on_bus and self._on_bus[0].at_ns <= t_ns:
            arrived = heapq.heappop(self._on_bus)
            for port in self._ports:
                if port is not arrived.sender:
                    port.deliver(arrived.frame)

    def transmit(self, sender: SimulatedPort, frame: Frame) -> None:
        """Queue a frame behind the sender's earlier ones."""
        begin = max(self.now_ns, sender.sends_until_ns)
        sender.sends_until_ns = begin + self.frame_ns(frame)
        stamped = replace(frame, timestamp_ns=begin)
        self._serial += 1
        heapq.heappush(self._waiting, _Transmission(begin, frame.frame_id, self._serial, stamped, sender))
