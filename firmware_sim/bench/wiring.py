"""The code that sets up a loop, with bus, vehicle, ECU and disturbances, on one wake at time 0."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated.background_node import BackgroundNode
from can_bridge.bus.simulated.medium import Corrupts, SimulatedBus, Transmission
from can_bridge.bus.simulated.port import SimulatedPort
from can_bridge.secoc.node import Authentication
from can_bridge.timing.background import background
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from contract.arrays import Array
from contract.config.tree import Config
from ecu.stepped import LoopEcu
from firmware_sim.bench.disturbing import PORT_NAMES
from firmware_sim.bench.invariants import Invariants
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import VirtualLoop
from firmware_sim.runs.run_log import BusTraffic, NodeErrors, WaitingTimes
from wake.plant.protocol import LoopPlant


class Disturbs(Protocol):
    """The disturbances that act on the parts of a loop, implemented by `firmware_sim.bench.disturbing.Disturbing`."""

    @property
    def corrupts(self) -> Corrupts | None:
        """Function that makes the bit errors that all nodes see; None without such errors."""

    @property
    def mishears(self) -> Corrupts | None:
        """Function that makes the bit errors that only one receiver sees; None without such errors."""

    def readings(self, cp: Array, now_ns: int) -> Array:
        """Return the transducers' readings, shape (S,), for the wall pressures Cp at the S sensors, shape (S,)."""

    def ecu_clock(self, now_ns: int) -> int:
        """Return the time on the ECU's clock at a time of the run."""

    def connect(self, bus: SimulatedBus) -> Callable[[str, Bus], Bus]:
        """Start the port faults on this bus. Returns a function that adds a node's faults to the node's port."""


@dataclass(frozen=True, kw_only=True)
class WatchedBus:
    """A node's port whose frames an observer sees."""

    port: Bus
    node: str
    observer: Invariants
    clock: Callable[[], int]

    def send(self, frame: Frame) -> None:
        self.observer.frame(frame, node=self.node, sent=True, now_ns=self.clock())
        self.port.send(frame)

    def receive_all(self) -> list[Frame]:
        frames = self.port.receive_all()
        for frame in frames:
            self.observer.frame(frame, node=self.node, sent=False, now_ns=self.clock())
        return frames


@dataclass(frozen=True, kw_only=True, eq=False)
class Wired:
    """A loop that is ready for its first period; `ports` has the bus's ports by node name, without fault wrappers."""

    bus: SimulatedBus
    ports: dict[str, SimulatedPort]
    node: VehicleNode
    loop: VirtualLoop
    waits: WaitingTimes

    def traffic(self) -> BusTraffic:
        return self.waits.traffic(self.bus.activity(), self.errors())

    def errors(self) -> dict[str, NodeErrors]:
        return {name: NodeErrors.of(port.health(), port.refused) for name, port in self.ports.items()}


def wire(
    wake: LoopPlant,
    sensors: Sequence[str],
    config: Config,
    ecu: LoopEcu,
    disturbs: Disturbs,
    *,
    authentication: Authentication | None = None,
    capture: Callable[[Frame], None] = lambda frame: None,
    observe: Callable[[Transmission], None] = lambda transmission: None,
    observer: Invariants | None = None,
) -> Wired:
    """Assemble a loop. Raises ConfigError if the wake lacks a sensor, or settings of the bus contradict each other.

    Args:
        wake: a plant at the start of a control period.
        sensors: sensors of the bundle, in the order of the Pressure message.
        capture: called with every frame on the bus, stamped with the end of its transmission.
        observe: called with a `Transmission` for each of these frames.
    """
    messages = message_set(config.bus)
    others = background(config.bus).messages
    waits = WaitingTimes(messages=messages)

    def seen(transmission: Transmission) -> None:
        waits(transmission)
        observe(transmission)

    bus = SimulatedBus(config.bus, capture, observe=seen, corrupts=disturbs.corrupts, mishears=disturbs.mishears)
    ports = {name: bus.port(name) for name in (*PORT_NAMES.values(), "background")[: 3 if others else 2]}
    if others:
        BackgroundNode(bus, ports["background"], others, config.bus.background.seed)
    node = VehicleNode(sensors, config, wake.layout, authentication, read=disturbs.readings)
    around = disturbs.connect(bus)

    def port_of(node: str) -> Bus:
        port = around(node, ports[PORT_NAMES[node]])
        if observer is None:
            return port
        return WatchedBus(port=port, node=node, observer=observer, clock=lambda: bus.now_ns)

    loop = VirtualLoop(
        wake,
        node,
        ecu.ecu,
        bus,
        port_of("vehicle"),
        port_of("ecu"),
        config,
        ecu_health=ports["ECU"].health,
        ecu_clock=disturbs.ecu_clock,
        step_ns=ecu.step_ns,
    )
    return Wired(bus=bus, ports=ports, node=node, loop=loop, waits=waits)
