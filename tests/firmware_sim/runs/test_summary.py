"""The tables and the headline of a run, and the summary that programs read."""

import json
from dataclasses import replace

import numpy as np
import pytest

from can_bridge.wire.messages import Mode, Reason
from firmware_sim.runs.run_page.run_data import events
from firmware_sim.runs.summary import drag_rows, headline, service_rows, summary, whole_summary

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
