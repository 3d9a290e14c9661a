"""Clocks that stand, jump and go back, steps that come late or early, and a CAN controller that was bus-off."""

import pytest

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.command_gate import Intervention
from can_bridge.wire import codec
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config

MS = 1_000_000
SHUT = (Mode.FAULT, False, 0.0)
STEP = Config().ecu.command_step * Config().operating_point.flow_rate_scale


def seen(command) -> tuple[Mode, bool, float]:
    return command.mode, command.enable, command.flow_m2_per_s


def swinging(recording_controller):
    """As far as it may, from one side to the other."""
    sides = iter([0.1, -0.1] * 10_000)
    controller = recording_controller()
    controller.plan = lambda i: next(sides) if i == 0 else 0.0
    return controller


def step_after(bench, elapsed_ns: int, *, fresh: bool = True):
    """A step so long after the latest; the bench has already moved on by a period."""
    bench.now_ns += elapsed_ns - bench.config.period_ns
    return bench.step(bench.pressure()) if fresh else bench.step()


@pytest.mark.parametrize("back_ns", [0, 1, 200 * MS, 10**10, 11 * 24 * 3600 * 10**9])
def test_a_clock_that_stands_or_goes_back_shuts_the_jets_and_latches(bench, back_ns):
    bench.now_ns = 10**16
    bench.into_control()
    assert seen(step_after(bench, -back_ns)) == SHUT
    assert bench.status.reason is Reason.CLOCK
    assert bench.status.overruns == 0
    # Good frames in the new time, then an edge; the window is filled anew.
    assert {command.mode for command in bench.good(8)} == {Mode.FAULT}
    assert bench.good(1, enable=False)[0].mode is Mode.FAULT
    assert bench.good(1)[0].mode is Mode.CONTROL


def test_steps_at_one_instant_do_not_move_the_jets(bench_of, recording_controller):
    bench = bench_of(swinging(recording_controller))
    bench.into_control()
    assert [seen(step_after(bench, 0)) for _ in range(6)] == [SHUT] * 6


def test_rows_of_a_wrong_clock_do_not_stay_in_the_window(bench_of):
    bench = bench_of(rearm_frames=1)
    bench.into_control()
    step_after(bench, 0)
    modes = [command.mode for command in [*bench.good(1, enable=False), *bench.good(3)]]
    # The third of these fills the window of four; the first row is of the step at which the clock was wrong.
    assert modes == [Mode.FAULT, Mode.WARMUP, Mode.CONTROL, Mode.CONTROL]


@pytest.mark.parametrize("elapsed_ms", [1, 5, 9, 10, 15])
def test_steps_too_often_do_not_slew_faster_and_end_as_a_wrong_clock(bench_of, recording_controller, elapsed_ms):
    bench = bench_of(swinging(recording_controller))
    bench.into_control()
    before, found = bench.good(1)[0], []
    for _ in range(60):
        command = step_after(bench, elapsed_ms * MS)
        if command.enable:
            reach = STEP * elapsed_ms / 20
            assert abs(command.flow_m2_per_s - before.flow_m2_per_s) <= reach + FLOW_RESOLUTION_M2_PER_S
        before = command
        found.append(command.mode)
    assert found[-1] is Mode.FAULT
    assert bench.status.reason is Reason.CLOCK


def test_a_clock_set_forward_shuts_the_jets_and_latches(bench):
    for jump_ns in (100 * MS, 10**9, 1311 * 10**9, 10**17):
        bench.good(1, enable=False)
        bench.good(8)
        bench.good(1, enable=False)
        assert bench.good(1)[0].mode is Mode.CONTROL
        assert seen(step_after(bench, jump_ns)) == SHUT
        assert bench.status.reason is Reason.DEADLINE


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
    step_after(bench, 10**17)
    assert 0 < rows <= bench.config.ecu.hold_periods + bench.config.ecu.decay_periods + 1
    assert bench.status.overruns == 0xFFFF


@pytest.mark.parametrize("now_ns", [-1, -(10**18)])
def test_a_time_before_zero_is_a_wrong_clock_and_no_exception(bench, now_ns):
    bench.into_control()
    frame = bench.pressure()
    bench.now_ns = now_ns
    assert seen(bench.step(frame)) == SHUT
    assert bench.status.reason is Reason.CLOCK
    bench.now_ns = 10**15
    bench.good(5, enable=False)
    assert bench.good(2)[-1].mode is Mode.CONTROL


def test_a_thousand_frames_in_one_step(bench):
    bench.into_control()
    command = bench.step(*[bench.pressure() for _ in range(1024)])
    assert (command.mode, command.pressure_counter) == (Mode.CONTROL, (4 + 1024) % 256)


@pytest.mark.parametrize("pattern", [(2,), (3, 3, 1), (2, 2, 1), (2, 1)])
def test_an_ecu_late_again_and_again_switches_itself_off(bench, pattern):
    bench.into_control()
    modes = []
    for periods in (pattern * 10)[:10]:
        modes.append(bench.step(bench.pressure(), periods=periods).mode)
    late = [k + 1 for k, periods in enumerate((pattern * 10)[:9]) if periods > 1]
    assert [mode is Mode.FAULT for mode in modes] == [k >= late[2] for k in range(10)]
    assert bench.status.reason is Reason.DEADLINE


def test_periods_of_almost_one_and_a_half_are_seen(bench):
    bench.into_control()
    for _ in range(20):
        command = step_after(bench, 29_900_000)
    assert command.mode is Mode.FAULT
    assert bench.status.reason is Reason.DEADLINE
    # Half a period each, added up, but for what is forgotten.
    assert 8 <= bench.status.overruns <= 10


def step_with(bench, health: BusHealth, *frames):
    answers = bench.ecu.step(bench.now_ns, frames, health)
    bench.now_ns += bench.config.period_ns
    bench.status = codec.parse_ecu_status(answers[1].data)
    command = codec.parse_jet_command(answers[0].data)
    assert command is not None
    return command


OFF_NOW = BusHealth(state=BusState.BUS_OFF, tx_errors=256, bus_off=1)
RECOVERED = BusHealth(bus_off=1)


@pytest.mark.parametrize("unseen", [True, False])
def test_after_bus_off_the_jets_stay_shut_until_the_request_is_raised_anew(bench, unseen):
    """Whether the ECU stepped while it was bus-off, or only finds that it has been."""
    bench.into_control()
    for _ in range(1 if unseen else 3):
        health = RECOVERED if unseen else OFF_NOW
        assert seen(step_with(bench, health, bench.pressure())) == SHUT
        assert (bench.status.reason, bench.status.bus_off) == (Reason.BUS_OFF, 1)
    found = [step_with(bench, RECOVERED, bench.pressure()) for _ in range(8)]
    assert [seen(command) for command in found] == [SHUT] * 8
    assert bench.status.reason == Reason.BUS_OFF
    step_with(bench, RECOVERED, bench.pressure(enable=False))
    command = step_with(bench, RECOVERED, bench.pressure())
    assert command.mode is Mode.CONTROL
    assert abs(command.flow_m2_per_s) <= STEP + FLOW_RESOLUTION_M2_PER_S
    assert bench.status.reason is Reason.NONE


def test_an_edge_while_bus_off_is_spent(bench):
    bench.into_control()
    for enable in (False,) * 6 + (True,) * 3:
        assert seen(step_with(bench, OFF_NOW, bench.pressure(enable=enable))) == SHUT
    assert step_with(bench, RECOVERED, bench.pressure()).mode is Mode.FAULT


def test_errors_short_of_bus_off_are_reported_and_borne(bench):
    bench.into_control()
    passive = BusHealth(state=BusState.ERROR_PASSIVE, tx_errors=200, rx_errors=130)
    command = step_with(bench, passive, bench.pressure())
    assert (command.mode, command.enable, bench.status.reason) == (Mode.CONTROL, True, Reason.NONE)
    assert (bench.status.tx_errors, bench.status.rx_errors, bench.status.bus_off) == (200, 130, 0)
    assert bench.ecu.trace.interventions == Intervention(0)
