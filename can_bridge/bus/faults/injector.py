"""A bus around a bus: passes everything on, and is where a fault acts."""

from collections.abc import Callable, Iterable
from random import Random
from typing import Generic, TypeVar

from can_bridge.bus.interface import HEALTHY, Bus, BusHealth
from can_bridge.wire.frame import Frame

F = TypeVar("F")


class Around:
    """Passes everything on to the bus beneath."""

    def __init__(self, beneath: Bus) -> None:
        self._bus = beneath

    def send(self, frame: Frame) -> None:
        """See `Bus.send`."""
        self._bus.send(frame)

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        return self._bus.receive_all()

    def health(self) -> BusHealth:
        """The health of the CAN controller beneath; healthy if the bus does not know it."""
        health: Callable[[], BusHealth] | None = getattr(self._bus, "health", None)
        return HEALTHY if health is None else health()


class Arrivals:
    """Tells when frames arrived: at their time stamp, if that lies between the node's last two looks at the bus, as it
    does where stamps and looks have one clock; otherwise at the look that found them. Never before the frame ahead.
    """

    def __init__(self) -> None:
        self._looked_ns = 0
        self._latest_ns = 0

    def of(self, frames: Iterable[Frame], now_ns: int) -> list[tuple[int, Frame]]:
        """The frames found now, each with the time of its arrival."""
        arrived: list[tuple[int, Frame]] = []
        for frame in frames:
            stamp_ns = frame.timestamp_ns
            # The bus returns the oldest first, whatever their stamps are.
            self._latest_ns = max(self._latest_ns, stamp_ns if self._looked_ns <= stamp_ns <= now_ns else now_ns)
            arrived.append((self._latest_ns, frame))
        self._looked_ns = now_ns
        return arrived


class Injector(Around, Generic[F]):
    """Passes everything on; each fault's own injector changes what it needs to. `acted` counts how often the fault did
    something; each fault defines what it counts."""

    def __init__(self, bus: Bus, fault: F, clock: Callable[[], int], random: Random) -> None:
        """Args: as `can_bridge.bus.faults.fault.Fault.around` has them."""
        super().__init__(bus)
        self._fault, self._clock, self._random = fault, clock, random
        self._arrivals = Arrivals()
        self.acted = 0
