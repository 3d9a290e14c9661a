"""The disturbances that are switched on and off while the loop runs, each at the start of a control period.

A disturbance acts as in a run in which it starts at the same time. Each disturbance is an item with its own
`firmware_sim.bench.disturbing.Disturbing`, whose random sequences are numbered after all earlier items' sequences. The
items of the transducers, and of each node's port, are in the order of the settings; when an item changes, the items
after it end and start again. An ended item in a port passes all new frames on unchanged. It is removed `LINGER_S`
later, so that frames that it still delays reach the node in order.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Final

import numpy as np

from can_bridge.bus.faults.fault import NS, Span, WrappedBus
from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated.medium import Corrupts, SimulatedBus
from contract.arrays import Array
from contract.config.tree import Config
from firmware_sim.bench.disturbances import NODES, Disturbances, NodeFault
from firmware_sim.bench.disturbing import Disturbing

LINGER_S: Final = 1.0
"""Virtual time in s from the end of an item to its removal: five times the longest delay that can be set."""


class SwitchedPort(WrappedBus):
    """A node's port with layers (faults) that are added and removed while the bus runs. The first layer is next to the
    bus. Under each layer is a plug, a `WrappedBus` whose bus is replaced when the layer below it is removed."""

    def __init__(self, port: Bus) -> None:
        super().__init__(port)
        self._plugs: list[WrappedBus] = []

    def put(self, layer: Callable[[Bus], Bus]) -> WrappedBus:
        """Add a layer around the present layers. Returns the plug that `take_out` needs to remove the layer."""
        plug = WrappedBus(self._bus)
        self._bus = layer(plug)
        self._plugs.append(plug)
        return plug

    def take_out(self, plug: WrappedBus) -> None:
        """Remove the layer that `put` added with this plug; frames that the layer still delays are lost."""
        place = self._plugs.index(plug)
        above = self._plugs[place + 1] if place + 1 < len(self._plugs) else self
        above._bus = plug._bus
        del self._plugs[place]


@dataclass(kw_only=True, eq=False)
class _Item:
    """A disturbance. `text` describes it without times; `end` is the first period in which it no longer acts."""

    text: str
    group: str
    span: Span
    work: Disturbing
    end: int = 0
    plugs: list[tuple[SwitchedPort, WrappedBus]] = field(default_factory=list)


class SwitchedDisturbances:
    """The disturbances of one run of the loop; an implementation of `firmware_sim.bench.simulation.Disturbs`. `read`
    has the latest readings of the S sensors, shape (S,); NaN before the first reading."""

    corrupts: Corrupts | None = None  # no setting of a viewer causes bit errors on the bus
    mishears: Corrupts | None = None

    def __init__(self, config: Config, sensors: Sequence[str]) -> None:
        self._config, self._sensors = config, tuple(sensors)
        self._before: Counter[str] = Counter()
        self._items: list[_Item] = []
        self._lingering: list[_Item] = []
        self._ports: dict[str, SwitchedPort] = {}
        self._bus: SimulatedBus | None = None
        self.read = np.full(len(self._sensors), np.nan)

    def readings(self, cp: Array, now_ns: int) -> Array:
        for item in self._items:
            cp = item.work.readings(cp, now_ns)
        self.read = cp
        return cp

    def ecu_clock(self, now_ns: int) -> int:
        return now_ns

    def connect(self, bus: SimulatedBus) -> Callable[[str, Bus], Bus]:
        self._bus = bus

        def around(node: str, port: Bus) -> Bus:
            self._ports[node] = SwitchedPort(port)
            return self._ports[node]

        return around

    def set(self, texts: Sequence[str], k: int) -> bool:
        """Apply only these disturbances, given as texts without times, from period k on. Period k must not have started
        on the bus. Return whether a disturbance starts. Raises ConfigError for a text that describes no disturbance."""
        assert self._bus is not None
        new: list[tuple[str, str]] = []
        for group in ("sensors", *NODES):
            acting = [item for item in self._items if item.group == group]
            here = [text for text in texts if _group(text) == group]
            pairs = zip(acting, here, strict=False)
            same = len(list(takewhile(lambda pair: pair[0].text == pair[1], pairs)))
            new += [(text, group) for text in here[same:]]
            for item in acting[same:]:
                item.end = k
                # A disturbance reads its end from its span, so the span is changed although its class is frozen.
                object.__setattr__(item.span, "end_s", k * self._config.period_ns / NS)
                self._items.remove(item)
                if item.plugs:
                    self._lingering.append(item)
        # Bus events at the start of period k must see neither the old disturbances nor the new disturbances.
        self._bus.advance_to(k * self._config.period_ns)
        for text, group in new:
            self._begin(text, group, k)
        return bool(new)

    def period_over(self, k: int) -> None:
        """Remove the items that ended `LINGER_S` or more before the end of period k; these delay no frames now."""
        linger = round(LINGER_S * NS / self._config.period_ns)
        for item in [one for one in self._lingering if one.end + linger <= k + 1]:
            self._lingering.remove(item)
            item.work.end()
            for port, plug in item.plugs:
                port.take_out(plug)

    def _begin(self, text: str, group: str, k: int) -> None:
        assert self._bus is not None
        start_s = k * self._config.period_ns / NS
        disturbances = Disturbances.parse([f"{text}@{start_s!r}.."])
        (one,) = disturbances.items
        work = Disturbing(disturbances, self._config, self._sensors, 0, dict(self._before))
        span = one.fault if isinstance(one, NodeFault) else one
        item = _Item(text=text, group=group, span=span, work=work)
        self._before["all"] += 1
        if group in NODES:
            self._before[group] += 1
            around, port = work.connect(self._bus), self._ports[group]
            item.plugs = [(port, port.put(lambda plug: around(group, plug)))]
        self._items.append(item)


def _group(text: str) -> str:
    node = text.partition(":")[0]
    return node if node in NODES else "sensors"
