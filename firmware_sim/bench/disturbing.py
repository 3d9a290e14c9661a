"""The state of disturbances during a run, and their effects on the bus, ports, transducers, flow, vehicle and ECU.
The module also runs a plant whose inflow follows a drive, and the same drive without control for comparison."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Final, TypeVar

import numpy as np

from can_bridge.bus.faults.fault import NS, FaultyBus, Span, WrappedBus, wrap
from can_bridge.bus.faults.frame_faults import WireErrors
from can_bridge.bus.faults.node_faults import Babble
from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated.medium import Corrupts, SimulatedBus
from can_bridge.wire.frame import Frame
from contract.arrays import Array
from contract.config.tree import Config
from contract.errors import ConfigError, PlantError
from firmware_sim.bench import disturbances as kinds
from firmware_sim.bench.disturbances import NODES, Disturbances, NodeFault
from firmware_sim.bench.sensor_faults import SensorDisturbance
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import VirtualLoop
from firmware_sim.runs.metadata import InjectedFault
from firmware_sim.runs.run_log import WITHOUT
from wake.plant.drive import Drive, Gust
from wake.plant.protocol import Disturbable, Drivable, Plant
from wake.plant.sample import Sample

S = TypeVar("S", bound=Span)
PORT_NAMES: Final = {"vehicle": "vehicle", "ecu": "ECU"}
"""Names of the nodes' ports on the simulated bus, by the nodes' names in disturbances."""
LOOK_NS: Final = 1_000_000
"""Time in ns between two bus events that are added for port faults. At each event, the ports can release frames."""


class _Babbling(WrappedBus):
    """A port with a babbling fault, which also sends, receives and stores frames between the node's calls."""

    def __init__(self, port: Bus) -> None:
        super().__init__(port)
        self._kept: list[Frame] = []

    def look(self) -> None:
        self._kept += self._bus.receive_all()

    def receive_all(self) -> list[Frame]:
        frames, self._kept = [*self._kept, *self._bus.receive_all()], []
        return frames


class Disturbing:
    """An object that applies all disturbances of one run. `sensors` are in the order of the readings. `before` counts
    the random sequences of earlier disturbances: "all" has the total, a node's name the number in the node's port."""

    def __init__(
        self, disturbances: Disturbances, config: Config, sensors: Sequence[str], seed: int, before: Mapping[str, int]
    ) -> None:
        self._items, self._texts = disturbances.items, disturbances.texts
        self._config, self._seed, self._before = config, seed, before
        self._acted: Counter[int] = Counter()
        self._transducers = []
        self._in_ports: dict[int, NodeFault] = {}  # by the disturbance's index
        for place, item in enumerate(self._items):
            if isinstance(item, SensorDisturbance):
                drawn = np.random.SeedSequence([seed, before.get("all", 0) + place])
                at = [list(sensors).index(name) for name in item.named]
                self._transducers.append((place, item, item.begun(at, config, int(drawn.generate_state(1)[0]))))
            elif isinstance(item, kinds.WrongClock):
                self._in_ports[place] = NodeFault(text=self._texts[place], node="ecu", fault=item)
            elif isinstance(item, NodeFault):
                self._in_ports[place] = item
        self._speeds: list[float] = []  # vehicle's speed in every period so far, m/s
        self._frozen: dict[int, float] = {}
        self._flow: tuple[Disturbable, float] | None = None  # plant and its own Reynolds number
        self._bus: SimulatedBus  # set by `connect`
        self._ports: dict[str, FaultyBus] = {}
        self._babbling: list[_Babbling] = []
        self._ended = False
        self.corrupts, self.mishears = self._wire("send"), self._wire("receive")

    def connect(self, bus: SimulatedBus) -> Callable[[str, Bus], Bus]:
        self._bus = bus
        if self._in_ports:
            self._look()
        return self._around

    def _around(self, node: str, port: Bus) -> Bus:
        """Return the node's port with the node's faults, the first of them closest to the bus; or the port itself."""
        mine = [one.fault for one in self._in_ports.values() if one.node == node]
        if not mine:
            return port
        # Equal faults in both nodes must not affect the same frames, so the seed depends on the node.
        seed, first = len(NODES) * self._seed + NODES.index(node), self._before.get(node, 0)
        faulty = self._ports[node] = wrap(port, mine, lambda: self._bus.now_ns, seed=seed, first=first)
        if not any(isinstance(one, Babble) for one in mine):
            return faulty
        self._babbling.append(_Babbling(faulty))
        return self._babbling[-1]

    def _look(self) -> None:
        if self._ended:
            return
        # This function is a bus event. After each event, the loop reads the ECU's port, which releases delayed frames.
        for port in self._babbling:
            port.look()
        self._bus.call_at(self._bus.now_ns + LOOK_NS, self._look)

    def end(self) -> None:
        """Stop calling the ports periodically. From then on, faults act only when a node uses its port."""
        self._ended = True

    def _wire(self, at: str) -> Corrupts | None:
        hooks = {}
        for place, one in self._each(kinds.WireNoise):
            if one.at == at:
                nodes = () if one.node == "all" else (PORT_NAMES[one.node],)
                errors = WireErrors(
                    bit_error_rate=one.bit_error_rate, nodes=nodes, start_s=one.start_s, end_s=one.end_s
                )
                # The seed includes the disturbance's index, so that each disturbance draws different random numbers.
                hooks[place] = errors.hook(len(self._items) * self._seed + place)

        def first_wrong_bit(frame: Frame, node: str, begin_ns: int) -> int | None:
            wrong = {place: bit for place, hook in hooks.items() if (bit := hook(frame, node, begin_ns)) is not None}
            self._acted.update(wrong.keys())
            return min(wrong.values(), default=None)

        return first_wrong_bit if hooks else None

    def readings(self, cp: Array, now_ns: int) -> Array:
        for place, one, fault in self._transducers:
            if one.is_active(now_ns):
                cp = fault(cp)
                self._acted[place] += 1
        return cp

    def ecu_clock(self, now_ns: int) -> int:
        for _, clock in self._each(kinds.WrongClock):
            now_ns = clock.local_ns(now_ns)
        return now_ns

    def plan_resets(self, bus: SimulatedBus, loop: VirtualLoop) -> None:
        def reset(place: int, boot_ns: int) -> None:
            loop.reset_ecu(boot_ns)
            self._acted[place] += 1

        for place, one in self._each(kinds.Reset):
            bus.call_at(round(one.start_s * NS), partial(reset, place, round(one.boot_s * NS)))

    def requests(self, enable_request: bool, now_ns: int) -> bool:
        """Return the vehicle's request for control: `enable_request`, unless a disturbance withdraws it."""
        return enable_request and not list(self._acting(kinds.NoRequest, now_ns))

    def before_period(self, now_ns: int, node: VehicleNode) -> None:
        """Set those properties of the vehicle that disturbances change, for the period that starts now."""
        full = self._config.flow.action_limit
        point, limit, stuck_at = self._config.operating_point, full, None
        for _, vehicle in self._acting(kinds.VehiclePoint, now_ns):
            point = vehicle.instead_of(point)
        for _, saturated in self._acting(kinds.ActionLimit, now_ns):
            limit = saturated.action_limit * full
        for _, stuck in self._acting(kinds.StuckJets, now_ns):
            stuck_at = stuck.stuck_jets * full
        stated_density = None
        for _, air in self._acting(kinds.Density, now_ns):
            point, stated_density = air.instead_of(point), air.density if air.stated else None
        node.operating_point, node.action_limit, node.stuck_at = point, limit, stuck_at
        node.stated_density = stated_density
        list(self._acting(kinds.OtherBody, now_ns))
        # Disturbances of the sent speed act in this order: late, frozen, scaled, absent.
        self._speeds.append(node.speed)
        stated = node.speed
        for _, late in self._acting(kinds.SpeedLate, now_ns):
            stated = self._speeds[max(0, len(self._speeds) - 1 - round(late.speed_late * NS / self._config.period_ns))]
        for place, _ in self._acting(kinds.SpeedFrozen, now_ns):
            stated = self._frozen.setdefault(place, stated)
        for _, wrong in self._acting(kinds.SpeedScale, now_ns):
            stated *= wrong.speed_scale
        node.stated_speed, node.sends_speed = stated, not list(self._acting(kinds.NoSpeed, now_ns))

    def set_flow(self, now_ns: int) -> None:
        """Set the flow's Reynolds number for the period that starts now."""
        if self._flow is None:
            return
        plant, reynolds = self._flow
        for _, viscous in self._acting(kinds.Reynolds, now_ns):
            reynolds = viscous.reynolds
        list(self._acting(kinds.GustyWind, now_ns))
        if plant.config.reynolds != reynolds:
            plant.set_reynolds(reynolds)

    @contextmanager
    def in_flow(self, plant: Plant) -> Iterator[None]:
        """Add the gusts to the plant's wind in a block that begins with the run; then restore wind and viscosity."""
        if not any(isinstance(one, kinds.Reynolds | kinds.GustyWind) for one in self._items):
            yield
            return
        if not isinstance(plant, Disturbable):
            raise ConfigError("reynolds, gust: this plant cannot change its flow (`wake.plant.protocol.Disturbable`)")
        t_c, gusts = self._config.operating_point.convective_time, []
        for _, one in self._each(kinds.GustyWind):
            cycles, start = kinds.whole_cycles(one, t_c), plant.t + one.start_s / t_c
            gusts.append(Gust(amplitude=one.amplitude, period=one.period, start=start, cycles=cycles))
        before, wind = plant.config.reynolds, plant.wind
        self._flow = plant, before

        def blown(t: float) -> float:
            return (0.0 if wind is None else wind(t)) + sum(gust(t) for gust in gusts)

        if gusts:  # without gusts, the plant keeps its wind, which a drive may have set
            plant.wind = blown

        def restore() -> None:
            plant.wind = wind
            if plant.config.reynolds != before:
                plant.set_reynolds(before)

        try:
            yield
        except BaseException:
            # If the plant failed, restoring its viscosity may fail too; the user needs only the first error.
            with suppress(PlantError):
                restore()
            raise
        restore()

    def injected(self) -> tuple[InjectedFault, ...]:
        """Return each disturbance with the number of times it has acted so far, in the order given."""
        injectors = {node: iter(port.injectors) for node, port in self._ports.items()}
        in_ports = {place: next(injectors[one.node]).acted for place, one in self._in_ports.items()}
        acted = self._acted | Counter(in_ports)
        return tuple(InjectedFault(text=text, acted=acted[place]) for place, text in enumerate(self._texts))

    def _each(self, kind: type[S]) -> Iterator[tuple[int, S]]:
        return ((place, one) for place, one in enumerate(self._items) if isinstance(one, kind))

    def _acting(self, kind: type[S], now_ns: int) -> Iterator[tuple[int, S]]:
        """Yield the disturbances of a kind that act now, each with its index, and count that they acted."""
        for place, one in self._each(kind):
            if one.is_active(now_ns):
                self._acted[place] += 1
                yield place, one


@contextmanager
def driving(plant: Plant, drive: Drive, config: Config) -> Iterator[Drivable]:
    """Make the plant's inflow follow the drive while the block runs. At the start, the wake is scaled to the drive's
    first speed; the wake adapts fully in the time without control. Raises ConfigError if the plant's speed is fixed."""
    if not isinstance(plant, Drivable):
        raise ConfigError(f"drive {drive.name}: this plant has a constant speed (`wake.plant.protocol.Drivable`)")
    wind, first = plant.wind, drive.speeds[0] / config.operating_point.speed
    plant.wind = drive.wind(config.operating_point, plant.t)
    try:
        if first != 1.0:
            plant.scale(first)
        yield plant
    finally:
        plant.wind = wind


def uncontrolled(plant: Plant, disturbing: Disturbing, config: Config, periods: int) -> Iterator[Sample]:
    """Run control periods with the jets shut, and yield the sample at the start of each period. Only the disturbances
    of the flow act. Raises PlantError if the flow diverges."""
    with disturbing.in_flow(plant):
        for k in range(periods):
            disturbing.set_flow(k * config.period_ns)
            sample = plant.sample()
            plant.advance_to(config.flow.substeps, 0.0)
            yield sample


def without_control(
    plant: Drivable, disturbing: Disturbing, config: Config, periods: int, progress: Callable[[int, int], None]
) -> dict[str, Array]:
    """Compute the series `WITHOUT` with shut jets, then reset the plant. `progress` gets (periods done, total)."""
    start, rows = plant.state(), np.empty((periods, len(WITHOUT)))
    for k, sample in enumerate(uncontrolled(plant, disturbing, config, periods)):
        rows[k] = sample.Cd, sample.Cd_net, sample.Cl
        progress(k + 1, periods)
    plant.reset(start)
    return dict(zip(WITHOUT, rows.T, strict=True))
