"""Clocks that stand, jump and go back, steps that come late or early, and a CAN controller that was bus-off."""

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.command_gate import Intervention
from can_bridge.wire import codec
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import Config
from tests.each import each

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


@each("back_ns", [0, 1, 200 * MS, 10**10, 11 * 24 * 3600 * 10**9])
def test_a_clock_that_stands_or_goes_back_shuts_the_jets_and_latches(bench_of, back_ns):
    bench = bench_of()
    bench.now_ns = 10**16
    bench.into_control()
    assert seen(step_after(bench, -back_ns)) == SHUT
    assert bench.status.reason is Reason.CLOCK
    assert bench.status.overruns == 0
    # Good frames in the new time, then an edge; the window is filled anew.
    assert {command.mode for command in bench.good(8)} == {Mode.FAULT}
    assert bench.good(1, enable=False)[0].mode is Mode.FAULT
    assert bench.good(1)[0].mode is Mode.CONTROL


@each("elapsed_ms", [1, 5, 9, 10, 15])
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


def step_with(bench, health: BusHealth, *frames):
    answers = bench.ecu.step(bench.now_ns, frames, health)
    bench.now_ns += bench.config.period_ns
    bench.status = codec.parse_ecu_status(answers[1].data)
    command = codec.parse_jet_command(answers[0].data)
    assert command is not None
    return command


OFF_NOW = BusHealth(state=BusState.BUS_OFF, tx_errors=256, bus_off=1)
RECOVERED = BusHealth(bus_off=1)


@each("unseen", [True, False])
def test_after_bus_off_the_jets_stay_shut_until_the_request_is_raised_anew(bench_of, unseen):
    """Whether the ECU stepped while it was bus-off, or only finds that it has been."""
    bench = bench_of()
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
