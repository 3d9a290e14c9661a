"""The loop in virtual time around a plant of two numbers, over a simulated bus."""

import random
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from math import ceil, cos, isnan

import numpy as np
import pytest

from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated.background_node import BackgroundNode
from can_bridge.bus.simulated.medium import Corrupts, SimulatedBus
from can_bridge.timing.traffic import background
from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND, PRESSURE
from can_bridge.wire.messages import Mode, Reason
from contract import sensors
from contract.config.tree import Config
from contract.config.vehicle import BackgroundConfig, BusConfig, EcuConfig
from contract.errors import BusError
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import BusPorts, VirtualLoop
from firmware_sim.ecu.ecu import Ecu
from wake.truck.sample import Sample

NAMES = ("upper_39", "lower_39", "base_0", "base_9")
BIT_NS = 2000
"""At 500 kbit/s."""
INTERMISSION_NS = 3 * BIT_NS
FRAME_IDS = (PRESSURE.frame_id, JET_COMMAND.frame_id, ECU_STATUS.frame_id)
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

    def __init__(
        self, bundle, config: Config, controller, wrapped: dict[str, Callable[[Bus], Bus]], corrupts: Corrupts | None
    ) -> None:
        self.config = config
        self.plant = Oscillator(config.flow.substeps)
        self.ecu = Ecu(bundle, controller, config)
        self.captured: list[Frame] = []
        self.bus = bus = SimulatedBus(config.bus, self.captured.append, corrupts=corrupts)
        self.ports = {name: bus.port(name) for name in wrapped}
        ports = BusPorts(
            **{name: wrap(self.ports[name]) for name, wrap in wrapped.items()}, ecu_health=self.ports["ecu"].health
        )
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


@pytest.fixture
def harness(bundle_of, recording_controller):
    def make(
        compute_ms: float,
        *,
        vehicle=lambda port: port,
        ecu=lambda port: port,
        controller=None,
        bus=None,
        corrupts=None,
        **ecu_settings,
    ):
        config = Config(bus=bus or BusConfig(), ecu=EcuConfig(compute_time_ms=compute_ms, **ecu_settings))
        step = iter(range(10**6))
        default = recording_controller(lambda i: 0.03 * cos(next(step)))
        return Harness(bundle_of(), config, controller or default, {"vehicle": vehicle, "ecu": ecu}, corrupts)

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


@pytest.mark.parametrize("compute_ms", [0.0, 0.5, 8.0, 19.0, 19.5])
def test_the_ramp_starts_in_the_substep_after_the_command_arrives(harness, compute_ms):
    h = harness(compute_ms)
    rows = h.run(12)
    period_ns, compute_ns = h.config.period_ns, round(compute_ms * 1e6)
    # The intermission behind the pressures is over before the command is ready, unless it takes no time.
    gap_ns = INTERMISSION_NS if compute_ns == 0 else compute_ns
    arrivals = [one + gap_ns + two for one, two in zip(h.taken(PRESSURE), h.taken(JET_COMMAND), strict=True)]
    assert max(arrivals) < period_ns
    assert h.ends(JET_COMMAND) == [k * period_ns + after for k, after in enumerate(arrivals)]
    # Frame times count even if computing takes none; the last substep is left for the ramp.
    expected = [min(ceil(after / (period_ns / 30)), 29) for after in arrivals]
    assert min(expected) >= 1
    assert [h.starts()[k] for k in range(WARM, 12)] == expected[WARM:]
    assert [row.age_ms for row in rows[WARM:]] == pytest.approx([after / 1e6 for after in arrivals[WARM:]])


@pytest.mark.parametrize("compute_ms", [19.83, 19.9])
def test_a_command_that_misses_its_period_acts_in_the_next(harness, compute_ms):
    """It is on the bus across the period's end, or sent after it."""
    h = harness(compute_ms)
    rows = h.run(16)
    compute_ns, period_ns = round(compute_ms * 1e6), h.config.period_ns
    handed_over = [k * period_ns + taken + compute_ns for k, taken in enumerate(h.taken(PRESSURE))]
    # It waits for the pressures of the next period when it is handed over in the same instant or later.
    assert {at % period_ns > period_ns // 2 for at in handed_over} == {compute_ms == 19.83}
    assert h.targets()[WARM + 1 :] == [row.command for row in rows[WARM:-1]]
    arrivals = [end - (k + 1) * period_ns for k, end in enumerate(h.ends(JET_COMMAND))]
    assert min(arrivals) > 0
    assert [h.starts()[k] for k in range(WARM + 1, 16)] == [ceil(a * 30 / period_ns) for a in arrivals[WARM:15]]
    # The age is that of the pressures behind the command, not of the period's own.
    expected = [(period_ns + after) / 1e6 for after in arrivals[WARM:15]]
    assert [row.age_ms for row in rows[WARM + 1 :]] == pytest.approx(expected)
    assert h.ecu.status().overruns == 0
    assert h.loop.totals().lost == 0


@pytest.mark.parametrize(("compute_ms", "every"), [(19.95, 1), (20.05, 2), (25.0, 2), (41.0, 3)])
def test_an_ecu_that_is_too_slow_skips_steps_and_loses_no_frame(harness, compute_ms, every):
    # Frames differ by some 10 us in stuff bits, so that an ECU that takes 20 ms does and does not keep up.
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
    compute_ns = max(round(compute_ms * 1e6), INTERMISSION_NS)
    first = h.taken(PRESSURE)[0] + compute_ns + h.taken(JET_COMMAND)[0]
    if compute_ms < 19.5:
        assert h.ends(JET_COMMAND)[0] == first
        assert h.ends(ECU_STATUS)[0] == first + INTERMISSION_NS + h.taken(ECU_STATUS)[0]


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


def test_another_nodes_29_bit_identifier_of_the_same_number_is_not_ours(harness):
    """It neither makes the ECU step nor counts as a frame that arrived."""

    def dropping(bus: Bus) -> Faulty:
        return Faulty(bus, drop=0.15)

    h, plain = (harness(8.0, vehicle=dropping, ecu=dropping) for _ in range(2))
    other = h.bus.port("other")

    def send_and_go_on() -> None:
        for spec in (PRESSURE, JET_COMMAND):
            other.send(Frame(frame_id=spec.frame_id, data=bytes(8), is_fd=False, is_extended=True))
        h.bus.call_at(h.bus.now_ns + 3_000_000, send_and_go_on)

    send_and_go_on()
    rows = [[row.mode for row in item.run(60)] for item in (h, plain)]
    assert rows[0] == rows[1]
    assert h.loop.totals() == plain.loop.totals()
    assert h.loop.totals().lost > 6


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
    with pytest.raises(BusError, match=r"takes 34\.0965 ms, the control period is 20 ms: raise bus\.nominal_bitrate"):
        harness(8.0, bus=BusConfig(nominal_bitrate=1000))


def disturbed(harness, until_ns: int, frame_id: int = 0x001, period_ns: int = 100_000, **settings):
    """A loop whose bus another node keeps busy with frames of 64 bytes from 200 ms on."""
    h = harness(8.0, **settings)
    port = h.bus.port("other", transmit_capacity=1000)

    def send() -> None:
        with suppress(BusError):  # the queue is full
            port.send(Frame(frame_id=frame_id, data=bytes(64)))

    for at_ns in range(200_000_000, until_ns, period_ns):
        h.bus.call_at(at_ns, send)
    return h


def test_pressures_that_wait_for_the_bus_make_the_step_late_and_no_miss(harness):
    """Frames of higher priority, twelve of 390 us, handed over at once when the period begins."""
    h = harness(8.0)
    port = h.bus.port("other")
    data = b"\x55" * 64

    def crowd() -> None:
        for _ in range(12):
            port.send(Frame(frame_id=0x001, data=data))

    h.bus.call_at(10 * h.config.period_ns, crowd)
    rows = h.run(13)
    wait_ns = 12 * h.bus.frame_ns(Frame(frame_id=0x001, data=data))
    assert wait_ns < h.config.period_ns // 2
    assert h.ends(PRESSURE)[10] == 10 * h.config.period_ns + wait_ns + h.taken(PRESSURE)[10]
    assert h.ecu.status().missed == 1  # the first frame
    assert {row.mode for row in rows[WARM:]} == {Mode.CONTROL}
    assert rows[10].age_ms - rows[9].age_ms == pytest.approx(wait_ns / 1e6, abs=0.03)  # contents differ in stuff bits
    assert h.starts()[10] > h.starts()[9]
    assert h.loop.totals().lost == 0


def test_pressures_that_come_after_half_a_period_are_a_miss(harness):
    h = disturbed(harness, until_ns=219_000_000, period_ns=300_000)
    rows = h.run(14)
    assert 210_000_000 < h.ends(PRESSURE)[10] < 220_000_000 + 8_000_000
    assert [row.mode for row in rows[9:13]] == [Mode.CONTROL, Mode.HOLD, Mode.CONTROL, Mode.CONTROL]
    assert h.ecu.status().missed == 2
    assert not any(isnan(row.step_ms) for row in rows)
    assert h.loop.totals().lost == 0


def test_a_bus_that_others_keep_to_themselves_shuts_the_jets(harness):
    h = disturbed(harness, until_ns=400_000_000)
    rows = h.run(20)
    assert rows[-1].mode == Mode.FAULT
    assert h.ecu.status().reason is Reason.STREAM_LOST
    assert h.targets()[-1] == 0.0
    assert h.loop.totals().lost == 0  # all still wait


def test_frames_of_lower_priority_delay_by_one_of_them_at_most(harness):
    h = disturbed(harness, until_ns=400_000_000, frame_id=0x7FF)
    rows = h.run(20)
    longest = h.bus.frame_ns(Frame(frame_id=0x7FF, data=bytes(64)))
    assert {row.mode for row in rows[WARM:]} == {Mode.CONTROL}
    for k in range(10, 20):
        assert h.ends(PRESSURE)[k] <= k * h.config.period_ns + longest + h.taken(PRESSURE)[k]
    assert max(h.ends(PRESSURE)[k] - k * h.config.period_ns - h.taken(PRESSURE)[k] for k in range(11, 20)) > 0


def test_an_ecu_that_is_bus_off_is_missed_by_the_vehicle_and_comes_back(harness):
    positions = iter([20] * 32)

    def corrupts(frame: Frame, name: str, begin_ns: int) -> int | None:
        """32 errors in a row on its command of one period, all within that period."""
        return next(positions, None) if name == "ecu" and begin_ns > 200_000_000 else None

    h = harness(8.0, corrupts=corrupts)
    rows = h.run(24)
    health = h.ports["ecu"].health()
    assert health.bus_off == 1
    assert h.ecu.status().bus_off == 1
    # The command of period 10 and its status went with the queue; the next ones come.
    assert h.loop.totals().lost == 1
    assert h.targets()[10] == h.targets()[9]
    assert rows[-1].age_ms < 10.0


def test_the_ecu_reports_what_its_can_controller_counts(harness):
    positions = iter([30] * 5)
    h = harness(8.0, corrupts=lambda frame, name, begin_ns: next(positions, None))
    h.run(1)
    # Five times one on the pressures, less one for what came through.
    assert h.ports["ecu"].health().rx_errors == 4
    assert h.ecu.status().rx_errors == 4
    assert h.bus.activity().error_frames == 5


def test_two_runs_with_background_are_equal_to_the_bit(harness):
    bus = BusConfig(background=BackgroundConfig(load=0.5, seed=3))
    kept = []
    for seed in (3, 3, 4):
        h = harness(8.0, bus=bus)
        others = background(bus.background, bus, FRAME_IDS)
        BackgroundNode(h.bus, h.bus.port("background"), others, seed)
        rows = [asdict(row) for row in h.run(20)]
        kept.append(repr((rows, h.captured, h.loop.totals())))
        assert 0.3 < h.bus.activity().load < 0.55
        assert {row["mode"] for row in rows[WARM:]} == {Mode.CONTROL}
    assert kept[0] == kept[1] != kept[2]
