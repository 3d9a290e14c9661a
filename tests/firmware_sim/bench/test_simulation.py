"""Each disturbance does what it says, where and when it says so, as seen on the bus and at the plant."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND, PRESSURE
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode, Pressure, Reason
from contract.config.tree import Config
from contract.errors import ConfigError
from firmware_sim.bench.disturbances import GLOBAL_DEVIATION, Disturbances
from firmware_sim.bench.simulation import Simulation, simulate
from firmware_sim.bench.spans import Spans
from firmware_sim.runs.run_log import WALL, RunLog
from tests.firmware_sim.bench.harness import NAMES, LiveOscillator, Oscillator
from tests.firmware_sim.bench.test_invariants import Waves
from tests.firmware_sim.conftest import make_bundle

CONFIG = Config()
PASCAL = CONFIG.operating_point.dynamic_pressure
SPANS = Spans(lead_in=2.0, controlled=10.0, settle=0.0, averages=False)
"""10 periods and 50 of 20 ms; control from 0.2 s on, with a window of four periods."""
STEP_PA = 0.05
"""Half a step of the wire."""


class Run:
    """One run, and what was seen of it."""

    def __init__(self, *texts: str, seed: int = 0, config: Config = CONFIG, plant: Any = None) -> None:
        self.plant = LiveOscillator(config) if plant is None else plant
        self.frames: list[Frame] = []
        self.log: RunLog = Simulation(
            make_bundle(),
            config,
            spans=SPANS,
            controller=Waves(),
            disturbances=Disturbances.parse(texts),
            seed=seed,
        ).run(self.plant, capture=self.frames.append)
        self.acted = [one.acted for one in self.log.metadata.faults]

    def read(self) -> np.ndarray:
        """(n, 4) Pa, as the vehicle sent them."""
        return np.array([pressure.pressure_pa for pressure in self.pressures()])

    def pressures(self) -> list[Pressure]:
        return [self._said(frame, PRESSURE) for frame in self.of(PRESSURE)]

    def wall(self) -> np.ndarray:
        """(n, 4) Pa, as they were."""
        return self.log.series[WALL] * PASCAL

    def commands(self) -> list[JetCommand]:
        return [self._said(frame, JET_COMMAND) for frame in self.of(JET_COMMAND)]

    def statuses(self) -> list[EcuStatus]:
        return [self._said(frame, ECU_STATUS) for frame in self.of(ECU_STATUS)]

    def of(self, spec) -> list[Frame]:
        return [frame for frame in self.frames if frame.frame_id == spec.frame_id]

    def modes(self) -> np.ndarray:
        return self.log.series["mode"].astype(int)

    @staticmethod
    def _said(frame: Frame, spec) -> Any:
        parse = {
            PRESSURE: codec.parse_pressure,
            JET_COMMAND: codec.parse_jet_command,
            ECU_STATUS: codec.parse_ecu_status,
        }
        return parse[spec](frame.data)


def same(one: RunLog, other: RunLog) -> bool:
    return all(
        np.array_equal(values, other.series[name], equal_nan=True)
        for name, values in one.series.items()
        if name != "step_ms"
    )


@pytest.fixture(scope="module")
def calm() -> Run:
    return Run()


def test_an_undisturbed_run_reads_what_the_walls_have(calm):
    assert calm.acted == []
    assert np.abs(calm.read() - calm.wall()).max() <= STEP_PA + 1e-9
    assert set(calm.modes()[-45:]) == {Mode.CONTROL}


def test_the_seed_decides_and_nothing_else():
    texts = ("noise:level=0.5", "ecu:drop:probability=0.1", "wire_errors:bit_error_rate=0.0005")
    first, again, other = Run(*texts, seed=3), Run(*texts, seed=3), Run(*texts, seed=4)
    assert first.frames == again.frames
    assert same(first.log, again.log)
    assert first.acted == again.acted
    assert first.frames != other.frames


# Transducers.


def test_noise_has_its_level_on_every_sensor():
    found = Run("noise:level=0.5")
    change = (found.read() - found.wall()) / PASCAL
    # 60 draws: the deviation of a standard deviation is 9 %.
    assert change.std(axis=0) == pytest.approx([0.5 * GLOBAL_DEVIATION] * 4, rel=0.3)
    assert found.acted == [60]


def test_a_bias_is_in_global_deviations_and_in_its_span():
    found = Run(f"bias:sensor={NAMES[1]},level=-2@0.4..0.8")
    change = found.read() - found.wall()
    expected = np.zeros((60, 4))
    expected[20:40, 1] = -2 * GLOBAL_DEVIATION * PASCAL
    np.testing.assert_allclose(change, expected, atol=STEP_PA + 1e-9)
    assert found.acted == [20]


def test_a_drift_grows_from_its_beginning():
    found = Run(f"drift:sensor={NAMES[0]},level=1,over_s=0.2@0.4..")
    change = (found.read() - found.wall())[:, 0]
    expected = np.clip((np.arange(60) - 20) / 10, 0, 1) * GLOBAL_DEVIATION * PASCAL
    np.testing.assert_allclose(change, expected, atol=STEP_PA + 1e-9)


def test_a_stuck_sensor_keeps_its_first_reading_and_a_dead_one_reads_nothing():
    found = Run(f"stuck:sensor={NAMES[0]}@0.4..", f"dead:sensor={NAMES[3]}@0.6..")
    read, wall = found.read(), found.wall()
    assert np.ptp(read[20:, 0]) == 0.0
    assert read[20, 0] == pytest.approx(wall[20, 0], abs=STEP_PA)
    assert not read[30:, 3].any()
    np.testing.assert_allclose(read[:30, 1:], wall[:30, 1:], atol=STEP_PA + 1e-9)


def test_swapped_sensors_and_steps():
    found = Run(f"swap:sensors={NAMES[0]}+{NAMES[3]}")
    np.testing.assert_allclose(found.read(), found.wall()[:, [3, 1, 2, 0]], atol=STEP_PA + 1e-9)
    read = Run("quantise:step=50").read()
    np.testing.assert_allclose(read / 50, np.rint(read / 50), atol=1e-9)


# Vehicle.


def test_a_faster_vehicle_reads_higher_pressures_and_its_jets_do_less():
    found = Run("operating_point:speed=30,density=1.1")
    dynamic = 0.5 * 1.1 * 30.0**2
    np.testing.assert_allclose(found.read(), found.log.series[WALL] * dynamic, atol=STEP_PA + 1e-9)
    flows = np.array([command.flow_m2_per_s for command in found.commands()])
    # Planned one period ahead: reached at the end of the next period, which is the sample after that.
    np.testing.assert_allclose(found.log.series["action"][2:], flows[:-2] / (30.0 * 2.5), atol=1e-12)
    assert np.abs(flows).max() > 4.0


def test_saturated_jets_reach_their_share_of_the_limit(calm):
    found = Run("action_limit=0.4@0.6..")
    action = np.abs(found.log.series["action"])
    assert action[32:].max() == pytest.approx(0.4 * 0.075)
    assert action[:30].max() > 0.06
    assert np.abs(calm.log.series["action"][32:]).max() > 0.06
    # The ECU goes on to ask for more.
    assert max(abs(command.flow_m2_per_s) for command in found.commands()[32:]) > 4.0


def test_a_request_taken_back_shuts_the_jets_and_comes_back():
    found = Run("no_request@0.6..0.7")
    asked = [pressure.enable_request for pressure in found.pressures()]
    assert asked == [False] * 10 + [True] * 20 + [False] * 5 + [True] * 25
    assert set(found.modes()[30:35]) == {Mode.OFF}
    assert not found.log.series["action"][31:36].any()
    assert found.modes()[-1] == Mode.CONTROL
    assert found.acted == [5]


# ECU.


def test_a_reset_ecu_is_silent_while_it_boots_starts_anew_and_waits_for_an_edge():
    found = Run("reset:boot_s=0.1@0.505")
    times = np.array([frame.timestamp_ns / 1e9 for frame in found.of(JET_COMMAND)])
    gap = times[np.argmax(np.diff(times)) : np.argmax(np.diff(times)) + 2]
    # The step of 0.50 s is lost, for it was still computing. Up at 0.605 s it has missed that period's pressures, waits
    # for half a period and steps without.
    assert gap == pytest.approx([0.488, 0.618], abs=0.001)
    counters = [frame.data[2] for frame in found.of(JET_COMMAND)]
    assert counters == [*range(25), *range(30)]
    assert set(found.modes()[30:]) == {Mode.OFF}
    assert not found.log.series["action"][-20:].any()
    assert found.acted == [1]
    again = Run("reset:boot_s=0.1@0.505", "no_request@0.8..0.84")
    assert again.modes()[-1] == Mode.CONTROL


def test_a_clock_that_is_set_back_latches_and_a_little_drift_does_nothing(calm):
    back = Run("clock:offset_s=-0.05@0.6..")
    assert back.statuses()[30].reason is Reason.CLOCK
    assert set(back.modes()[30:]) == {Mode.FAULT}
    drifting = Run("clock:ppm=200")
    assert [frame.data for frame in drifting.of(JET_COMMAND)] == [frame.data for frame in calm.of(JET_COMMAND)]
    assert drifting.acted == [60]


# Wire.


def test_errors_in_what_the_ecu_sends_take_it_off_the_bus_until_it_recovers():
    found = Run("wire_errors:bit_error_rate=1,node=ecu@0.6..0.61", "no_request@0.8..0.84")
    latched = [status for status in found.statuses() if status.reason is Reason.BUS_OFF]
    assert latched
    assert latched[0].bus_off == 1
    # ISO 11898-1: 8 for each error of a sender, bus-off from 256 on.
    assert found.acted[0] == 32
    assert found.log.traffic.nodes["ECU"].bus_off == 1
    assert found.modes()[-1] == Mode.CONTROL


def test_what_one_receiver_hears_wrong_is_sent_again():
    """Its error flag destroys the frame for all."""
    found = Run("wire_errors:bit_error_rate=0.001,node=ecu,at=receive")
    assert found.acted[0] == found.log.traffic.error_frames > 0
    assert found.log.traffic.nodes["ECU"].rx_errors + found.log.traffic.nodes["vehicle"].tx_errors > 0
    assert len(found.of(PRESSURE)) == 60


# Flow.


def test_the_flow_changes_in_its_span_and_is_given_back():
    plant = LiveOscillator(CONFIG)
    found = Run("reynolds=700@0.4..0.6", "gust:amplitude=0.1,period=1@0.2..0.45", plant=plant)
    reynolds, wind = (np.array(values, dtype=float) for values in zip(*plant.seen, strict=True))
    assert list(reynolds[:60]) == [500.0] * 20 + [700.0] * 10 + [500.0] * 30
    # A period of 1 t_c is 0.1 s: two whole ones from 0.2 s on.
    t = 0.2 * np.arange(60)
    expected = np.where((t >= 2.0) & (t <= 4.0), 0.1 * np.sin(2 * np.pi * (t - 2.0)), 0.0)
    np.testing.assert_allclose(wind[:60], expected, atol=1e-12)
    assert found.acted == [10, 12 + 1]
    assert (plant.config.reynolds, plant.wind) == (500.0, None)


def test_another_plant_cannot_be_disturbed():
    class Bare(Oscillator):
        layout, description, t = LiveOscillator.layout, "bare", 0.0

    with pytest.raises(ConfigError, match="the flow of this plant cannot be disturbed"):
        Run("reynolds=700", plant=Bare(CONFIG.flow.substeps))
    assert Run("noise:level=0.1", plant=Bare(CONFIG.flow.substeps)).acted == [60]


def test_a_plant_is_given_back_after_an_error_too():
    class Breaks(LiveOscillator):
        def advance_to(self, substep, action=None):
            if self.period == 5:
                raise ArithmeticError
            super().advance_to(substep, action)

    plant = Breaks(CONFIG)
    with pytest.raises(ArithmeticError):
        Run("reynolds=700", "gust:amplitude=0.1,period=1", plant=plant)
    assert (plant.config.reynolds, plant.wind) == (500.0, None)


@pytest.mark.slow  # the real wake
def test_a_run_goes_on_from_a_saved_state_to_the_bit(shared_wake):
    """A campaign starts many runs from one phase."""
    from wake.truck.state import developed_state

    shared_wake.reset(developed_state())
    shared_wake.advance(0.0)
    saved = replace(shared_wake.state(), substep=0)
    spans = Spans(lead_in=0.2, controlled=0.6, settle=0.0, averages=False)
    runs = []
    for texts in ((), ("gust:amplitude=0.1,period=5", "reynolds=700"), ()):
        shared_wake.reset(saved)
        runs.append(
            simulate(
                make_bundle(),
                CONFIG,
                spans=spans,
                wake=shared_wake,
                controller=Waves(),
                disturbances=Disturbances.parse(texts),
            )
        )
    assert same(runs[0], runs[2])
    assert not same(runs[0], runs[1])
