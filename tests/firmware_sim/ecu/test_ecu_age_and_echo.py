"""How old the pressures behind a command may be, and that its echo names the frame it rests on."""

from dataclasses import replace

import pytest

from can_bridge.command_gate import Intervention
from can_bridge.e2e.sender import SenderState
from can_bridge.wire.messages import Mode, Reason

MS = 1_000_000
WINDOW = 4


def aged(bench, age_ms: float, in_queue: bool, cp=(0.1, 0.2, 0.3, 0.4), **message):
    """A frame whose pressures are so old: by its own word, or because it waited in a queue."""
    age_ns = round(age_ms * MS)
    frame = bench.pressure(cp, age_ns=0 if in_queue else age_ns, **message)
    return replace(frame, timestamp_ns=max(0, bench.now_ns - age_ns)) if in_queue else frame


@pytest.fixture(autouse=True)
def _late_start(bench):
    """Late enough for frames that are older than their bench."""
    bench.now_ns = 10**10


@pytest.mark.parametrize("in_queue", [True, False])
@pytest.mark.parametrize(("age_ms", "usable"), [(0.0, True), (20.0, True), (30.0, True), (30.01, False), (60.0, False)])
def test_pressures_are_planned_on_for_a_period_and_a_half(bench, in_queue, age_ms, usable):
    bench.into_control()
    calls, missed = len(bench.controller.calls), bench.status.missed
    command = bench.step(aged(bench, age_ms, in_queue))
    assert (command.mode, command.enable) == (Mode.CONTROL if usable else Mode.HOLD, True)
    assert bench.status.reason is (Reason.NONE if usable else Reason.STALE)
    assert len(bench.controller.calls) - calls == usable
    assert bench.status.missed - missed == (not usable)


def test_pressures_of_the_future_are_stale(bench):
    bench.into_control()
    command = bench.step(replace(bench.pressure(), timestamp_ns=bench.now_ns + 1))
    assert (command.mode, bench.status.reason) == (Mode.HOLD, Reason.STALE)


def test_a_stale_request_is_a_request_all_the_same(bench):
    bench.into_control()
    command = bench.step(aged(bench, 90.0, True, enable=False))
    assert (command.mode, command.enable) == (Mode.OFF, False)


def test_frames_that_cannot_be_used_do_not_make_the_command_younger(bench_of):
    """Held on pressures of an age of 25 ms, with fresh frames of an invalid sensor: shut when the old are 80 ms."""
    bench = bench_of(hold_periods=3, decay_periods=0)
    bench.now_ns = 10**10
    bench.into_control()
    assert bench.step(aged(bench, 25.0, True)).enable
    found = []
    for _ in range(3):
        command = bench.step(bench.pressure(valid=(True, True, True, False)))
        found.append((command.mode, command.enable, bench.status.reason))
    # At 45, 65 and 85 ms.
    held = (Mode.HOLD, True, Reason.SENSOR_INVALID)
    assert found == [held, held, (Mode.HOLD, False, Reason.STALE)]
    assert bench.ecu.trace.interventions == Intervention.STALE
    assert bench.step(bench.pressure()).mode is Mode.CONTROL
    assert bench.status.reason is Reason.NONE


def test_the_echo_is_of_the_newest_usable_frame(bench):
    commands = bench.good(3)
    # The first frame of all makes the stream known and is not used.
    assert [command.pressure_counter for command in commands] == [None, 1, 2]


def test_while_a_command_is_held_the_echo_is_of_the_frame_behind_it(bench):
    bench.into_control()
    behind = bench.step(bench.pressure()).pressure_counter
    assert behind == WINDOW + 1
    # An invalid sensor, a stale frame, a jump of the counter: each arrives, none is used.
    found = [bench.step(bench.pressure(valid=(False,) * 4)), bench.step(aged(bench, 50.0, True))]
    bench.sender.state = SenderState(counter=bench.sender.state.counter + 100)
    found.append(bench.step(bench.pressure()))
    assert [(command.mode, command.enable) for command in found] == [
        (Mode.HOLD, True),
        (Mode.DECAY, True),
        (Mode.DECAY, True),
    ]
    assert {command.pressure_counter for command in found} == {behind}
    # No frame is behind a command of zero that comes of none.
    assert bench.step().pressure_counter is None
    assert bench.step().pressure_counter is None
