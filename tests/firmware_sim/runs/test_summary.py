"""What is said of a run: tables, headline, the summary that programs read, whether control was held, and its film."""

import json
from dataclasses import replace

import numpy as np
import pytest

from can_bridge.wire.messages import Mode, Reason
from contract.errors import ConfigError
from examples.film_of_a_run import story_of
from firmware_sim.runs.control import LatchedFault, control, held_while_averaged, mode_spans, trouble
from firmware_sim.runs.run_page.run_data import events
from firmware_sim.runs.summary import drag_rows, headline, service_rows, summary, whole_summary
from tests.firmware_sim.runs.conftest import averaged

FAULT = {"modes": dict.fromkeys(range(2, 100), Mode.FAULT), "reasons": dict.fromkeys(range(2, 100), Reason.DEADLINE)}


def test_tables_show_the_figures(shedding):
    log = shedding()
    rows = {label: values for label, *values in drag_rows(log)}
    assert rows["mean Cd (wall)"] == ["1.1000", "0.8800"]
    assert rows["whole shedding cycles averaged"] == ["2", "3"]
    service = dict(service_rows(log))
    for name, text in {
        "pressure frames and commands sent": "320",
        "of these lost on the bus": "1",
        "of these rejected end to end": "2",
        "CRC errors": "3",
        "longest wait for the bus": "Pressure 0.500 ms, JetCommand 1.250 ms",
        "frames that the bus refused": "3",
        "sample to jets in virtual time, max": "8.30 ms",
        "virtual compute time": "8 ms of a period of 20 ms: fits",
    }.items():
        assert service[name] == text, name
    assert service["the same against the budget"].startswith("within 20 ms in 100 of 100 steps")
    config = log.metadata.config
    slow = replace(log.metadata, config=replace(config, ecu=replace(config.ecu, compute_time_ms=25.0)))
    assert dict(service_rows(replace(log, metadata=slow)))["virtual compute time"].endswith("20 ms: does not fit")


def test_the_headline_judges_whether_a_reduction_counts(shedding):
    # Before: mean |Cl| 0.97 with a mean Cl of -0.01 was called deflected.
    swinging = 1.2 * np.sin(2.0 * np.pi * np.arange(99) / 25.0)
    for cd, cl, words in (
        (0.88, 0.1, "20.0 % less, side force down (mean |Cl| 0.64 to 0.10)"),
        # A mean of 0.16 or less is within what the phase of the cycle makes of it.
        (0.88, 0.2, "20.0 % less, but the wake is deflected: mean Cl +0.00 to +0.20"),
        (1.32, 0.1, "20.0 % more"),
        (0.88, swinging, "but the side force did not fall (mean |Cl| 0.64 to 0.76)"),
    ):
        text = headline(shedding(cd, cl)).replace("-0.00", "+0.00")
        assert words in text, words
        assert ("deflected" in text) == ("deflected" in words), words


def test_a_sensor_set_aside_and_too_few_cycles_are_in_the_headline(shedding):
    log = shedding()
    assert "set aside" not in headline(log) and "Too short" not in headline(log)
    log.series["set_aside"][70:90] = 0b10
    name = log.metadata.sensors[1]
    assert f"The ECU set aside {name} from t = 14.0 t_c on." in headline(log)
    assert summary(log)["set_aside"] == [{"sensor": name, "t": pytest.approx(14.0)}]
    assert (70, "state", f"{name} is set aside: it contradicts the others, and is estimated from them") in events(log)
    # A settling time that leaves one cycle of 5 t_c.
    assert "Too short to judge by: cycles averaged 1, at least 2 are needed." in headline(shedding(settle=12.0))


def test_trouble_comes_first_and_a_reduction_that_was_not_under_control_is_not_claimed(shedding):
    fault = shedding(**FAULT)
    assert headline(fault).startswith("ECU FAULT: DEADLINE at t = 12.4 t_c, 2 periods after enable;")
    assert headline(fault).endswith("no reduction is claimed: in control 2 of 100 periods.")
    assert service_rows(fault)[0] == ("ECU fault", "DEADLINE at t = 12.4 t_c, 2 periods after enable")
    lost = "CONTROL NOT HELD: in control 99 of 100 periods (HOLD 1). Wall drag 1.100 to 0.880"
    # While averaging, and while settling.
    assert headline(shedding(modes={60: Mode.HOLD})).startswith(f"{lost}; no redu")
    assert headline(shedding(modes={3: Mode.HOLD})).startswith(f"{lost}: 20.0 % l")
    # Before: command_step = 1e-5 gave a reduction of 1.63 %.
    assert "no reduction is claimed: the jets hardly moved (rms action 1e-05)" in headline(shedding(action=1e-5))


def test_the_summary_holds_fault_counters_modes_settings_and_origin(shedding):
    figures = json.loads(json.dumps(whole_summary(shedding(**FAULT)), allow_nan=False))
    assert figures["headline"].startswith("ECU FAULT")
    fault = figures["fault"]
    assert (fault["reason"], fault["t"], fault["period"]) == ("DEADLINE", pytest.approx(12.4), 62)
    assert figures["modes"] == {"CONTROL": 2, "FAULT": 98}
    assert [figures["counters"][name] for name in ("overruns", "bus_off", "frames_rejected")] == [1, 4, 2]
    assert (figures["reduction_percent"], figures["Cd_controlled"]) == (None, pytest.approx(0.88))
    assert figures["started_with"]["command"] == ["stillwake", "run", "a"]
    # Of a sound run, and of one without averages.
    figures = summary(shedding())
    assert (figures["fault"], figures["trouble"]) == (None, None)
    assert figures["reduction_percent"] == pytest.approx(20.0, abs=1e-3)
    assert [figures[name] for name in ("cycles_uncontrolled", "cycles_controlled", "mpc_ms_p90")] == [2, 3, 2.0]
    log = shedding(averages=False)
    assert headline(log) == "No averages were requested."
    assert drag_rows(log) == [("No averages were requested.", "", "")]
    assert summary(log)["Cd_controlled"] is summary(log)["reduction_percent"] is None


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


def test_it_begins_before_control_and_counts_from_the_drag_there_or_is_refused(shedding, log_of) -> None:
    log = shedding(Cd=0.8, Cl=0.0)
    story = story_of(log)
    # Control is requested at 12 t_c; the run ends 20 t_c later.
    control = log.series["t"][60]
    assert (story.begin, story.drag_before) == pytest.approx((control - 11.0, 1.1))
    assert (story.control, story.end) == (control, log.series["t"][-1])
    asked = story_of(log, begin=control - 2.0, end=control + 3.0)
    assert (asked.begin, asked.end) == (control - 2.0, control + 3.0)
    with pytest.raises(ConfigError, match="does not show the beginning of control"):
        story_of(log, begin=log.series["t"][61])
    for enabled_at in (0, 6):
        with pytest.raises(ConfigError, match="must begin without control and continue with control"):
            story_of(log_of(enabled_at=enabled_at))
