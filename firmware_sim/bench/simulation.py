"""A run of the closed loop in virtual time, without files. The arguments are checked when the run is created. When it
starts, a loop with bus, vehicle, ECU and disturbances is set up on a wake at time 0. Equal arguments and an equal wake
give the same run bit for bit on any machine, except for measured wall-clock times."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import date
from typing import Final, Protocol

import numpy as np

from can_bridge.bus.faults.text import text_of
from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated.medium import Corrupts, SimulatedBus, Transmission
from can_bridge.bus.simulated.port import SimulatedPort
from can_bridge.secoc.securing import Authentication, authentication_in_virtual_time
from can_bridge.timing.background import background, send_background
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from contract.arrays import Array
from contract.config.body import layout_of
from contract.config.tree import Config
from contract.config.vehicle import SIMULATED
from contract.controller.calibration import Calibration
from contract.controller.interface import RunnableController
from contract.errors import BusError, ConfigError, StillwakeError
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from ecu.ecu import Ecu
from ecu.fit import check_sensors
from ecu.stepped import LoopEcu
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.disturbing import PORT_NAMES, Disturbing, driving, without_control
from firmware_sim.bench.invariants import Invariants
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import VirtualLoop, check_bit_rates
from firmware_sim.runs.metadata import RunEcu, RunMetadata, RunOrigin
from firmware_sim.runs.run_log import BusTraffic, NodeErrors, Row, RunLog, WaitingTimes
from firmware_sim.runs.summary import ENOUGH_CYCLES
from wake.plant.drive import Drive
from wake.plant.protocol import LoopPlant

WARM_UP_PLANS: Final = 3
"""Number of control steps with zero inputs before the run, because ONNX Runtime's first steps allocate memory."""
SHEDDING_TIME: Final = 5.0
"""Length in t_c of a shedding cycle of the truck's wake, from its Strouhal number of 0.2."""
_LONGEST: Final = 1e6  # longest span in t_c, about a day of the run's time


class Disturbs(Protocol):
    """The interface of disturbances to a loop, which `firmware_sim.bench.disturbing.Disturbing` implements. `corrupts`
    makes the bit errors that all nodes see, `mishears` those that only one receiver sees; None without such errors."""

    corrupts: Corrupts | None
    mishears: Corrupts | None

    def readings(self, cp: Array, now_ns: int) -> Array:
        """Return the transducers' readings, shape (S,), for the wall pressures Cp at the S sensors, shape (S,)."""

    def ecu_clock(self, now_ns: int) -> int:
        """Return the time on the ECU's clock at a time of the run."""

    def connect(self, bus: SimulatedBus) -> Callable[[str, Bus], Bus]:
        """Start the port faults on this bus. Returns a function that adds a node's faults to the node's port."""


@dataclass(frozen=True, kw_only=True)
class WatchedBus:
    """A node's port that also passes each frame to an observer."""

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
    authentication: Authentication | None = None,
    *,
    capture: Callable[[Frame], None] = lambda frame: None,
    observe: Callable[[Transmission], None] = lambda transmission: None,
    observer: Invariants | None = None,
) -> Wired:
    """Assemble a loop. The wake must be at the start of a control period, and the sensors in the order of the Pressure
    message. `capture` is called with every frame on the bus, stamped with the end of its transmission, and `observe`
    with its `Transmission`. Raises ConfigError if the wake lacks a sensor, or settings of the bus are contradictory."""
    messages = message_set(config.bus)
    others = background(config.bus).messages
    waits = WaitingTimes(messages=messages)

    def seen(transmission: Transmission) -> None:
        waits(transmission)
        observe(transmission)

    bus = SimulatedBus(config.bus, capture, observe=seen, corrupts=disturbs.corrupts, mishears=disturbs.mishears)
    ports = {name: bus.port(name) for name in (*PORT_NAMES.values(), "background")[: 3 if others else 2]}
    if others:
        send_background(bus, ports["background"], others, config.bus.background.seed)
    node = VehicleNode(sensors, config, wake.layout, authentication, read=disturbs.readings)
    around = disturbs.connect(bus)

    def port_of(node: str) -> Bus:
        port = around(node, ports[PORT_NAMES[node]])
        if observer is None:
            return port
        return WatchedBus(port=port, node=node, observer=observer, clock=lambda: bus.now_ns)

    at_vehicle, at_ecu = port_of("vehicle"), port_of("ecu")
    loop = VirtualLoop(
        wake, node, ecu, bus, at_vehicle, at_ecu, config, ecu_health=ports["ECU"].health, ecu_clock=disturbs.ecu_clock
    )
    return Wired(bus=bus, ports=ports, node=node, loop=loop, waits=waits)


@dataclass(frozen=True, kw_only=True)
class Spans:
    """The lengths of a run's spans in t_c. Raises StillwakeError if a span is negative, not finite or over 10^6 t_c,
    or, with `averages`, too short for averages. In `lead_in`, without control, the controller's window fills. The
    averages under control leave out the time `settle` after the request for control."""

    lead_in: float
    controlled: float
    settle: float
    averages: bool = True

    def __post_init__(self) -> None:
        for name in ("lead_in", "controlled", "settle"):
            value = getattr(self, name)
            if not 0.0 <= value <= _LONGEST:
                option = name.replace("_", "-")
                raise StillwakeError(f"--{option} = {value}: must be a number of t_c in 0..{_LONGEST:g}")
        if not self.averages:
            return
        least = ENOUGH_CYCLES * SHEDDING_TIME
        remedy = f"must be at least {least:g} t_c ({ENOUGH_CYCLES} shedding cycles) for averages, or give --no-averages"
        if self.lead_in < least:
            raise StillwakeError(f"--lead-in = {self.lead_in:g}: {remedy}")
        if round(left := self.controlled - self.settle, 9) < least:
            spans = f"--controlled = {self.controlled:g} less --settle = {self.settle:g}"
            raise StillwakeError(f"{spans} leaves {left:g} t_c: {remedy}")

    def periods(self, control_period: float) -> tuple[int, int]:
        """Return the numbers of periods without control and of all periods. Raises StillwakeError for an empty span."""
        lead_in, controlled = (round(span / control_period) for span in (self.lead_in, self.controlled))
        for name, count in (("lead-in", lead_in), ("controlled", controlled)):
            if count < 1:
                span = f"--{name} = {getattr(self, name.replace('-', '_')):g}"
                raise StillwakeError(f"{span}: must be at least a control period of {control_period:g} t_c")
        return lead_in, lead_in + controlled


class Simulation:
    """A run that can be executed only once. `config` has the bundle's operating point and control period. `controller`
    computes the bundle's control step; if None, ONNX Runtime computes it. `calibration` is given to the ECU before its
    first step. `ecu` replaces the ECU in Python and its controller. `drive` has the vehicle's speeds from the request
    for control on, and its first speed holds before; if None, the speed is the operating point's. With a drive, the log
    has totals of the drive instead of averages. `periods` has the numbers of control periods without control, and of
    all. Raises StillwakeError if the bundle does not fit the vehicle, the bus does not work in virtual time, the jets
    could never move, a span is too short, a disturbance could not act, or the calibration is out of its limits."""

    def __init__(
        self,
        bundle: Bundle,
        config: Config,
        *,
        spans: Spans,
        controller: RunnableController | None = None,
        calibration: Calibration | None = None,
        disturbances: Disturbances | None = None,
        seed: int = 0,
        ecu: LoopEcu | None = None,
        drive: Drive | None = None,
    ) -> None:
        self._disturbances = Disturbances() if disturbances is None else disturbances
        config = self._disturbances.plant(config)
        self.periods = lead_in, total = spans.periods(config.flow.control_period)
        if (bus := config.bus.interface) != SIMULATED:
            raise BusError(
                f"bus.interface = {bus!r}: a run is in virtual time, on the simulated bus; "
                f"only {SIMULATED!r} is possible"
            )
        check_bit_rates(config)
        if (delay := config.vehicle.actuator_delay) >= total - lead_in:
            reason = f"control is requested for {total - lead_in} periods, so the jets would never move"
            raise StillwakeError(f"vehicle.actuator_delay = {delay}: {reason}; the delay must be shorter")
        self._disturbances.check(config, bundle.manifest.sensors, duration_s=total * config.period_ns / 1e9)
        self._authentication = authentication_in_virtual_time(config.bus)
        # The background traffic is checked first, so that no ECU is created if the bus cannot carry this traffic.
        background(config.bus)
        if ecu is None:
            controller = OnnxController.of(bundle) if controller is None else controller
            controller.warm_up(WARM_UP_PLANS)
            python = Ecu(bundle, controller, config, authentication=self._authentication)
            ecu = LoopEcu(ecu=python, kind="python", computed_by=controller.description)
        self._ecu = ecu
        if calibration is not None:
            self._ecu.ecu.calibrate(calibration)
        self._bundle, self._config, self._spans, self._seed = bundle, config, spans, seed
        self._drive = None if drive is None else drive.after(lead_in * config.period_ns / 1e9)

    def run(
        self,
        wake: LoopPlant,
        *,
        capture: Callable[[Frame], None] = lambda frame: None,
        observer: Invariants | None = None,
        origin: RunOrigin | None = None,
        ready: Callable[[int], None] = lambda total: None,
        requesting: Callable[[], None] = lambda: None,
        progress: Callable[[Row, int, int], None] = lambda row, done, total: None,
        progress_without: Callable[[int, int], None] = lambda done, total: None,
    ) -> RunLog:
        """Run the loop on this wake, which is at the start of a control period. With a drive, the drive is first run
        without control. `origin` is for the run's record; if None, today's date. `capture` is called with every frame
        on the bus, stamped with the end of its transmission; `ready` with the total number of periods before the first
        period; `requesting` before the first period with a request for control; `progress` with (row, periods done,
        total periods) after every period; `progress_without` with the last two after those of the drive without
        control. Raises StillwakeError for a bundle for another body, or a flow that cannot be disturbed or diverges."""
        config, bundle = self._config, self._bundle
        other = self._disturbances.other_body
        if other is None:
            check_sensors(bundle, wake.layout)
        elif not np.array_equal(wake.layout.positions, layout_of(config.body).positions):
            raise ConfigError(f"disturbance {text_of(other)!r}: the plant has a different body")
        (lead_in, total), sensors = self.periods, bundle.manifest.sensors
        disturbing, again = (Disturbing(self._disturbances, config, sensors, self._seed, {}) for _ in range(2))
        wired = wire(
            wake, sensors, config, self._ecu, disturbing, self._authentication, capture=capture, observer=observer
        )
        loop, node = wired.loop, wired.node
        disturbing.plan_resets(wired.bus, loop)
        rows, without, drive = list[Row](), None, self._drive
        with ExitStack() as flow:
            if drive is not None:
                plant = flow.enter_context(driving(wake, drive, config))
                without = without_control(plant, again, config, total, progress_without)
            flow.enter_context(disturbing.in_flow(wake))
            ready(total)
            for k in range(total):
                if k == lead_in:
                    requesting()
                start_ns = loop.now_ns
                requested = disturbing.requests(k >= lead_in, start_ns)
                disturbing.set_flow(start_ns)
                if drive is not None:
                    node.speed = drive.speed(start_ns / 1e9)
                disturbing.before_period(start_ns, node)
                row = loop.period(enable_request=requested)
                rows.append(row)
                if observer is not None:
                    observer.period(row.sample, requested=requested)
                progress(row, k + 1, total)
            if observer is not None:
                observer.finished(wake.sample())
        metadata = RunMetadata.of(
            bundle,
            config,
            settle=self._spans.settle,
            averages=self._spans.averages,
            status=self._ecu.ecu.status(),
            plant=wake.description,
            computed_by=self._ecu.computed_by,
            ecu=RunEcu.of(self._ecu.kind, self._ecu.clock_mhz, loop.planned_ns),
            origin=RunOrigin.on(date.today()) if origin is None else origin,
            calibration=self._ecu.ecu.calibration,
            faults=disturbing.injected(),
            fault_seed=self._seed,
            drive=None if drive is None else drive.name,
        )
        return RunLog.of(rows, lead_in, loop.totals(), metadata, wake.layout, traffic=wired.traffic(), without=without)
