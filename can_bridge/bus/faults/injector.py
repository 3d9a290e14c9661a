"""A bus around a bus: passes everything on, and is where a fault acts."""

from collections.abc import Callable

from can_bridge.bus.interface import HEALTHY, Bus, BusHealth
from can_bridge.wire.frame import Frame


class Injector:
    """Passes everything on; each fault's own injector changes what it needs to. `acted` counts how often the fault did
    something; each fault defines what it counts."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self.acted = 0

    def send(self, frame: Frame) -> None:
        """See `Bus.send`."""
        self._bus.send(frame)

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        return self._bus.receive_all()

    def health(self) -> BusHealth:
        """See `health_of`."""
        return health_of(self._bus)


def health_of(bus: Bus) -> BusHealth:
    """The health of the CAN controller beneath; healthy if the bus does not know it."""
    health: Callable[[], BusHealth] | None = getattr(bus, "health", None)
    return HEALTHY if health is None else health()
