"""Whether control was held, from modes and reasons set by hand."""

from dataclasses import replace

import numpy as np
import pytest

from can_bridge.wire.messages import Mode, Reason
from firmware_sim.runs.control import Fault, control, held_while_averaged, trouble
from firmware_sim.runs.statistics import Averages, averages


def averaged(log) -> np.ndarray:
    found = averages(log)
    assert isinstance(found, Averages)
    return found.averaged


def test_a_run_that_is_held_throughout(shedding):
    log = shedding()
    found = control(log)
    assert (found.requested, found.in_control, found.warm_up, found.fault) == (100, 100, 0, None)
    assert found.modes == {"CONTROL": 100}
    assert found.shut == 0.0
    assert found.held
    assert trouble(log) is None
    assert held_while_averaged(log, averaged(log))


def test_a_fault_is_named_with_reason_time_and_period(shedding):
    log = shedding(
        modes=dict.fromkeys(range(2, 100), Mode.FAULT), reasons=dict.fromkeys(range(2, 100), Reason.DEADLINE)
    )
    # The jets moved in three of the 99 samples after the request.
    log.series["action"][64:] = 0.0
    found = control(log)
    assert found.fault is not None
    assert found.fault.t == pytest.approx(12.4)
    assert replace(found.fault, t=12.4) == Fault(reason="DEADLINE", t=12.4, period=62, after_enable=2)
    assert not found.held
    assert trouble(log) == (
        "ECU FAULT: DEADLINE at t = 12.4 t_c, 2 periods after enable; the jets were shut for 97 % of the controlled "
        "time."
    )
    assert not held_while_averaged(log, averaged(log))


def test_two_keys_are_said_plainly(shedding):
    """OFF: no request of the vehicle's was ever authentic. FAULT: the other node's key was changed under way."""
    for mode in [Mode.OFF, Mode.FAULT]:
        log = shedding(modes=dict.fromkeys(range(100), mode), reasons=dict.fromkeys(range(100), Reason.NOT_AUTHENTIC))
        text = trouble(log) or ""
        assert text.startswith(
            "ECU FAULT: NOT_AUTHENTIC" if mode is Mode.FAULT else "CONTROL NOT HELD: in control 0 of 100"
        ), mode
        assert text.endswith("Frames came, but none was authentic: do both nodes have the same key (bus.key)?"), mode


def test_a_fault_that_was_cleared_is_still_one_and_one_before_the_request_is_none(shedding):
    log = shedding(modes={1: Mode.FAULT, 2: Mode.FAULT}, reasons={1: Reason.STREAM_LOST})
    assert (trouble(log) or "").startswith("ECU FAULT: STREAM_LOST at t = 12.2 t_c, 1 period after enable")
    log = shedding()
    log.series["mode"][:30] = Mode.FAULT
    assert trouble(log) is None


def test_periods_that_the_ecu_left_out_are_not_in_control(shedding):
    """With many deadline misses allowed no fault is latched, and the mode stays that of the step before."""
    log = shedding(skipped=range(1, 100, 2))
    assert control(log).modes == {"CONTROL": 50, "SKIPPED": 50}
    assert trouble(log) == "CONTROL NOT HELD: in control 50 of 100 periods (SKIPPED 50)."


def test_a_held_command_is_not_control(shedding):
    log = shedding(modes={7: Mode.HOLD, 8: Mode.DECAY})
    assert trouble(log) == "CONTROL NOT HELD: in control 98 of 100 periods (HOLD 1, DECAY 1)."
    # They lie in the settling time: what is averaged was under control.
    assert held_while_averaged(log, averaged(log))


def test_a_window_that_still_fills_at_the_request_is_no_trouble_unless_it_never_does(shedding):
    log = shedding(modes=dict.fromkeys(range(12), Mode.WARMUP))
    assert control(log).warm_up == 12
    assert trouble(log) is None
    never = shedding(modes=dict.fromkeys(range(100), Mode.WARMUP))
    expected = "NOT IN CONTROL: in control 0 of 100 periods; the controller's window was still filling at the end."
    assert trouble(never) == expected


def test_a_run_without_a_request_or_an_ecu_that_never_hears_it(shedding):
    log = shedding()
    log = replace(log, enabled_at=len(log.series["t"]))
    assert trouble(log) == "NOT IN CONTROL: control was not requested."
    # Computing for ever: OFF as of its only step.
    log = shedding(modes=dict.fromkeys(range(100), Mode.OFF), skipped=range(100), action=0.0)
    assert trouble(log) == "CONTROL NOT HELD: in control 0 of 100 periods (SKIPPED 100)."
    assert control(log).shut == 1.0
