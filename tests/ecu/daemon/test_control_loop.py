"""The loop on a bus: when it steps, and what becomes of a late, a lost, and a contested bus."""

import gc

import can
import numpy as np
import pytest

from can_bridge.e2e.profiles import E2eSender
from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from can_bridge.wire.messages import JetCommand, Mode, Reason
from contract import sensors
from contract.config.tree import Config
from ecu.real_time.deadlines import wrapped
from ecu.real_time.stage_times import EcuStage
from ecu.shut_ecu import ShutEcu
from tests.ecu.daemon.conftest import START_NS, wait_for

PERIOD = Config().period_ns
MS = 1_000_000


@pytest.fixture
def slow(rig):
    """A rig whose controller spends its time `takes_ns` where it plans."""
    rig.takes_ns = 0

    def plan(step: int) -> float:
        rig.now += rig.takes_ns if step == 0 else 0
        return 0.01

    rig.controller.plan = plan
    return rig


@pytest.mark.parametrize("behind_ms", [1, 10])
def test_frames_of_a_stranger_do_not_move_the_steps(rig, behind_ms):
    """Pressures that fail their check, just behind the vehicle's or halfway between two, in place of every other."""
    rig.into_control()
    rig.run(20)
    before = wrapped(rig.column(EcuStage.SCHEDULED)[-1], PERIOD)
    forged = Frame(frame_id=PRESSURE.frame_id, data=bytes(PRESSURE.length))
    for number in range(40):
        rig.delay = (lambda number: None) if number % 2 else (lambda number: 0)
        rig.pending.append((rig.next_sample + behind_ms * MS, forged))
        rig.run(1)
    assert wrapped(rig.column(EcuStage.SCHEDULED)[-1], PERIOD) == before


def test_a_step_that_takes_too_long_leaves_periods_out_and_is_not_made_up_for(slow):
    slow.into_control()
    steps, due = slow.loop.counters.steps, slow.column(EcuStage.SCHEDULED)[-1]
    slow.takes_ns = 50 * MS
    slow.run(1)
    slow.takes_ns = 0
    slow.run(10)
    assert (slow.loop.counters.left_out, slow.loop.counters.steps) == (2, steps + 11)
    scheduled = slow.column(EcuStage.SCHEDULED)[-11:]
    assert (scheduled[0] - due, scheduled[1] - scheduled[0]) == (PERIOD, 3 * PERIOD)
    assert set(np.diff(scheduled[1:])) == {PERIOD}
    assert slow.statuses[-1].overruns == 2


def test_each_stage_is_noted(slow):
    slow.takes_ns = 6 * MS
    slow.into_control()
    # Until the steps lie where they are to.
    slow.run(20)
    row = dict(zip((stage.name for stage in EcuStage), slow.stages.rows()[-1].tolist(), strict=True))
    sampled = row["FRAME_ARRIVED"]
    assert wrapped(sampled - START_NS - 3 * MS, PERIOD) == 0
    assert row["SCHEDULED"] == row["WOKE"] == row["STEP_BEGAN"] == row["PLAN_BEGAN"] == sampled + 4 * MS
    assert row["PLAN_ENDED"] == row["STEP_ENDED"] == row["SENT"] == sampled + 10 * MS
    assert row["PERIOD"] == len(slow.stages.rows()) - 1
    # The counter of the DBC: what the command echoes.
    assert row["PRESSURE_COUNTER"] == slow.commands[-1].pressure_counter
    # Before control there is no plan.
    assert slow.column(EcuStage.PLAN_BEGAN)[0] == 0


def test_another_ecu_on_the_bus_shuts_the_jets(rig):
    rig.into_control()
    other = E2eSender(JET_COMMAND)
    command = JetCommand(flow_m2_per_s=1.0, mode=Mode.CONTROL, enable=True, pressure_counter=3, next_period=True)
    content = codec.emit_jet_command(command)
    for number in range(40):
        # An edge does not arm while it is there.
        rig.request = number % 20 > 3
        rig.pending.append((rig.next_sample + MS, other.frame(content, now_ns=rig.now)))
        rig.run(1)
    assert rig.events.count("other_ecu") == 1
    assert {(c.mode, c.enable, c.flow_m2_per_s) for c in rig.commands[-38:]} == {(Mode.FAULT, False, 0.0)}
    assert (rig.statuses[-1].reason, rig.loop.counters.state.other_ecu.frames) == (Reason.OTHER_ECU, 40)
    # Its silence alone gives nothing back.
    rig.run(100)
    assert rig.events.count("other_ecu_gone") == 1
    modes = [rig.commands[-1].mode]
    rig.request = False
    rig.run(2)
    rig.request = True
    rig.run(8)
    assert [*modes, rig.commands[-1].mode] == [Mode.FAULT, Mode.CONTROL]


def test_a_lost_bus_is_logged_opened_again_and_gives_no_control_back_by_itself(rig):
    rig.into_control()
    rig.opened[-1].shutdown()
    wait_for(lambda: not rig.hears)
    rig.loop.period()
    assert rig.events[-2:] == ["bus_lost", "mode"]
    state = rig.ecu.state
    assert (state.fail_safe.mode.on_wire, state.fail_safe.reason) == (Mode.FAULT, Reason.BUS_OFF)
    assert rig.ecu.trace.action == 0.0
    wait_for(lambda: len(rig.opened) == 2)
    # The thread that opened it hands it over after that.
    wait_for(lambda: not rig.connection._opener.is_alive())
    rig.run(40)
    assert rig.events.count("bus_back") == 1
    assert (rig.statuses[-1].state, rig.statuses[-1].bus_off) == (Mode.FAULT, 1)
    assert not any(command.enable for command in rig.commands[-30:])
    assert rig.actions[-1] == 0.0
    rig.request = False
    rig.run(2)
    rig.request = True
    rig.run(8)
    assert rig.commands[-1].mode is Mode.CONTROL


def test_the_last_counters_are_of_shut_jets(rig):
    told = []
    rig.loop._after_step = lambda now_ns, counters: told.append(counters)
    rig.into_control()
    before = told[-1]
    rig.loop.shut()
    assert before.action != 0.0 == told[-1].action
    assert told[-1].state.fail_safe.mode.on_wire is Mode.OFF
    assert (told[-1].steps, told[-1].state.missed) == (before.steps, before.state.missed)


def test_sound_pressures_that_cannot_be_used_are_not_said_to_be_of_another_dbc(rig):
    sample = rig.vehicle.node.sample
    rig.vehicle.node.sample = lambda cp, **of: sample(np.full(sensors.COUNT, np.nan), **of)
    rig.run(120)
    reasons = [rig.statuses[-1].reason]
    rig.loop._ecu = ShutEcu(rig.config)
    rig.run(120)
    assert [*reasons, rig.statuses[-1].reason] == [Reason.SENSOR_INVALID, Reason.NO_RELEASE]
    assert "heard" not in rig.events
    rig.delay = lambda number: None
    rig.run(120)
    assert rig.events.count("heard") == 1


def test_frames_that_the_bus_does_not_take_are_counted_and_the_loop_goes_on(rig, monkeypatch):
    rig.into_control()

    def refuse(message, timeout=None):
        raise can.CanOperationError("no buffer space")

    monkeypatch.setattr(rig.opened[-1], "send", refuse)
    rig.run(3)
    assert (rig.loop.counters.not_sent, rig.column(EcuStage.SENT)[-3:]) == (6, [0, 0, 0])
    assert "no buffer space" in rig.connection.why_not_sent


def test_steps_make_no_garbage_that_needs_collecting(rig):
    """The collector is off for as long as the ECU runs: what only it could free would pile up."""
    rig.into_control()
    gc.collect()
    gc.disable()
    left = []
    try:
        for delay in (rig.delay, lambda number: None):
            rig.delay = delay
            for _ in range(3):
                rig.run(10)
                left.append(gc.collect())
    finally:
        gc.enable()
    # What steps leave comes every time; what other threads of the test's process leave does not.
    assert (min(left[:3]), min(left[3:])) == (0, 0)
