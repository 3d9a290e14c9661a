"""Whole runs: each disturbance acts where and when its text names, as seen on the bus and at the plant. At speeds that
vary: what the vehicle sends, what lies about it, and the flow that the jets act on."""

from math import inf, nan
from typing import Any

import numpy as np
import pytest

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.e2e.profiles import profile_of
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import Authentication, verify
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError, PlantError, StillwakeError
from contract.release import bundle
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.disturbing import LOOK_NS, Disturbing
from firmware_sim.bench.sensor_faults import GLOBAL_DEVIATION
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.runs.run_log import COLUMNS, WALL, WITHOUT, RunLog
from tests.firmware_sim.bench.harness import NAMES, LiveOscillator, Oscillator, Run
from wake.plant.drive import Drive
from wake.truck.truck_wake import TruckWake

CONFIG = Config()
PASCAL = CONFIG.operating_point.dynamic_pressure
UNIT = GLOBAL_DEVIATION * PASCAL
STEP_PA = 0.05  # half a step of the wire
UP = Drive(name="up", times=(0.0, 0.5), speeds=(20.0, 30.0))
"""From 0.2 s of the run to 0.7 s, with `SPANS`."""


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
    # Faults of the readings are in Pa, whatever the air's density.
    dense, wall = "density:density=1.4@0.6..", lambda wall: wall * np.where(k >= 30, 1.4 / 1.2, 1.0)[:, None]
    cases["quantise:step=50", dense] = lambda given: 50.0 * np.rint(wall(given) / 50.0)
    cases[f"stuck:sensor={NAMES[0]}@0.4..", dense] = lambda given: np.column_stack(
        [np.where(after, given[20, 0], given[:, 0]), wall(given)[:, 1:]]
    )
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
    # The step of 0.50 s is lost. Up at 0.605 s it has missed that period's pressures, and steps half a period later.
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
    delay = Disturbances.parse(["ecu:delay:delay_s=0.002"])
    port = Disturbing(delay, CONFIG, NAMES, 0, {}).connect(bus)("ecu", ecu)
    vehicle.send(Frame(frame_id=1, data=b"", is_fd=True))
    # On a bus that is quiet no other event would let the loop look: within one look of the 2 ms.
    assert bus.advance_until(10_000_000, lambda: bool(port.receive_all()))
    assert 2_000_000 < bus.now_ns <= 2_000_000 + 200_000 + LOOK_NS
    bus = SimulatedBus(BusConfig())
    vehicle, ecu = bus.port("vehicle"), bus.port("ecu")
    babble = Disturbances.parse(["vehicle:babble@0..0.1"])
    port = Disturbing(babble, CONFIG, NAMES, 0, {}).connect(bus)("vehicle", vehicle)
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

    with pytest.raises(ConfigError, match="this plant cannot change its flow"):
        Run("reynolds=700", plant=Bare(CONFIG.flow.substeps))
    with pytest.raises(ConfigError, match="drive up: this plant has a constant speed"):
        Run(drive=UP)
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
        ({"lead_in": 9.8}, r"--lead-in = 9.8: must be at least 10 t_c \(2 shedding cycles\) .*--no-averages"),
        ({"controlled": 6.0}, "--controlled = 6 less --settle = 40 leaves -34 t_c: must be at least 10 t_c"),
        ({"controlled": 9.9, "settle": 0.0}, "leaves 9.9 t_c"),
    ):
        with pytest.raises(StillwakeError, match=named):
            Spans(**{**usual, **changes})
        Spans(**{**usual, **changes}, averages=False)
    for name in ("lead_in", "controlled"):
        with pytest.raises(StillwakeError, match=r"= 0\.05: must be at least a control period of"):
            Spans(**{**usual, name: 0.05}, averages=False).periods(0.2)


class DrivenOscillator(LiveOscillator):
    scaled: tuple[float, ...] = ()

    def scale(self, ratio: float) -> None:
        self.scaled = (*self.scaled, ratio)

    def state(self):
        return dict(vars(self), asked=[], seen=[])

    def reset(self, state):
        vars(self).update(state, asked=[], seen=[])


def driven(*texts: str) -> Run:
    return Run(*texts, plant=DrivenOscillator(CONFIG), drive=UP)


def test_the_speed_is_on_the_bus_in_the_series_and_in_the_stream():
    run = driven("gust:amplitude=0.1,period=4@0.2..1")
    log, plant = run.log, run.plant
    expected = np.interp(0.02 * np.arange(60), [0.2, 0.7], [20.0, 30.0])
    np.testing.assert_allclose(log.series["speed"], expected)
    # Half a step of the wire; the gust is in the air.
    np.testing.assert_allclose([one["Speed"] for one in run.speeds], expected, atol=0.0025 + 1e-9)
    assert {one["Age"] for one in run.speeds} == {0}
    winds = np.array([wind for _, wind in plant.seen[:60]])
    gust = np.where((np.arange(60) >= 10) & (np.arange(60) < 50), 0.1 * np.sin(0.1 * np.pi * (np.arange(60) - 10)), 0.0)
    np.testing.assert_allclose(winds, expected / 25.0 - 1.0 + gust, atol=1e-9)
    assert (plant.scaled, plant.wind) == ((0.8,), None)
    # Without control the oscillator has no action at all.
    still = LiveOscillator(CONFIG)
    for k in range(60):
        assert log.series["without_Cl"][k] == still.sample().Cl
        still.advance_to(30, 0.0)
    assert np.abs(log.series["Cl"] - log.series["without_Cl"]).max() > 0.01


def test_a_speed_that_lies_is_late_frozen_or_missing_is_so_on_the_bus_alone():
    honest = np.array([one["Speed"] for one in driven().speeds])
    k, late, frozen = np.arange(60), honest.copy(), honest.copy()
    late[20:], frozen[20:40] = honest[10:50], honest[20]
    cases = {
        "speed_scale=1.1@0.4..": np.where(k >= 20, 1.1 * honest, honest),
        "speed_late=0.2@0.4..": late,
        "speed_frozen@0.4..0.8": frozen,
        "no_speed@0.4..0.8": np.delete(honest, np.arange(20, 40)),
    }
    for text, expected in cases.items():
        run = driven(text)
        np.testing.assert_allclose([one["Speed"] for one in run.speeds], expected, atol=0.005, err_msg=text)
        np.testing.assert_allclose(run.log.series["speed"], honest, atol=0.003)
        assert run.acted[0] == (20 if ".." in text and text[-1] != "." else 40)


def test_another_density_scales_the_pressures_and_is_sent_where_it_is_known():
    for text, stated in {"density=0.9": 0, "density:density=0.9,stated=true": 0.9}.items():
        run = Run(text)
        assert {one["AirDensity"] for one in run.speeds} == {stated}, text
        np.testing.assert_allclose(run.read, run.wall * 0.75, atol=0.0501)


def test_a_speed_has_its_own_freshness_and_what_does_not_fit_the_wire_is_unknown():
    key = Key(bytes(range(16)))
    config = Config(bus=BusConfig(key="somewhere"))
    node, message = VehicleNode(NAMES, config, authentication=Authentication(key=key)), message_set(config.bus).speed
    node.sample(np.zeros(90), enable_request=False, now_ns=0)
    for count, (speed, density) in enumerate([(31.5, 1.1), (400.0, 4.0), (None, 0.001)]):
        node.stated_speed, node.stated_density = speed, density
        frame = node.speed_frame(now_ns=7, age_ns=20_000)
        assert frame is not None
        assert (verify(frame.data, message.spec, key), frame.timestamp_ns) == ((1 << 32) + count, 7)
        assert profile_of(message.spec).counter_of(frame.data) == count
        value = message.parse(frame.data[: message.spec.protected])
        assert value is not None
        assert (value.speed_m_per_s, value.density_kg_per_m3) == ((31.5, 1.1) if count == 0 else (None, None))
        assert value.age_ns == 20_000


@pytest.mark.slow  # three flows
def test_a_drive_at_the_design_speed_is_the_run_without_one_to_the_bit(short_release, coarse):
    def run(drive: Drive | None) -> RunLog:
        wake = TruckWake(coarse.flow)
        wake.reset(coarse.start)
        spans = Spans(lead_in=1.0, controlled=1.6, settle=0.2, averages=False)
        return Simulation(bundle.load(short_release), Config(flow=coarse.flow), spans=spans, drive=drive).run(wake)

    plain, steady = run(None), run(Drive(name="", times=(0.0,), speeds=(25.0,)))
    for name in (*COLUMNS, WALL):
        if name != "step_ms":
            assert np.array_equal(plain.series[name], steady.series[name], equal_nan=True), name
    assert set(plain.series["speed"]) == {25.0}
    assert not set(WITHOUT) & set(plain.series)
    assert np.abs(plain.series["action"]).max() > 0.0
    # Until the jets move, both flows are one.
    assert np.array_equal(steady.series["without_Cd"][:5], steady.series["Cd"][:5])
    assert steady.series["without_Cd"][-1] != steady.series["Cd"][-1]
