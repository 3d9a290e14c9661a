"""The loop in virtual time around a plant of two numbers, over a simulated bus."""

import random
from collections.abc import Callable
from dataclasses import asdict, replace
from math import ceil, cos, isnan

import numpy as np
import pytest

from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated import SimulatedBus
from can_bridge.wire import codec
from can_bridge.wire.bit_timing import worst_case_ns
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND, PRESSURE
from can_bridge.wire.messages import Mode, Reason
from contract import sensors
from contract.config.tree import Config
from contract.config.vehicle import BusConfig, EcuConfig
from contract.errors import BusError
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import BusPorts, VirtualLoop
from firmware_sim.ecu.ecu import Ecu
from wake.truck.sample import Sample

NAMES = ("upper_39", "lower_39", "base_0", "base_9")
FRAME_NS = {
    spec.frame_id: worst_case_ns(
        Frame(frame_id=spec.frame_id, data=bytes(spec.length)), nominal_bitrate=500_000, data_bitrate=2_000_000
    )
    for spec in (PRESSURE, JET_COMMAND)
}
WARM = 6
"""Periods with a request until the window of four is full and both ends trust each other."""


class Oscillator:
    """x'' + x = a, seen as Cd, Cl and pressures; `asked` keeps every advance as (period, substep, action)."""

    def __init__(self, substeps: int) -> None:
        self.substeps, self.substep, self.period = substeps, 0, 0
        self.x, self.v, self.action = 1.0, 0.0, 0.0
        self.asked: list[tuple[int, int, float | None]] = []

    def sample(self) -> Sample:
        phase = np.linspace(0.0, 3.0, sensors.COUNT)
        return Sample(
            t=0.2 * (self.period + self.substep / self.substeps),
            Cp=self.x * np.cos(phase) + self.v * np.sin(phase),
            Cd=1.0 + self.x**2,
            Cl=self.v,
            Cd_slot_pressure=0.1 * self.x,
            Cd_slot_viscous=-0.01 * self.v,
            Cd_momentum=-(self.action**2),
            jet_power=0.0,
            Uy_probe=self.x - self.v,
            action=self.action,
        )

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


class Harness:
    """Everything around one loop."""

    def __init__(self, bundle, config: Config, controller, wrapped: dict[str, Callable[[Bus], Bus]]) -> None:
        self.config = config
        self.plant = Oscillator(config.flow.substeps)
        self.ecu = Ecu(bundle, controller, config)
        self.captured: list[Frame] = []
        bus = SimulatedBus(config.bus, self.captured.append)
        ports = BusPorts(**{name: wrap(bus.port()) for name, wrap in wrapped.items()})
        ticks = iter(range(10**6))
        self.loop = VirtualLoop(
            self.plant,
            VehicleNode(NAMES, config),
            self.ecu,
            bus,
            ports,
            config,
            clock=lambda: 0.001 * next(ticks),
        )

    def run(self, periods: int) -> list:
        # Raised once: a request that stands at power-on is none.
        return [self.loop.period(enable_request=self.plant.period > 0) for _ in range(periods)]

    def targets(self) -> list[float | None]:
        """What the plant was to reach at the end of each period."""
        return [action for _, substep, action in self.plant.asked if substep == self.config.flow.substeps]

    def starts(self) -> dict[int, int]:
        """The substep in which the ramp began, by period; 0 where it began at once."""
        late = {period: substep for period, substep, action in self.plant.asked if action is None}
        return {period: late.get(period, 0) for period in range(self.plant.period)}


@pytest.fixture
def harness(bundle_of, recording_controller):
    def make(
        compute_ms: float,
        *,
        vehicle=lambda port: port,
        ecu=lambda port: port,
        controller=None,
        bus=None,
        **ecu_settings,
    ):
        config = Config(bus=bus or BusConfig(), ecu=EcuConfig(compute_time_ms=compute_ms, **ecu_settings))
        step = iter(range(10**6))
        default = recording_controller(lambda i: 0.03 * cos(next(step)))
        return Harness(bundle_of(), config, controller or default, {"vehicle": vehicle, "ecu": ecu})

    return make


@pytest.mark.parametrize("compute_ms", [0.0, 8.0, 19.0])
def test_the_command_is_the_target_of_the_period_it_is_computed_in(harness, compute_ms):
    h = harness(compute_ms)
    rows = h.run(20)
    commands = [row.command for row in rows]
    assert h.targets()[WARM:] == commands[WARM:]
    assert len(set(commands[WARM:])) == 20 - WARM
    # Sample k shows the action commanded at k - 1: the timing convention of the recordings.
    assert [row.sample.action for row in rows[WARM + 1 :]] == commands[WARM:-1]
    assert [row.sample.t for row in rows] == pytest.approx(0.2 * np.arange(20))
    assert {row.mode for row in rows[WARM:]} == {Mode.CONTROL}


@pytest.mark.parametrize("compute_ms", [0.0, 0.5, 8.0, 19.0, 19.69])
def test_the_ramp_starts_in_the_substep_after_the_command_arrives(harness, compute_ms):
    h = harness(compute_ms)
    rows = h.run(12)
    arrival_ns = FRAME_NS[PRESSURE.frame_id] + round(compute_ms * 1e6) + FRAME_NS[JET_COMMAND.frame_id]
    assert arrival_ns < h.config.period_ns
    # Frame times count even if computing takes none; the last substep is left for the ramp.
    expected = min(ceil(arrival_ns / (h.config.period_ns / 30)), 29)
    assert expected >= 1
    assert {h.starts()[k] for k in range(WARM, 12)} == {expected}
    assert [row.age_ms for row in rows[WARM:]] == pytest.approx([arrival_ns / 1e6] * (12 - WARM))


@pytest.mark.parametrize("compute_ms", [19.8, 19.9])
def test_a_command_that_misses_its_period_acts_in_the_next(harness, compute_ms):
    """It is on the bus across the period's end, or sent after it."""
    sent_ns = FRAME_NS[PRESSURE.frame_id] + round(compute_ms * 1e6)
    assert (sent_ns < 20_000_000) == (compute_ms == 19.8)
    arrival_ns = sent_ns + FRAME_NS[JET_COMMAND.frame_id]
    assert arrival_ns > 20_000_000
    h = harness(compute_ms)
    rows = h.run(16)
    assert h.targets()[WARM + 1 :] == [row.command for row in rows[WARM:-1]]
    assert {h.starts()[k] for k in range(WARM + 1, 16)} == {1}
    # The age is that of the pressures behind the command, not of the period's own.
    assert [row.age_ms for row in rows[WARM + 1 :]] == pytest.approx([arrival_ns / 1e6] * (15 - WARM))
    assert h.ecu.status().overruns == 0
    assert h.loop.totals().lost == 0


@pytest.mark.parametrize(("compute_ms", "every"), [(20.0, 1), (20.001, 2), (25.0, 2), (41.0, 3)])
def test_an_ecu_that_is_too_slow_skips_steps_and_loses_no_frame(harness, compute_ms, every):
    h = harness(compute_ms, hold_periods=3, deadline_misses=1000)
    rows = h.run(31)
    stepped = [k for k, row in enumerate(rows) if not isnan(row.step_ms)]
    assert stepped == list(range(0, 31, every))
    skipped = [row for row in rows if isnan(row.step_ms)]
    assert all(isnan(row.command) and isnan(row.predicted_Cd) for row in skipped)
    assert h.ecu.status().overruns == (every - 1) * (len(stepped) - 1)
    assert rows[-1].mode == Mode.CONTROL
    totals = h.loop.totals()
    assert (totals.lost, totals.rejected) == (0, 0)
    for extra in range(1, every + 1):  # whatever is under way when one looks
        h.run(1)
        assert h.loop.totals().lost == 0
        assert h.loop.totals().sent > totals.sent, extra
    ages = [row.age_ms for row in rows[-8:] if not isnan(row.age_ms)]
    assert ages
    assert min(ages) > compute_ms


def test_an_ecu_that_is_always_too_slow_ends_up_off(harness):
    h = harness(25.0, hold_periods=3, deadline_misses=3)
    assert h.run(31)[-1].mode == Mode.FAULT
    assert h.ecu.status().reason is Reason.DEADLINE
    assert h.targets()[-1] == 0.0


def test_two_runs_are_equal_to_the_bit(harness):
    kept = []
    for _ in range(2):
        h = harness(8.0)
        rows = [asdict(row) for row in h.run(25)]
        kept.append((rows, h.captured, h.loop.totals()))
    # NaN is unequal to itself, its text is not.
    assert repr(kept[0]) == repr(kept[1])


def test_the_steps_time_is_the_clocks(harness):
    h = harness(8.0)
    rows = h.run(10)
    assert [row.step_ms for row in rows] == pytest.approx([1.0] * 10)  # the harness's clock: a tick a look


@pytest.mark.parametrize("compute_ms", [0.0, 8.0, 19.0, 19.9, 20.0, 25.0, 41.0])
def test_frames_are_captured_in_the_order_of_virtual_time(harness, compute_ms):
    h = harness(compute_ms)
    h.run(20)
    times = [frame.timestamp_ns for frame in h.captured]
    assert times == sorted(times)
    # Everything was captured: a pressure frame a period, a command and a status a step.
    by_id = {spec.frame_id: 0 for spec in (PRESSURE, JET_COMMAND, ECU_STATUS)}
    for frame in h.captured:
        by_id[frame.frame_id] += 1
    assert by_id[PRESSURE.frame_id] == 20
    assert by_id[JET_COMMAND.frame_id] == h.loop.totals().sent - 20
    sent_ns = [frame.timestamp_ns for frame in h.captured if frame.frame_id == JET_COMMAND.frame_id]
    assert sent_ns[0] == FRAME_NS[PRESSURE.frame_id] + round(compute_ms * 1e6)
    statuses = [frame.timestamp_ns for frame in h.captured if frame.frame_id == ECU_STATUS.frame_id]
    assert statuses[0] == sent_ns[0] + FRAME_NS[JET_COMMAND.frame_id]


class Faulty:
    """A seeded bus that drops some of the frames sent through it and flips a bit in others."""

    def __init__(self, bus: Bus, *, drop: float = 0.0, corrupt: float = 0.0, seed: int = 3) -> None:
        self._bus, self._drop, self._corrupt = bus, drop, corrupt
        self._random = random.Random(seed)
        self.dropped: list[Frame] = []
        self.corrupted: list[Frame] = []

    def send(self, frame: Frame) -> None:
        draw = self._random.random()
        if draw < self._drop:
            self.dropped.append(frame)
            return
        if draw < self._drop + self._corrupt:
            self.corrupted.append(frame)
            data = bytearray(frame.data)
            data[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
            frame = replace(frame, data=bytes(data))
        self._bus.send(frame)

    def receive_all(self) -> list[Frame]:
        return self._bus.receive_all()


@pytest.fixture
def faults() -> list[Faulty]:
    return []


def only(frames: list[Frame], spec) -> int:
    return sum(frame.frame_id == spec.frame_id for frame in frames)


def test_on_a_sound_bus_nothing_is_lost_or_rejected(harness):
    h = harness(8.0)
    h.run(30)
    assert asdict(h.loop.totals()) == {"sent": 60, "lost": 0, "rejected": 0}


def test_frames_dropped_on_either_side_are_lost(harness, faults):
    def dropping(bus: Bus) -> Faulty:
        faults.append(Faulty(bus, drop=0.15, seed=len(faults)))
        return faults[-1]

    h = harness(8.0, vehicle=dropping, ecu=dropping)
    rows = h.run(60)
    vehicle, ecu = faults
    lost = only(vehicle.dropped, PRESSURE) + only(ecu.dropped, JET_COMMAND)
    assert only(vehicle.dropped, PRESSURE) > 3
    assert only(ecu.dropped, JET_COMMAND) > 3
    assert asdict(h.loop.totals()) == {"sent": 120, "lost": lost, "rejected": 0}
    # A period whose command was dropped has no age, and the jets hold.
    assert sum(isnan(row.age_ms) for row in rows) >= only(ecu.dropped, JET_COMMAND)


def test_corrupted_frames_are_rejected_on_the_side_that_receives_them(harness, faults):
    def corrupting(bus: Bus) -> Faulty:
        faults.append(Faulty(bus, corrupt=0.15, seed=len(faults)))
        return faults[-1]

    h = harness(8.0, vehicle=corrupting, ecu=corrupting)
    h.run(60)
    vehicle, ecu = faults
    pressures, commands = only(vehicle.corrupted, PRESSURE), only(ecu.corrupted, JET_COMMAND)
    assert min(pressures, commands) > 3
    totals = h.loop.totals()
    assert (totals.sent, totals.lost, totals.rejected) == (120, 0, pressures + commands)
    assert h.ecu.status().crc_errors == pressures


def test_frames_that_come_while_the_ecu_is_busy_are_checked_too(harness, faults):
    def corrupting(bus: Bus) -> Faulty:
        faults.append(Faulty(bus, corrupt=0.2))
        return faults[-1]

    h = harness(25.0, vehicle=corrupting)
    h.run(61)  # it steps in every other period, the last included
    assert h.ecu.status().crc_errors == len(faults[0].corrupted) > 8


def test_a_lost_command_leaves_the_jets_where_they_are_for_a_period(harness, faults):
    class DropOne(Faulty):
        def send(self, frame: Frame) -> None:
            command = codec.parse_jet_command(frame.data) if frame.frame_id == JET_COMMAND.frame_id else None
            if command is not None and command.pressure_counter == 10:
                return
            super().send(frame)

    h = harness(8.0, ecu=DropOne)
    rows = h.run(14)
    targets = h.targets()
    assert targets[10] == targets[9] != rows[10].command
    assert targets[11] == rows[11].command
    assert h.starts()[10] == 0
    assert h.loop.totals().lost == 1


def test_the_forecast_is_kept_for_periods_with_a_plan_only(harness):
    h = harness(8.0)
    rows = h.run(10)
    for row in rows:
        assert isnan(row.predicted_Cd) == (row.mode != Mode.CONTROL)


def test_a_row_is_the_plants_sample_at_the_periods_start(harness):
    h = harness(8.0)
    h.run(WARM)
    sample = h.plant.sample()
    row = h.run(1)[0]
    assert row.columns()["base_Cp"] == sample.Cp[sensors.TRUCK.indices([f"base_{i}" for i in range(10)])].mean()
    slot = ("Cd_slot_pressure", "Cd_slot_viscous")
    for name in ("t", "Cd", "Cl", *slot, "Cd_momentum", "jet_power", "Uy_probe", "action"):
        assert row.columns()[name] == getattr(sample, name), name


def test_bit_rates_that_cannot_carry_the_pressures_are_refused(harness):
    h = harness(8.0, bus=BusConfig(nominal_bitrate=1000))
    with pytest.raises(BusError, match=r"takes 34\.0965 ms, the control period is 20 ms: raise bus\.nominal_bitrate"):
        h.run(1)
