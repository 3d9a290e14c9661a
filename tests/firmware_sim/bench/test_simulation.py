"""Whole runs: each disturbance acts where and when its text names, as seen on the bus and at the plant."""

from math import inf, nan
from typing import Any

import numpy as np
import pytest

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError, PlantError, StillwakeError
from firmware_sim.bench.disturbances import parse_disturbance
from firmware_sim.bench.disturbing import LOOK_NS, NodeFaults
from firmware_sim.bench.sensor_faults import GLOBAL_DEVIATION
from firmware_sim.bench.simulation import Spans
from tests.firmware_sim.bench.harness import NAMES, LiveOscillator, Oscillator, Run

CONFIG = Config()
PASCAL = CONFIG.operating_point.dynamic_pressure
UNIT = GLOBAL_DEVIATION * PASCAL
STEP_PA = 0.05
"""Half a step of the wire."""


@pytest.fixture(scope="module")
def calm() -> Run:
    return Run()


def test_each_fault_of_a_sensor_changes_its_readings_in_its_span_and_no_others(calm):
    k = np.arange(60)
    after = k >= 20  # 0.4 s
    cases = {
        (): lambda wall: wall,
        (f"bias:sensor={NAMES[1]},level=-2@0.4..0.8",): lambda wall: (
            wall + np.outer(after & (k < 40), [0, -2 * UNIT, 0, 0])
        ),
        (f"drift:sensor={NAMES[0]},level=1,over_s=0.2@0.4..",): lambda wall: (
            wall + np.outer(np.clip((k - 20) / 10, 0, 1), [UNIT, 0, 0, 0])
        ),
        (f"stuck:sensor={NAMES[0]}@0.4..", f"dead:sensor={NAMES[3]}@0.6.."): lambda wall: np.column_stack(
            [np.where(after, wall[20, 0], wall[:, 0]), wall[:, 1:3], np.where(k >= 30, 0.0, wall[:, 3])]
        ),
        (f"swap:sensors={NAMES[0]}+{NAMES[3]}",): lambda wall: wall[:, [3, 1, 2, 0]],
        ("quantise:step=50",): lambda wall: 50.0 * np.rint(wall / 50.0),
        # A faster vehicle reads higher pressures.
        ("operating_point:speed=30,density=1.1",): lambda wall: wall / PASCAL * (0.5 * 1.1 * 30.0**2),
    }
    for texts, expected in cases.items():
        run = Run(*texts) if texts else calm
        np.testing.assert_allclose(run.read, expected(run.wall), atol=STEP_PA + 1e-9, err_msg=str(texts))
    run = Run("noise:level=0.5")
    # 60 draws: the deviation of a standard deviation is 9 %.
    assert (run.read - run.wall).std(axis=0) == pytest.approx([0.5 * UNIT] * 4, rel=0.3)
    assert (run.acted, Run(f"bias:sensor={NAMES[1]},level=-2@0.4..0.8").acted) == ([60], [20])


def test_the_jets_of_a_faster_vehicle_do_less_and_saturated_ones_reach_their_share(calm):
    faster = Run("operating_point:speed=30,density=1.1")
    flows = np.array([command.flow_m2_per_s for command in faster.commands])
    # Planned one period ahead: reached at the end of the next period, which is the sample after that.
    np.testing.assert_allclose(faster.log.series["action"][2:], flows[:-2] / (30.0 * 2.5), atol=1e-12)
    assert np.abs(flows).max() > 4.0
    saturated = Run("action_limit=0.4@0.6..")
    action = np.abs(saturated.log.series["action"])
    assert action[32:].max() == pytest.approx(0.4 * 0.075)
    assert min(action[:30].max(), np.abs(calm.log.series["action"][32:]).max()) > 0.06
    stuck = np.abs(Run("stuck_jets=0.4@0.6..").log.series["action"] - 0.4 * 0.075)
    assert stuck[32:].max() < 1e-12 < stuck[:30].max()
    # The ECU goes on to ask for more.
    assert max(abs(command.flow_m2_per_s) for command in saturated.commands[32:]) > 4.0


def test_a_request_taken_back_shuts_the_jets_and_comes_back():
    run = Run("no_request@0.6..0.7")
    assert [one.enable_request for one in run.pressures] == [False] * 10 + [True] * 20 + [False] * 5 + [True] * 25
    assert set(run.modes[30:35]) == {Mode.OFF}
    assert not run.log.series["action"][31:36].any()
    assert run.modes[-1] == Mode.CONTROL
    assert run.acted == [5]


def test_a_reset_ecu_is_silent_while_it_boots_starts_again_and_waits_for_an_edge():
    run = Run("reset:boot_s=0.1@0.505")
    times = np.array([frame.timestamp_ns / 1e9 for frame in run.of(JET_COMMAND)])
    gap = times[np.argmax(np.diff(times)) : np.argmax(np.diff(times)) + 2]
    # The step of 0.50 s is lost, for it was still computing. Up at 0.605 s it has missed that period's pressures, waits
    # for half a period and steps without.
    assert gap == pytest.approx([0.488, 0.618], abs=0.001)
    assert [frame.data[2] for frame in run.of(JET_COMMAND)] == [*range(25), *range(30)]
    assert set(run.modes[30:]) == {Mode.OFF}
    assert not run.log.series["action"][-20:].any()
    assert run.acted == [1]
    assert Run("reset:boot_s=0.1@0.505", "no_request@0.8..0.84").modes[-1] == Mode.CONTROL


def test_a_clock_that_is_set_back_latches_and_a_little_drift_does_nothing(calm):
    back = Run("clock:offset_s=-0.05@0.6..")
    assert back.reasons[30] == Reason.CLOCK
    assert set(back.modes[30:]) == {Mode.FAULT}
    drifting = Run("clock:ppm=200")
    assert [frame.data for frame in drifting.of(JET_COMMAND)] == [frame.data for frame in calm.of(JET_COMMAND)]
    assert drifting.acted == [120]  # pressures and speeds


def test_errors_in_what_the_ecu_sends_take_it_off_the_bus_until_it_recovers():
    run = Run("wire_errors:bit_error_rate=1,node=ecu@0.6..0.61", "no_request@0.8..0.84")
    latched = [status for status in run.statuses if status.reason is Reason.BUS_OFF]
    assert latched[0].bus_off == run.log.traffic.nodes["ECU"].bus_off == 1
    # ISO 11898-1: 8 for each error of a sender, bus-off from 256 on.
    assert run.acted[0] == 32
    assert run.modes[-1] == Mode.CONTROL
    # What one receiver hears wrong, its error flag destroys for all, and it is sent again.
    run = Run("wire_errors:bit_error_rate=0.001,node=ecu,at=receive")
    assert run.acted[0] == run.log.traffic.error_frames > 0
    assert len(run.of(PRESSURE)) == 60


def test_pressures_that_a_port_loses_are_missing_in_their_periods():
    for fault in ("drop:probability=1", "disconnect"):
        run = Run(f"vehicle:{fault}@0.59..0.65")
        assert run.modes[29:33].tolist() == [Mode.CONTROL, Mode.HOLD, Mode.DECAY, Mode.DECAY], fault
        assert set(run.reasons[30:33]) == {Reason.STREAM_LOST}, fault
        assert set(run.modes[40:]) == {Mode.CONTROL}, fault


def test_a_delay_that_looks_like_fresh_frames_shows_in_the_echo_and_one_that_does_not_latches():
    """A gateway's delay is the first, and a queue's can be the second."""
    for restamp in ("true", "false"):
        run = Run(f"ecu:delay:delay_s=0.04,restamp={restamp}@0.595..")
        assert run.modes[30:32].tolist() == [Mode.HOLD, Mode.DECAY]  # nothing comes
        if restamp == "true":
            assert set(run.modes[32:]) == {Mode.CONTROL}
            assert np.diff(run.log.series["age_ms"][[28, -1]]) == pytest.approx(40.0, abs=1.1)
        else:
            assert set(run.modes[33:]) == {Mode.FAULT}
            assert run.reasons[-1] == Reason.STALE
            assert not run.log.series["action"][36:].any()


def test_port_faults_act_between_the_calls_of_their_node():
    bus = SimulatedBus(BusConfig())
    vehicle, ecu = bus.port("vehicle"), bus.port("ecu")
    delay: list[Any] = [parse_disturbance("ecu:delay:delay_s=0.002")]
    port = NodeFaults(delay, bus, 0, {}).around("ecu", ecu)
    vehicle.send(Frame(frame_id=1, data=b"", is_fd=True))
    # On a bus that is quiet no other event would let the loop look: within one look of the 2 ms.
    assert bus.advance_until(10_000_000, lambda: bool(port.receive_all()))
    assert 2_000_000 < bus.now_ns <= 2_000_000 + 200_000 + LOOK_NS
    bus = SimulatedBus(BusConfig())
    vehicle, ecu = bus.port("vehicle"), bus.port("ecu")
    babble: list[Any] = [parse_disturbance("vehicle:babble@0..0.1")]
    port = NodeFaults(babble, bus, 0, {}).around("vehicle", vehicle)
    bus.advance_to(1_000_000)
    ecu.send(Frame(frame_id=1, data=b"", is_fd=True))
    bus.advance_to(100_000_000)
    babbled = ecu.receive_all()
    # 4,504 classic frames of eight bytes a second are the most that 500 kbit/s carry, and the others wait for ever.
    assert 0.1 * 3_500 < len(babbled) < 0.1 * 4_504
    assert {frame.frame_id for frame in babbled} == {0}
    assert port.receive_all() == []
    bus.advance_to(200_000_000)
    assert [frame.frame_id for frame in port.receive_all()] == [1]


def test_the_flow_changes_in_its_span_and_is_given_back():
    plant = LiveOscillator(CONFIG)
    run = Run("reynolds=700@0.4..0.6", "gust:amplitude=0.1,period=1@0.2..0.45", plant=plant)
    reynolds, wind = (np.array(values, dtype=float) for values in zip(*plant.seen, strict=True))
    assert list(reynolds[:60]) == [500.0] * 20 + [700.0] * 10 + [500.0] * 30
    # A period of 1 t_c is 0.1 s: two whole ones from 0.2 s on.
    t = 0.2 * np.arange(60)
    expected = np.where((t >= 2.0) & (t <= 4.0), 0.1 * np.sin(2 * np.pi * (t - 2.0)), 0.0)
    np.testing.assert_allclose(wind[:60], expected, atol=1e-12)
    assert run.acted == [10, 12 + 1]
    assert (plant.config.reynolds, plant.wind) == (500.0, None)


def test_a_plant_that_cannot_be_disturbed_is_refused_and_one_that_fails_is_given_back():
    class Bare(Oscillator):
        layout, description, t = LiveOscillator.layout, "bare", 0.0

    class Breaks(LiveOscillator):
        def advance_to(self, substep, action=None):
            raise ArithmeticError

    with pytest.raises(ConfigError, match="this plant's flow cannot change"):
        Run("reynolds=700", plant=Bare(CONFIG.flow.substeps))
    plant = Breaks(CONFIG)
    with pytest.raises(ArithmeticError):
        Run("reynolds=700", "gust:amplitude=0.1,period=1", plant=plant)
    assert (plant.config.reynolds, plant.wind) == (500.0, None)

    class Ended(Breaks):
        def set_reynolds(self, reynolds):
            if reynolds == 500.0:
                raise PlantError("has ended")
            super().set_reynolds(reynolds)

    with pytest.raises(ArithmeticError):
        Run("reynolds=700", plant=Ended(CONFIG))


def test_spans_that_are_no_numbers_or_too_short_are_refused_with_the_remedy():
    usual: dict[str, Any] = {"lead_in": 25.0, "controlled": 100.0, "settle": 40.0}
    for name in usual:
        for value in (inf, nan, -1.0):
            with pytest.raises(StillwakeError, match=rf"--{name.replace('_', '-')} = {value}: must be a number of t_c"):
                Spans(**{**usual, name: value}, averages=False)
    for changes, named in (
        ({"lead_in": 9.8}, "--lead-in = 9.8: must be at least 10 t_c, 2 shedding cycles, .*--no-averages"),
        ({"controlled": 6.0}, "--controlled = 6 less --settle = 40 leaves -34 t_c: must be at least 10 t_c"),
        ({"controlled": 9.9, "settle": 0.0}, "leaves 9.9 t_c"),
    ):
        with pytest.raises(StillwakeError, match=named):
            Spans(**{**usual, **changes})
        Spans(**{**usual, **changes}, averages=False)
    for name in ("lead_in", "controlled"):
        with pytest.raises(StillwakeError, match=r"= 0\.05: shorter than a control period of"):
            Spans(**{**usual, name: 0.05}, averages=False).periods(0.2)
