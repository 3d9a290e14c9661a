"""A bus around a bus: passes everything on, and is where a fault acts."""

from collections.abc import Callable

from can_bridge.bus.interface import HEALTHY, Bus, BusHealth
from can_bridge.wire.frame import Frame


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


class Injector(Around):
    """Passes everything on; each fault's own injector changes what it needs to. `acted` counts how often the fault did
    something; each fault defines what it counts."""

    def __init__(self, bus: Bus) -> None:
        super().__init__(bus)
        self.acted = 0
