"""One control step at a time: window, plan, and command on the wire; frames that are old, lost, damaged or repeated;
a release that serves a range of speeds.

That its jets obey it whatever comes is judged in `tests/proofs/ecu`; here are the exact limits and reasons.
"""

from dataclasses import replace
from itertools import product
from unittest.mock import patch

import numpy as np
import pytest

from can_bridge.command_gate import Intervention
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode, Reason
from contract.config.operating_point import OperatingPoint
from contract.release.manifest import SpeedRange
from ecu.controller_memory import ControllerMemory
from tests.each import each
from tests.ecu.conftest import HORIZON, WINDOW, Bench, make_bench, make_bundle, numbered

SCALE = OperatingPoint().flow_rate_scale
QUANTUM = FLOW_RESOLUTION_M2_PER_S / SCALE  # one step of the wire as an action
CP_QUANTUM = 0.1 / OperatingPoint().dynamic_pressure


def test_it_warms_up_until_the_window_is_full(bench):
    # The first frame makes the stream known, from the second on it is trusted and echoed.
    commands = bench.good(WINDOW + 3)
    assert [command.mode for command in commands] == [Mode.OFF, *[Mode.WARMUP] * 3, *[Mode.CONTROL] * 3]
    assert [command.enable for command in commands] == [False] * 4 + [True] * 3
    assert [command.pressure_counter for command in commands] == [None, 1, 2, 3, 4, 5, 6]
    assert all(command.flow_m2_per_s == 0.0 for command in commands[:4])
    assert (len(bench.controller.calls), bench.status.state, bench.status.overruns) == (3, Mode.CONTROL, 0)
    assert bench.status.bundle_hash == make_bundle().short_hash == 0x01234567


@each("plan_ahead, delay", product([False, True], [0, 1, 3]))
def test_a_row_is_the_pressures_now_and_the_action_before_and_what_is_under_way_is_settled(plan_ahead, delay):
    bench = make_bench(numbered(), plan_ahead=plan_ahead, delay_steps=delay)
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


def test_pressures_from_before_a_long_gap_are_never_planned_on():
    bench = make_bench(rearm_frames=1)
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
def test_a_skipped_period_has_a_row_of_its_own_and_is_counted(delay):
    bench = make_bench(numbered(), delay_steps=delay)
    bench.into_control()
    sent = [bench.good(1)[0].flow_m2_per_s / SCALE]
    sent.append(bench.step(bench.pressure((0.5, 0.5, 0.5, 0.5)), periods=2).flow_m2_per_s / SCALE)
    sent.append(sent[-1])  # the jets stay while the ECU is silent
    bench.step(bench.pressure((0.7, 0.7, 0.7, 0.7)))
    window = bench.controller.calls[-1][0]
    np.testing.assert_allclose(window[-3:, 0], [0.5, 0.5, 0.7], atol=CP_QUANTUM)
    in_force = sent if delay == 0 else sent[:-1]
    np.testing.assert_array_equal(window[-len(in_force) :, 4], in_force)
    assert (len(set(sent)), bench.status.overruns) == (2, 1)


def test_a_jump_of_the_clock_costs_no_more_rows_than_the_gap_that_is_bridged(bench):
    """Sixty-five thousand of them took long enough to miss the deadline once more."""
    bench.into_control()
    bench.now_ns += 10**17
    with patch.object(ControllerMemory, "bridged", autospec=True, side_effect=ControllerMemory.bridged) as bridged:
        bench.good(1)
    assert 0 < bridged.call_count <= bench.config.ecu.hold_periods + bench.config.ecu.decay_periods + 1
    assert bench.status.overruns == 0xFFFF


def controlling(bench):
    """Late enough for frames that are older than their bench."""
    bench.now_ns = 10**10
    bench.into_control()
    return bench


def aged(bench, age_ms: float, *, in_queue: bool, **message) -> Frame:
    """A frame whose pressures are so old: by its own word, or because it waited in a queue."""
    age_ns = round(age_ms * 1e6)
    frame = bench.pressure(age_ns=0 if in_queue else age_ns, **message)
    return replace(frame, timestamp_ns=bench.now_ns - age_ns) if in_queue else frame


@each("in_queue, row", product([True, False], [(0.0, True), (20.0, True), (30.0, True), (30.01, False), (60.0, False)]))
def test_pressures_are_planned_on_for_a_period_and_a_half(in_queue, row):
    bench, (age_ms, usable) = controlling(make_bench()), row
    calls, missed = len(bench.controller.calls), bench.status.missed
    command = bench.step(aged(bench, age_ms, in_queue=in_queue))
    assert (command.mode, command.enable) == (Mode.CONTROL if usable else Mode.HOLD, True)
    assert bench.status.reason is (Reason.NONE if usable else Reason.STALE)
    assert (len(bench.controller.calls) - calls, bench.status.missed - missed) == (usable, not usable)


def test_pressures_of_the_future_are_stale_and_a_stale_request_is_a_request_all_the_same():
    bench = controlling(make_bench())
    command = bench.step(replace(bench.pressure(), timestamp_ns=bench.now_ns + 1))
    assert (command.mode, bench.status.reason) == (Mode.HOLD, Reason.STALE)
    command = bench.step(aged(bench, 90.0, in_queue=True, enable=False))
    assert (command.mode, command.enable) == (Mode.OFF, False)


def test_frames_that_cannot_be_used_do_not_make_the_command_younger():
    """Held on pressures of an age of 25 ms, with fresh frames of an invalid sensor: shut when the old are 80 ms."""
    bench = controlling(make_bench(hold_periods=3, decay_periods=0))
    assert bench.step(aged(bench, 25.0, in_queue=True)).enable
    seen = []
    for _ in range(3):
        command = bench.step(bench.pressure((0.1, 0.2, 0.3, np.nan)))
        seen.append((command.mode, command.enable, bench.status.reason))
    # At 45, 65 and 85 ms.
    held = (Mode.HOLD, True, Reason.SENSOR_INVALID)
    assert seen == [held, held, (Mode.HOLD, False, Reason.STALE)]
    assert bench.ecu.trace.interventions == Intervention.STALE
    assert bench.step(bench.pressure()).mode is Mode.CONTROL
    assert bench.status.reason is Reason.NONE


def test_of_several_frames_the_newest_counts_and_a_repeated_one_is_a_miss_and_no_crc_error(bench):
    bench.into_control()
    frames = [bench.pressure((value,) * 4) for value in (0.2, 0.5, 0.8)]
    assert bench.step(*frames).mode is Mode.CONTROL
    assert bench.controller.calls[-1][0][-1, 0] == pytest.approx(0.8, abs=1e-3)
    assert bench.step(frames[-1]).mode is Mode.HOLD
    assert (bench.status.crc_errors, bench.ecu.state.frames_rejected) == (0, 1)
    # The same again next to a new one does no harm.
    assert bench.step(frames[-1], bench.pressure()).mode is Mode.CONTROL


@each(
    "pattern, expected, reason",
    [
        # G a good frame, c a corrupted one, x none.
        ("x x x x", "HDDF", Reason.STREAM_LOST),
        # The third wrong CRC among five ends the trust in the stream, whatever good frames came with it.
        ("c c c c", "HDFF", Reason.STREAM_INVALID),
        ("c G c G c", "HCHCF", Reason.STREAM_INVALID),
        ("cG cG cG", "CCF", Reason.STREAM_INVALID),
        ("cccG cccG cccG cccG", "CCFF", Reason.STREAM_INVALID),
        ("x c x c x", "HDDFF", Reason.STREAM_LOST),
        ("G c c x G c c x", "CHDDCFFF", Reason.STREAM_INVALID),
    ],
)
def test_lost_frames_hold_and_decay_and_a_stream_not_to_be_trusted_shuts_at_once(pattern, expected, reason):
    bench = make_bench()
    bench.into_control()
    bench.good(5)

    def frame_of(kind: str) -> Frame:
        frame = bench.pressure()
        return replace(frame, data=frame.data[:-1] + bytes([frame.data[-1] ^ 1])) if kind == "c" else frame

    modes = ""
    for period in pattern.split():
        modes += bench.step(*(frame_of(kind) for kind in period if kind != "x")).mode.name[0]
    assert (modes, bench.status.reason) == (expected, reason)


def bench_at() -> Bench:
    bench = make_bench(bundle=make_bundle(speeds=SpeedRange(slowest=0.6, fastest=1.4)), rearm_frames=1)
    bench.cruises = None
    return bench


def drive(bench: Bench, ratio: float | None, periods: int, cp: float = 0.1, **stated) -> list:
    """Periods at a speed, with this Cp at the present dynamic pressure on all sensors."""
    pressure = (cp * (1.0 if ratio is None else ratio) ** 2,) * 4
    return [bench.step(bench.at_speed(ratio, **stated), bench.pressure(pressure)) for _ in range(periods)]


def test_the_window_has_steps_of_the_present_speed_and_the_jets_follow_it():
    """Faster and then slower: a row lies as far back in lengths travelled as the controller expects it."""
    bench, at = bench_at(), 0.0
    for ratio in [1.2] * 8 + [1.15, 1.1, 1.05, 1.05, 1.1]:
        at += ratio
        # Cp grows along the way: Pa follow the present dynamic pressure.
        bench.step(bench.at_speed(ratio), bench.pressure((0.02 * at * ratio**2,) * 4))
    window, _, _ = bench.controller.calls[-1]
    # Half a step of a pressure on the wire, of 375 Pa at the design speed.
    np.testing.assert_allclose(window[:, 0], 0.02 * (at - np.arange(WINDOW)[::-1]), atol=1.5e-4)
    # What the jets had reached is 0.01 of the speed before.
    assert window[-1, 4] == pytest.approx(0.01 * 1.05 / 1.1, abs=2e-5)
    assert bench.good(1)[0].flow_m2_per_s == pytest.approx(0.01 * 1.1 * SCALE, abs=1.01e-4)


def test_below_the_design_speed_commands_and_pressures_follow_by_the_share_of_a_step():
    bench = bench_at()
    drive(bench, 0.8, 8, cp=0.1)
    sent = [command.flow_m2_per_s / SCALE for command in drive(bench, 0.8, 30, cp=0.2)]
    window, _, _ = bench.controller.calls[-30]
    assert window[-1, 0] == pytest.approx(0.1 + 0.8 * 0.1, abs=4e-4)
    assert bench.controller.calls[-29][0][-1, 0] == pytest.approx(0.2 - 0.2**2 * 0.1, abs=4e-4)
    assert sent[-1] == pytest.approx(0.01 * 0.8, abs=1e-5)


def test_without_a_speed_the_last_one_stands_for_a_while_and_then_no_pressure_is_usable():
    bench = bench_at()
    assert not bench.good(3)[-1].enable and bench.status.reason is Reason.NO_SPEED
    bench = bench_at()
    drive(bench, 1.0, 6)
    assert bench.status.state is Mode.CONTROL
    for unknown in (lambda: (), lambda: (bench.at_speed(None),)):
        modes = []
        while bench.status.reason is Reason.NONE:
            modes.append(bench.step(*unknown(), bench.pressure()).mode)
        assert len(modes) == 500e6 / bench.config.period_ns + 1
        assert set(modes[:-1]) == {Mode.CONTROL} and bench.status.reason is Reason.NO_SPEED
        modes = [bench.step(bench.pressure()).mode for _ in range(3)]
        assert modes == [Mode.DECAY, Mode.DECAY, Mode.FAULT]
        # As after any latched fault: a new request, and the stream of speeds is to be trusted again.
        [bench.step(bench.at_speed(1.0), bench.pressure(enable=False)) for _ in range(2)]
        drive(bench, 1.0, 6)
        assert bench.status.state is Mode.CONTROL


def test_outside_its_speeds_the_jets_are_shut_and_come_back_by_themselves_with_hysteresis():
    bench = bench_at()
    drive(bench, 1.0, 8)
    for ratio in (0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.65, 0.6, 0.57, 0.53):
        assert drive(bench, ratio, 5)[-1].mode is Mode.CONTROL, ratio
    # Beyond its end the range's end stands for the speed: the pressures are the air's, whose speed may be there.
    assert bench.controller.calls[-1][0][-1, 0] == pytest.approx(0.1 * (0.53 / 0.6) ** 2, abs=6e-3)
    commands = drive(bench, 0.52, 1)
    assert (commands[0].mode, commands[0].flow_m2_per_s, bench.status.reason) == (Mode.WARMUP, 0.0, Reason.OFF_SPEED)
    # Standing still is no fault either, however long it lasts.
    for ratio in (0.5, 0.4, 0.2, 0.0):
        drive(bench, ratio, 20)
        assert (bench.status.state, bench.status.reason) == (Mode.WARMUP, Reason.OFF_SPEED), ratio
    for ratio in (0.2, 0.4, 0.5, 0.59):
        drive(bench, ratio, 20)
    assert (bench.status.state, bench.status.reason) == (Mode.WARMUP, Reason.OFF_SPEED)
    # The window begins again: no row of another speed is planned on.
    modes = [command.mode for command in drive(bench, 0.61, 8)]
    assert modes[:3] == [Mode.WARMUP] * 3 and modes[-1] is Mode.CONTROL and bench.status.reason is Reason.NONE


def test_a_speed_that_is_old_or_not_to_be_reached_does_not_count_and_the_density_scales_the_pressures():
    bench = bench_at()
    drive(bench, 1.0, 8)
    drive(bench, 1.02, 3, age_ns=600_000_000)
    assert bench.ecu.state.speed.ratio == 1.0
    drive(bench, 1.0, 2, cp=0.1, density=0.6)
    assert bench.controller.calls[-1][0][-1, 0] == pytest.approx(0.2, abs=4e-4)
    # 6.25 m/s at 15 m/s2 at most.
    for periods, ratio in ((20, 1.0), (1, 1.25)):
        drive(bench, 1.25, periods)
        assert bench.ecu.state.speed.ratio == pytest.approx(ratio)
