"""Other weights, bounds and delay in flight: from one control period to the next, as a whole, and never wider."""

import struct
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.calibration.segment import Page, Segment
from can_bridge.wire.messages import Mode
from contract.config.controller import CostWeights, MpcConfig
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.controller.calibration import CALIBRATION_NAMES, Calibration, CalibrationLimits
from contract.controller.interface import TERMS
from ecu.calibrating import limits_of, release_calibration
from ecu.ecu import Ecu
from tests.each import each
from tests.ecu.conftest import HORIZON, RecordingController, make_bench, make_bundle, numbered
from tests.examples import examples

LIMIT = FlowConfig().action_limit


def calibration_of(bench, **changes) -> Calibration:
    own = release_calibration(bench.bundle, bench.config)
    weights = {name: changes.pop(name) for name in TERMS if name in changes}
    return replace(own, weights=replace(own.weights, **weights), **changes)


def calibrate(bench, **changes) -> None:
    bench.ecu.calibrate(calibration_of(bench, **changes))


@each("delay, plan_ahead", [(0, True), (2, False)])
def test_the_releases_own_values_change_no_bit(delay, plan_ahead):
    """Also where the calibration is rounded to float32, as over the bus: 0.075 and 0.1 are no float32."""
    settings = {"delay_steps": delay, "plan_ahead": plan_ahead}
    plain, other = (make_bench(numbered(), **settings) for _ in range(2))
    for k in range(30):
        frames = [bench.pressure((0.1 * k, -0.02 * k, 0.3, 0.4)) for bench in (plain, other)]
        if k % 3 == 0:
            other.ecu.calibrate(Calibration.unpack(calibration_of(other).pack()))
        now_ns = plain.now_ns
        assert plain.ecu.step(now_ns, frames[:1]) == other.ecu.step(now_ns, frames[1:])
        plain.now_ns = other.now_ns = now_ns + plain.config.period_ns
    assert plain.ecu.state == other.ecu.state
    assert plain.ecu.trace.mode is Mode.CONTROL


def test_weights_and_limit_are_those_of_the_period_in_the_order_of_the_controllers_input():
    bench = make_bench()
    bench.into_control()
    own = (*bench.bundle.manifest.mpc.weights.as_tuple(), LIMIT)
    wanted = (*(float(k) for k in range(1, len(TERMS) + 1)), 0.5 * LIMIT)
    calibrate(bench, **dict(zip((*TERMS, "action_limit"), wanted, strict=True)))
    bench.good(2)
    given = [(*weights.tolist(), limit) for weights, _, limit in bench.controller.settings]
    np.testing.assert_allclose(given, [own, *[wanted] * 2], rtol=1e-7)


@examples(24)
@given(data=st.data(), limit=st.sampled_from([0.075, 0.07, 0.1]), step=st.floats(1e-4, 0.2))
def test_what_the_segment_takes_the_ecu_takes(data, limit, step):
    """Also at the limits, which are no float32: a set that came over the bus never stops the control."""
    config = Config(flow=FlowConfig(action_limit=limit), ecu=EcuConfig(command_step=step))
    made = make_bundle(action_limit=limit)
    segment = Segment(release_calibration(made, config), limits_of(made, config))
    ecu = Ecu(made, RecordingController(), config)
    rows = zip(segment.limits.least.values, segment.limits.greatest.values, strict=True)
    *values, delay_steps = (data.draw(st.one_of(st.sampled_from(row), st.floats(*row))) for row in rows)
    wanted = struct.pack("<10fI", *values, int(delay_steps))
    segment.set(Calibration.unpack(wanted))
    ecu.calibrate(segment.in_force)
    assert ecu.state.memory.sizes[-1] == int(delay_steps) + config.ecu.plan_ahead
    assert segment.read(Page.WORKING, 0, 44) == wanted


def test_limits_are_the_vehicles_and_a_release_may_weigh_more():
    config = Config(ecu=EcuConfig(command_step=0.04, plan_ahead=True))
    limits = limits_of(make_bundle(mpc=MpcConfig(horizon=HORIZON, weights=CostWeights(smoothness=5000.0))), config)
    greatest = dict(zip(CALIBRATION_NAMES, limits.greatest.values, strict=True))
    assert (greatest["command_step"], greatest["action_limit"]) == (0.04, LIMIT)
    assert (greatest["smoothness"], greatest["lift"]) == (5000.0, 1000.0)
    assert greatest["delay_steps"] == HORIZON - 2  # planning ahead settles one more


def test_the_gate_holds_the_vehicles_bounds_though_the_limits_fail(monkeypatch):
    bench = make_bench(RecordingController(lambda i: 1.0))
    bench.into_control()
    monkeypatch.setattr(CalibrationLimits, "check", lambda limits, calibration: None)
    calibrate(bench, action_limit=1.2 * LIMIT, command_step=1.2 * LIMIT)
    assert all(one.flow_m2_per_s <= LIMIT * OperatingPoint().flow_rate_scale for one in bench.good(3))
