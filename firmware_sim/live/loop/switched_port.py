"""A node's connection to a bus, around which layers are put and from which they are taken while the bus runs."""

from collections.abc import Callable

from can_bridge.bus.faults.injector import Around
from can_bridge.bus.interface import Bus
from can_bridge.wire.frame import Frame


class Plug:
    """Passes everything on to what lies beneath, which may be exchanged."""

    def __init__(self, beneath: Bus) -> None:
        self.beneath = beneath

    def send(self, frame: Frame) -> None:
        """See `Bus.send`."""
        self.beneath.send(frame)

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        return self.beneath.receive_all()


class SwitchedPort(Around):
    """A port with layers, the first of which is next to the wire."""

    def __init__(self, port: Bus) -> None:
        self._plugs: list[Plug] = []
        self._top = Plug(port)
        super().__init__(self._top)

    def __len__(self) -> int:
        return len(self._plugs)

    def put(self, layer: Callable[[Bus], Bus]) -> Plug:
        """Put a layer around what is there; returns what it is taken out by."""
        plug = Plug(self._top.beneath)
        self._top.beneath = layer(plug)
        self._plugs.append(plug)
        return plug

    def take_out(self, plug: Plug) -> None:
        """Take out the layer over this plug; what it holds is lost. Raises ValueError if it is not in here."""
        place = self._plugs.index(plug)
        above = self._plugs[place + 1] if place + 1 < len(self._plugs) else self._top
        above.beneath = plug.beneath
        del self._plugs[place]
