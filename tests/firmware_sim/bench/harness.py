"""A plant of two numbers, one loop in virtual time around it, and whole runs of that with what was seen of them."""

from dataclasses import replace
from itertools import count
from math import cos
from typing import Any

import numpy as np

from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND, PRESSURE, VEHICLE_SPEED
from contract import sensors
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from ecu.ecu import Ecu
from ecu.stepped import LoopEcu
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.disturbing import Disturbing
from firmware_sim.bench.simulation import Simulation, Spans, wire
from firmware_sim.runs.run_log import WALL, RunLog
from tests.can_bridge.wire.described import DBC
from tests.ecu.conftest import RecordingController, make_bundle
from wake.plant.sample import Sample

DEFAULT = Config()
NAMES = ("upper_39", "lower_39", "base_0", "base_9")
BIT_NS = 2000  # at 500 kbit/s
INTERMISSION_NS = 3 * BIT_NS
WARM = 6
"""Periods with a request until the window of four is full and both ends trust each other."""
SPANS = Spans(lead_in=2.0, controlled=10.0, settle=0.0, averages=False)
"""10 periods and 50 of 20 ms; control from 0.2 s on, with a window of four periods."""


class Oscillator:
    """x'' + x = a, seen as Cd, Cl and pressures; `asked` keeps every advance as (period, substep, action)."""

    def __init__(self, substeps: int) -> None:
        self.substeps, self.substep, self.period = substeps, 0, 0
        self.x, self.v, self.action = 1.0, 0.0, 0.0
        self.asked: list[tuple[int, int, float | None]] = []

    def sample(self) -> Sample:
        phase, x, v = np.linspace(0.0, 3.0, sensors.COUNT), self.x, self.v
        slots = {"Cd_slot_pressure": 0.1 * x, "Cd_slot_viscous": -0.01 * v, "Cd_momentum": -(self.action**2)}
        forces = {"Cd": 1.0 + x**2, "Cl": v, **slots, "jet_power": 0.0}
        cp = x * np.cos(phase) + v * np.sin(phase)
        return Sample(t=self.t, Cp=cp, **forces, Uy_probe=x - v, action=self.action)

    @property
    def t(self) -> float:
        return 0.2 * (self.period + self.substep / self.substeps)

    def advance_to(self, substep: int, action: float | None = None) -> None:
        assert self.substep < substep <= self.substeps
        self.asked.append((self.period, substep, action))
        target, left = self.action if action is None else action, self.substeps - self.substep
        for _ in range(substep - self.substep):
            self.action += (target - self.action) / left
            left -= 1
            self.v += 0.2 / self.substeps * (self.action - self.x)
            self.x += 0.2 / self.substeps * self.v
        self.substep = substep % self.substeps
        if self.substep == 0:
            self.period += 1
            self.action = target


class LiveOscillator(Oscillator):
    """The same, as a plant that a run can be made of and whose flow can be disturbed."""

    layout = sensors.TRUCK
    description = "an oscillator"
    wind = None

    def __init__(self, config: Config) -> None:
        super().__init__(config.flow.substeps)
        self.config = config.flow
        self.seen: list[tuple[float, float | None]] = []  # Reynolds number and wind at each sample

    def sample(self) -> Sample:
        self.seen.append((self.config.reynolds, None if self.wind is None else self.wind(self.t)))
        return super().sample()

    def set_reynolds(self, reynolds: float) -> None:
        self.config = replace(self.config, reynolds=reynolds)


def swinging() -> RecordingController:
    """A controller none of whose actions comes twice."""
    steps = count()
    return RecordingController(lambda i: 0.03 * cos(next(steps)))


class Harness:
    def __init__(self, compute_ms: float, *texts: str, plan_ahead: bool = False, **ecu_settings: Any) -> None:
        ecu = EcuConfig(compute_time_ms=compute_ms, plan_ahead=plan_ahead, **ecu_settings)
        self.config = config = Config(ecu=ecu)
        self.plant, self.ecu = LiveOscillator(config), Ecu(make_bundle(), swinging(), config)
        self.captured: list[Frame] = []
        self.disturbing = Disturbing(Disturbances.parse(texts), config, NAMES, 1, {})
        in_loop = LoopEcu(ecu=self.ecu, kind="python", computed_by="a test")
        wired = wire(self.plant, NAMES, config, in_loop, self.disturbing, capture=self.captured.append)
        self.bus, self.loop = wired.bus, wired.loop

    def run(self, periods: int) -> list:
        # Raised once: a request that stands at power-on is none.
        return [self.loop.period(enable_request=self.plant.period > 0) for _ in range(periods)]

    def targets(self) -> list[float | None]:
        """What the plant was to reach at the end of each period."""
        return [action for _, substep, action in self.plant.asked if substep == self.config.flow.substeps]

    def ends(self, spec) -> list[int]:
        """When each frame of a message was through, ns."""
        return [frame.timestamp_ns for frame in self.captured if frame.frame_id == spec.frame_id]

    def taken(self, spec) -> list[int]:
        """How long each was on the bus up to its end of frame, ns."""
        frames = [replace(frame, timestamp_ns=0) for frame in self.captured if frame.frame_id == spec.frame_id]
        return [self.bus.frame_ns(frame) - INTERMISSION_NS for frame in frames]

    def starts(self) -> dict[int, int]:
        """The substep in which the ramp began, by period; 0 where it began at once."""
        late = {period: substep for period, substep, action in self.plant.asked if action is None}
        return {period: late.get(period, 0) for period in range(self.plant.period)}


class Waves(RecordingController):
    """Plans a wave as high as the limit."""

    description = "waves"

    def __init__(self) -> None:
        steps = count()
        super().__init__(lambda i: 0.075 * cos(next(steps) / 7))

    def warm_up(self, steps: int) -> None:
        """Nothing to be done."""


class Run:
    def __init__(self, *texts: str, config: Config = DEFAULT, plant: Any = None, observer: Any = None, **more: Any):
        around: dict[str, Any] = {"controller": Waves(), "disturbances": Disturbances.parse(texts), **more}
        self.plant: Any = LiveOscillator(config) if plant is None else plant
        self.frames: list[Frame] = []
        run = Simulation(make_bundle(), config, spans=SPANS, **around)
        self.log: RunLog = run.run(self.plant, capture=self.frames.append, observer=observer)
        self.acted = [one.acted for one in self.log.metadata.faults]
        self.pressures: list[Any] = [codec.parse_pressure(frame.data) for frame in self.of(PRESSURE)]
        self.commands: list[Any] = [codec.parse_jet_command(frame.data) for frame in self.of(JET_COMMAND)]
        self.statuses: list[Any] = [codec.parse_ecu_status(frame.data) for frame in self.of(ECU_STATUS)]
        speed = DBC.get_message_by_name("VehicleSpeed")  # of cantools
        self.speeds: list[Any] = [speed.decode(one.data, decode_choices=False) for one in self.of(VEHICLE_SPEED)]
        self.read = np.array([pressure.pressure_pa for pressure in self.pressures])  # (n, 4) Pa, as the vehicle sent it
        self.wall = self.log.series[WALL] * config.operating_point.dynamic_pressure  # (n, 4) Pa, as it was
        self.modes = self.log.series["mode"].astype(int)
        self.reasons = self.log.series["reason"].astype(int)

    def of(self, spec) -> list[Frame]:
        return [frame for frame in self.frames if frame.frame_id == spec.frame_id]
