"""One control step at a time: window, plan, command on the wire, fail-safe and counters."""

from dataclasses import replace

import numpy as np
import pytest

from can_bridge.command_gate import Intervention
from can_bridge.e2e.sender import E2eSender
from can_bridge.wire import codec
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S, PRESSURE
from can_bridge.wire.messages import Mode, Pressure, Reason
from contract.config.controller import CostWeights
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from firmware_sim.ecu.ecu import Ecu
from tests.each import each

WINDOW, HORIZON = 4, 5
SCALE = OperatingPoint().flow_rate_scale
QUANTUM = FLOW_RESOLUTION_M2_PER_S / SCALE  # one step of the wire as an action
CP_QUANTUM = 0.1 / OperatingPoint().dynamic_pressure


def test_it_warms_up_until_the_window_is_full(bench):
    # The first frame makes the stream known, from the second on it is trusted.
    commands = bench.good(WINDOW + 3)
    assert [command.mode for command in commands] == [Mode.OFF, *[Mode.WARMUP] * 3, *[Mode.CONTROL] * 3]
    assert [command.enable for command in commands] == [False] * 4 + [True] * 3
    assert all(command.flow_m2_per_s == 0.0 for command in commands[:4])
    assert len(bench.controller.calls) == 3
    assert bench.status.state is Mode.CONTROL


def test_without_a_request_it_stays_off_and_fills_the_window(bench):
    assert {command.mode for command in bench.good(WINDOW + 2, enable=False)} == {Mode.OFF}
    assert bench.controller.calls == []
    assert bench.good(1)[0].mode is Mode.CONTROL


def test_a_row_is_the_pressures_now_and_the_action_before(bench_of, recording_controller):
    actions = iter(0.001 * np.arange(1, 100))
    controller = recording_controller()
    controller.plan = lambda i: next(actions) if i == 0 else 0.0
    bench = bench_of(controller)
    rng = np.random.default_rng(0)
    pressures, sent = rng.uniform(-2.0, 2.0, (WINDOW + 6, 4)), [0.0]
    for cp in pressures:
        sent.append(bench.step(bench.pressure(cp)).flow_m2_per_s / SCALE)
    assert len(set(sent)) > 5
    # The stream is trusted from frame 1 on.
    for number, (window, _, free) in enumerate(controller.calls):
        newest = WINDOW + number
        rows = slice(newest - WINDOW + 1, newest + 1)
        # Pressures lose half a step of the wire at most; actions are what the wire carried, to the bit.
        np.testing.assert_allclose(window[:, :4], pressures[rows], atol=0.501 * CP_QUANTUM)
        np.testing.assert_array_equal(window[:, 4], sent[rows])
        np.testing.assert_array_equal(free, np.ones(HORIZON))


def test_the_action_fed_back_is_the_one_on_the_wire(bench_of, recording_controller):
    wanted = 0.0123456789
    bench = bench_of(recording_controller(lambda i: wanted))
    bench.into_control()
    command = bench.step(bench.pressure())
    fed_back = bench.controller.calls[-1][0][-1, 4]
    assert fed_back == command.flow_m2_per_s / SCALE
    assert fed_back != wanted
    assert fed_back == pytest.approx(wanted, abs=0.501 * QUANTUM)
    assert bench.ecu.trace.action == fed_back


def test_the_next_plan_starts_from_the_last(bench_of, recording_controller):
    bench = bench_of(recording_controller(lambda i: 0.01 * i))
    bench.into_control()
    bench.step(bench.pressure())
    plans = [plan for _, plan, _ in bench.controller.calls]
    np.testing.assert_array_equal(plans[0], np.zeros(HORIZON))
    np.testing.assert_allclose(plans[1], 0.01 * np.arange(HORIZON))


@each("delay", [1, 2])
def test_a_late_actuator_shifts_the_window_and_commits_what_is_under_way(bench_of, recording_controller, delay):
    counter = iter(range(10_000))
    controller = recording_controller(lambda i: 0.0005 * next(counter))
    bench = bench_of(controller, delay_steps=delay)
    commands = [command.flow_m2_per_s / SCALE for command in bench.good(WINDOW + 8)]
    commands = [0.0] * delay + commands  # commands[k]: what the jets, `delay` late, reach at the end of period k
    for number, (window, plan, free) in enumerate(controller.calls):
        k = WINDOW + number
        np.testing.assert_array_equal(free, [0.0] * delay + [1.0] * (HORIZON - delay))
        in_force = [0.0, *commands]
        np.testing.assert_array_equal(window[:, 4], in_force[k - WINDOW + 1 : k + 1])
        # The graph shifts the plan by one; then come the commands that the jets have yet to follow.
        np.testing.assert_array_equal(plan[1 : delay + 1], commands[k : k + delay])
        # Sent now is what the plan has for `delay` periods from now.
        new = 0.0005 * (number * HORIZON + delay)
        assert commands[k + delay] == pytest.approx(new, abs=0.501 * QUANTUM)


def test_missing_frames_hold_then_halve_then_shut_and_latch(bench):
    full = bench.into_control().flow_m2_per_s
    assert full == pytest.approx(0.01 * SCALE)
    commands = [bench.step() for _ in range(5)]
    assert [command.mode for command in commands] == [Mode.HOLD, Mode.DECAY, Mode.DECAY, Mode.FAULT, Mode.FAULT]
    assert [command.enable for command in commands] == [True, True, True, False, False]
    expected = [full, full / 2, full / 4, 0.0, 0.0]
    assert [command.flow_m2_per_s for command in commands] == pytest.approx(expected, abs=FLOW_RESOLUTION_M2_PER_S)
    assert (bench.status.state, bench.status.missed) == (Mode.FAULT, 6)  # the first frame of all was not yet trusted
    assert bench.status.reason is Reason.STREAM_LOST


def test_pressures_from_before_a_long_gap_are_never_planned_on(bench_of):
    bench = bench_of(rearm_frames=1)
    for _ in range(WINDOW + 1):
        bench.step(bench.pressure((5.0, 5.0, 5.0, 5.0)))
    calls = len(bench.controller.calls)
    assert calls == 1
    for _ in range(6):
        bench.step()
    # Two frames until the stream is trusted again, then the edge, long before the window is full of new rows.
    modes = [command.mode for command in [*bench.good(2, enable=False), *bench.good(WINDOW)]]
    assert modes == [Mode.FAULT] * 2 + [Mode.WARMUP] * (WINDOW - 2) + [Mode.CONTROL] * 2
    for window, _, _ in bench.controller.calls[calls:]:
        assert window[:, 0].max() < 1.0


def test_one_invalid_sensor_is_a_miss(bench):
    full = bench.into_control().flow_m2_per_s
    command = bench.step(bench.pressure(valid=(True, False, True, True)))
    assert (command.mode, command.flow_m2_per_s) == (Mode.HOLD, full)
    assert (bench.status.reason, bench.status.missed) == (Reason.SENSOR_INVALID, 2)


def test_the_gate_bounds_what_the_controller_wants(bench_of, recording_controller):
    limit = FlowConfig().action_limit
    bench = bench_of(recording_controller(lambda i: 10.0), command_step=0.03)
    bench.into_control()
    sent = [bench.ecu.trace.action, *(bench.step(bench.pressure()).flow_m2_per_s / SCALE for _ in range(3))]
    assert sent == pytest.approx([0.03, 0.06, limit, limit], abs=QUANTUM)
    assert bench.ecu.trace.interventions == Intervention.RANGE


def test_overruns_are_whole_periods_left_out(bench):
    bench.good(3)
    assert bench.status.overruns == 0
    bench.step(bench.pressure(), periods=3)
    bench.step(bench.pressure())
    assert bench.status.overruns == 2
    bench.now_ns += bench.config.period_ns * 4 // 10  # jitter is none
    bench.good(2)
    assert bench.status.overruns == 2
    bench.now_ns += 10**9 * 3600
    bench.good(1)
    assert bench.status.overruns == 0xFFFF


@each("delay", [0, 1])
def test_a_skipped_period_has_a_row_of_its_own(bench_of, recording_controller, delay):
    counter = iter(range(10_000))
    bench = bench_of(recording_controller(lambda i: 0.0005 * next(counter)), delay_steps=delay)
    bench.into_control()
    sent = [bench.good(1)[0].flow_m2_per_s / SCALE]
    sent.append(bench.step(bench.pressure((0.5, 0.5, 0.5, 0.5)), periods=2).flow_m2_per_s / SCALE)
    sent.append(sent[-1])  # the jets stay while the ECU is silent
    bench.step(bench.pressure((0.7, 0.7, 0.7, 0.7)))
    window = bench.controller.calls[-1][0]
    np.testing.assert_allclose(window[-3:, 0], [0.5, 0.5, 0.7], atol=CP_QUANTUM)
    in_force = sent if delay == 0 else sent[:-1]
    np.testing.assert_array_equal(window[-len(in_force) :, 4], in_force)
    assert len(set(sent)) == 2


def test_status_names_the_bundle(bench, bundle_of):
    bench.good(1)
    assert bench.status.bundle_hash == bundle_of().short_hash == 0x01234567
    assert bench.status.bus_off == 0


def test_weights_reach_the_controller_in_the_order_of_its_input(bundle_of, recording_controller):
    def driven(weights: CostWeights | None) -> list[np.ndarray | None]:
        controller, sender, config = recording_controller(), E2eSender(PRESSURE), Config()
        step, seen = controller.control_step, list[np.ndarray | None]()

        def kept(window, plan, free, weights=None):
            seen.append(weights)
            return step(window, plan, free, weights)

        controller.control_step = kept
        ecu = Ecu(bundle_of(), controller, config)
        if weights is not None:
            ecu.calibrate(replace(ecu.calibration, weights=weights))
        for k in range(6):
            message = Pressure(pressure_pa=(0.0,) * 4, valid=(True,) * 4, enable_request=k > 0, age_ns=0)
            now_ns = k * config.period_ns
            ecu.step(now_ns, [sender.frame(codec.emit_pressure(message), now_ns=now_ns)])
        return seen

    # The manifest's apply where none are given, whatever the controller was exported with.
    defaults = driven(None)
    assert defaults
    own = bundle_of().manifest.mpc.weights
    for weights in defaults:
        np.testing.assert_array_equal(weights, own.as_tuple())
    found = driven(
        CostWeights(drag_mean=1.0, drag_fluctuation=2.0, lift=3.0, lift_mean=4.0, smoothness=5.0, effort=6.0, rate=7.0)
    )
    assert found
    for weights in found:
        np.testing.assert_array_equal(weights, [1, 2, 3, 4, 5, 6, 7])
