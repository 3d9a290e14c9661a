"""Whether control was held, from modes and reasons set by hand."""

from dataclasses import replace

from can_bridge.wire.messages import Mode, Reason
from firmware_sim.runs.control import LatchedFault, control, held_while_averaged, mode_spans, trouble
from tests.firmware_sim.runs.conftest import averaged


def test_a_fault_is_named_with_reason_time_and_period(shedding):
    late = range(2, 100)
    log = shedding(modes=dict.fromkeys(late, Mode.FAULT), reasons=dict.fromkeys(late, Reason.DEADLINE))
    # The jets moved in three of the 99 samples after the request.
    log.series["action"][64:] = 0.0
    fault = LatchedFault(reason="DEADLINE", t=float(log.series["t"][62]), period=62, after_enable=2)
    shut = "the jets were shut for 97 % of the controlled time."
    assert control(log).fault == fault
    assert trouble(log) == f"ECU FAULT: DEADLINE at t = 12.4 t_c, 2 periods after enable; {shut}"
    assert not held_while_averaged(log, averaged(log).averaged)
    # One that was cleared is still one, and one before the request is none.
    log = shedding(modes={1: Mode.FAULT, 2: Mode.FAULT}, reasons={1: Reason.STREAM_LOST})
    assert (trouble(log) or "").startswith("ECU FAULT: STREAM_LOST at t = 12.2 t_c, 1 period after enable")
    log = shedding()
    log.series["mode"][:30] = Mode.FAULT
    assert trouble(log) is None


def test_periods_that_are_left_out_held_or_still_warm_up_are_not_in_control(shedding):
    # With many deadline misses allowed no fault is latched, and the mode stays that of the step before.
    log = shedding(skipped=range(1, 100, 2))
    assert control(log).modes == {"CONTROL": 50, "SKIPPED": 50}
    assert trouble(log) == "CONTROL NOT HELD: in control 50 of 100 periods (SKIPPED 50)."
    assert mode_spans(shedding(modes={3: Mode.HOLD}, skipped=[5, 6])) == [
        *(("OFF", 0, 60), ("CONTROL", 60, 63), ("HOLD", 63, 64), ("CONTROL", 64, 65), ("SKIPPED", 65, 67)),
        ("CONTROL", 67, 160),
    ]
    log = shedding(modes={7: Mode.HOLD, 8: Mode.DECAY})
    assert trouble(log) == "CONTROL NOT HELD: in control 98 of 100 periods (HOLD 1, DECAY 1)."
    # They lie in the settling time: what is averaged was under control.
    assert held_while_averaged(log, averaged(log).averaged)
    # A window that still fills at the request is no trouble unless it never does.
    log = shedding(modes=dict.fromkeys(range(12), Mode.WARMUP))
    assert (control(log).warm_up, trouble(log)) == (12, None)
    never = shedding(modes=dict.fromkeys(range(100), Mode.WARMUP))
    expected = "NOT IN CONTROL: in control 0 of 100 periods; the controller's window was still filling at the end."
    assert trouble(never) == expected
    # A vehicle too fast for its release, for a while or throughout; control that is tested.
    for periods, text in ((9, "91 of 100 periods (WARMUP 9, of these OFF_SPEED 9)."), (99, "is for.")):
        slow = {k: Mode.WARMUP for k in range(100 - periods, 100)}
        off = shedding(modes={0: Mode.WARMUP} | slow if periods == 99 else slow, reasons=dict.fromkeys(slow, 17))
        assert (trouble(off) or "").endswith(text), periods
    tested = shedding(modes=dict.fromkeys((60, 61), Mode.WARMUP), reasons=dict.fromkeys((60, 61), Reason.NOT_HELPING))
    assert (trouble(tested) or "").endswith("(WARMUP 2, of these NOT_HELPING 2).")


def test_what_holds_no_control_at_all_has_its_reason(shedding):
    log = shedding()
    assert trouble(replace(log, enabled_at=len(log.series["t"]))) == "NOT IN CONTROL: control was not requested."
    # Computing for ever: OFF as of its only step.
    log = shedding(modes=dict.fromkeys(range(100), Mode.OFF), skipped=range(100), action=0.0)
    assert (control(log).shut, control(log).modes) == (1.0, {"SKIPPED": 100})
    # Frames of another key.
    log = shedding(modes=dict.fromkeys(range(100), Mode.OFF), reasons=dict.fromkeys(range(100), Reason.NOT_AUTHENTIC))
    assert (trouble(log) or "").endswith("do both nodes have the same key (bus.key)?")
