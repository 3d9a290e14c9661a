"""Runs at speeds that vary: what the vehicle sends, what lies about it, and the flow that the jets act on."""

from typing import Any

import numpy as np
import pytest

from can_bridge.e2e.profiles import profile_of
from can_bridge.secoc.key import Key
from can_bridge.secoc.node import Authentication
from can_bridge.secoc.securing import verify
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import VEHICLE_SPEED
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.errors import ConfigError
from contract.release import bundle
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.runs.run_log import COLUMNS, WALL, WITHOUT, RunLog
from tests.can_bridge.wire.described import DBC
from tests.ecu.conftest import make_bundle
from tests.firmware_sim.bench.harness import NAMES, SPANS, LiveOscillator, Run, Waves
from wake.plant.drive import Drive
from wake.truck.truck_wake import TruckWake

CONFIG = Config()
UP = Drive(name="up", times=(0.0, 0.5), speeds=(20.0, 30.0))
"""From 0.2 s of the run to 0.7 s, with `SPANS`."""


class DrivenOscillator(LiveOscillator):
    """Whose stream can have any speed; `scaled` keeps by what."""

    scaled: tuple[float, ...] = ()

    def scale(self, ratio: float) -> None:
        self.scaled = (*self.scaled, ratio)

    def state(self):
        return dict(vars(self), asked=[], seen=[])

    def reset(self, state):
        vars(self).update(state, asked=[], seen=[])


def driven(*texts: str, drive: Drive = UP) -> tuple[RunLog, list, DrivenOscillator]:
    """The log, the vehicle's speeds by cantools, and the plant."""
    frames, plant = list[Frame](), DrivenOscillator(CONFIG)
    around: dict[str, Any] = {"controller": Waves(), "disturbances": Disturbances.parse(texts), "drive": drive}
    log = Simulation(make_bundle(), CONFIG, spans=SPANS, **around).run(plant, capture=frames.append)
    message = DBC.get_message_by_name("VehicleSpeed")
    return log, [message.decode(one.data, decode_choices=False) for one in frames if VEHICLE_SPEED.names(one)], plant


def test_the_speed_is_on_the_bus_in_the_series_and_in_the_stream():
    log, sent, plant = driven("gust:amplitude=0.1,period=4@0.2..1")
    expected = np.interp(0.02 * np.arange(60), [0.2, 0.7], [20.0, 30.0])
    np.testing.assert_allclose(log.series["speed"], expected)
    # Half a step of the wire; the gust is in the air.
    np.testing.assert_allclose([one["Speed"] for one in sent], expected, atol=0.0025 + 1e-9)
    assert {one["Age"] for one in sent} == {0}
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
    honest = np.array([one["Speed"] for one in driven()[1]])
    k, late, frozen = np.arange(60), honest.copy(), honest.copy()
    late[20:], frozen[20:40] = honest[10:50], honest[20]
    cases = {
        "speed_scale=1.1@0.4..": np.where(k >= 20, 1.1 * honest, honest),
        "speed_late=0.2@0.4..": late,
        "speed_frozen@0.4..0.8": frozen,
        "no_speed@0.4..0.8": np.delete(honest, np.arange(20, 40)),
    }
    for text, expected in cases.items():
        log, sent, _ = driven(text)
        np.testing.assert_allclose([one["Speed"] for one in sent], expected, atol=0.005, err_msg=text)
        np.testing.assert_allclose(log.series["speed"], honest, atol=0.003)
        assert log.metadata.faults[0].acted == (20 if ".." in text and text[-1] != "." else 40)


def test_another_density_scales_the_pressures_and_is_sent_where_it_is_known():
    for text, stated in {"density=0.9": 0, "density:density=0.9,stated=true": 0.9}.items():
        _, sent, _ = driven(text)
        assert {one["AirDensity"] for one in sent} == {stated}, text
        run = Run(text)
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


def test_a_drive_needs_a_flow_that_can_have_it():
    with pytest.raises(ConfigError, match="drive up: this plant has a constant speed"):
        Simulation(make_bundle(), CONFIG, spans=SPANS, controller=Waves(), drive=UP).run(LiveOscillator(CONFIG))
