"""One control step at a time: window, plan, command on the wire, fail-safe and counters."""

import numpy as np
import pytest

from can_bridge.command_gate import Intervention
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
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
