"""One control step at a time: window, plan, and command on the wire."""

from itertools import product

import numpy as np
import pytest

from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode
from contract.config.operating_point import OperatingPoint
from tests.each import each
from tests.ecu.conftest import HORIZON, WINDOW, numbered

SCALE = OperatingPoint().flow_rate_scale
QUANTUM = FLOW_RESOLUTION_M2_PER_S / SCALE  # one step of the wire as an action
CP_QUANTUM = 0.1 / OperatingPoint().dynamic_pressure


def test_it_warms_up_until_the_window_is_full(bench, bundle_of):
    # The first frame makes the stream known, from the second on it is trusted and echoed.
    commands = bench.good(WINDOW + 3)
    assert [command.mode for command in commands] == [Mode.OFF, *[Mode.WARMUP] * 3, *[Mode.CONTROL] * 3]
    assert [command.enable for command in commands] == [False] * 4 + [True] * 3
    assert [command.pressure_counter for command in commands] == [None, 1, 2, 3, 4, 5, 6]
    assert all(command.flow_m2_per_s == 0.0 for command in commands[:4])
    assert len(bench.controller.calls) == 3
    assert (bench.status.state, bench.status.overruns) == (Mode.CONTROL, 0)
    assert bench.status.bundle_hash == bundle_of().short_hash == 0x01234567


def test_without_a_request_it_stays_off_and_fills_the_window(bench):
    assert {command.mode for command in bench.good(WINDOW + 2, enable=False)} == {Mode.OFF}
    assert bench.controller.calls == []
    assert bench.good(1)[0].mode is Mode.CONTROL


@each("plan_ahead, delay", product([False, True], [0, 1, 3]))
def test_a_row_is_the_pressures_now_and_the_action_before_and_what_is_under_way_is_settled(bench_of, plan_ahead, delay):
    bench = bench_of(numbered(), plan_ahead=plan_ahead, delay_steps=delay)
    pressures = np.random.default_rng(0).uniform(-2.0, 2.0, (WINDOW + 8, 4))
    commands = [bench.step(bench.pressure(cp)) for cp in pressures]
    settled = delay + plan_ahead
    assert {command.next_period for command in commands} == {plan_ahead}
    assert len({command.flow_m2_per_s for command in commands[WINDOW:]}) > 5
    # reached[k]: by the jets at the end of period k. The stream is trusted from frame 1 on.
    reached = [0.0] * settled + [command.flow_m2_per_s / SCALE for command in commands]
    for number, (window, plan, free) in enumerate(bench.controller.calls):
        k = WINDOW + number
        # Pressures lose half a step of the wire at most; actions are what the wire carried, to the bit.
        np.testing.assert_allclose(window[:, :4], pressures[k - WINDOW + 1 : k + 1], atol=0.501 * CP_QUANTUM)
        # The row of period j holds what the jets had reached when it was sampled, at the end of period j - 1.
        np.testing.assert_array_equal(window[:, 4], [0.0, *reached][k - WINDOW + 1 : k + 1])
        np.testing.assert_array_equal(free, [0.0] * settled + [1.0] * (HORIZON - settled))
        np.testing.assert_array_equal(plan[1 : settled + 1], reached[k : k + settled])
        # Sent now is what the plan has for as many periods from now as are settled.
        assert reached[k + settled] == pytest.approx(0.0016 * ((number * HORIZON + settled) % 40), abs=QUANTUM)


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


@each("delay", [0, 1])
def test_a_skipped_period_has_a_row_of_its_own_and_is_counted(bench_of, delay):
    bench = bench_of(numbered(), delay_steps=delay)
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
    assert bench.status.overruns == 1


def test_a_jump_of_the_clock_costs_no_more_rows_than_the_gap_that_is_bridged(bench, monkeypatch):
    """Sixty-five thousand of them took long enough to miss the deadline once more."""
    bench.into_control()
    memory, rows = type(bench.ecu.state.memory), 0
    bridged = memory.bridged

    def counted(self, longest_gap: int):
        nonlocal rows
        rows += 1
        return bridged(self, longest_gap)

    monkeypatch.setattr(memory, "bridged", counted)
    bench.now_ns += 10**17
    bench.good(1)
    assert 0 < rows <= bench.config.ecu.hold_periods + bench.config.ecu.decay_periods + 1
    assert bench.status.overruns == 0xFFFF
