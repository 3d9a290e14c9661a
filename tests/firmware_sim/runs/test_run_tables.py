"""The tables and the headline of a run, and the summary that programs read."""

import json
from dataclasses import replace

import numpy as np
import pytest

from can_bridge.wire.messages import Mode, Reason
from firmware_sim.runs.run_tables import drag_rows, headline, service_rows
from firmware_sim.runs.summary import summary, whole_summary

FAULT = {
    "modes": dict.fromkeys(range(2, 100), Mode.FAULT),
    "reasons": dict.fromkeys(range(2, 100), Reason.DEADLINE),
}


def late(log, **vehicle):
    """The same run with other settings of the vehicle."""
    config = log.metadata.config
    return replace(log, metadata=replace(log.metadata, config=replace(config, **vehicle)))


def test_tables_show_the_figures(shedding):
    log = shedding()
    rows = {label: values for label, *values in drag_rows(log)}
    assert rows["mean Cd (wall)"] == ["1.1000", "0.8800"]
    assert rows["whole shedding cycles averaged"] == ["2", "3"]
    service = dict(service_rows(log))
    assert (service["plant"], service["control step computed by"]) == ("two numbers", "a test")
    assert (service["pressure frames and commands sent"], service["of these lost on the bus"]) == ("320", "1")
    assert service["of these rejected end to end"] == "2"
    assert service["steps without usable pressures (the first frame is always one)"] == "2"
    assert service["periods left out by the ECU (overruns)"] == "1"
    assert service["CRC errors"] == "3"
    assert service["bus load, all nodes"] == "31.2 %"
    assert service["frames on the bus, all nodes / error frames"] == "4321 / 7"
    assert service["longest wait for the bus"] == "Pressure 0.500 ms, JetCommand 1.250 ms"
    controllers = service["CAN controllers: state, TEC / REC / times bus-off"]
    assert controllers == "vehicle error-active 8 / 1 / 0, ECU error-passive 130 / 0 / 2"
    assert service["frames that the bus did not take"] == "3"
    assert service["sample to jets in virtual time, max"] == "8.30 ms"
    assert service["ECU fault"] == "none"
    assert service["cost weights"] == "the bundle's"


def test_the_budget_is_judged_in_virtual_time_and_on_this_machine(shedding):
    service = dict(service_rows(shedding()))
    assert service["virtual compute time"] == "8 ms of a period of 20 ms: fits"
    assert service["the same against the budget"].startswith("within 20 ms in 100 of 100 steps")
    ecu = replace(shedding().metadata.config.ecu, compute_time_ms=25.0)
    assert dict(service_rows(late(shedding(), ecu=ecu)))["virtual compute time"].endswith("20 ms: does not fit")


def test_weights_that_are_not_the_bundles_are_shown(shedding, run_metadata):
    log = shedding(weights=replace(run_metadata.weights, lift=9.0))
    assert dict(service_rows(log))["cost weights"] == "not the bundle's: lift 9 (bundle 0.01)"
    found = whole_summary(log)
    assert (found["weights"]["lift"], found["weights_changed"]) == (9.0, ["lift"])


def test_the_headline_judges_whether_a_reduction_counts(shedding):
    for cd, cl, contained in [
        (0.88, 0.1, ["20.0 % less, side force down (mean |Cl| 0.64 to 0.10)"]),
        # A mean of 0.16 or less is within what the phase of the cycle makes of it.
        (0.88, 0.2, ["20.0 % less, but the wake is deflected: mean Cl +0.00 to +0.20"]),
        (1.32, 0.1, ["20.0 % more"]),
    ]:
        for words in contained:
            assert words in headline(shedding(cd, cl)).replace("-0.00", "+0.00"), cd


def test_a_side_force_that_did_not_fall_is_not_a_deflected_wake(shedding):
    """Before: mean |Cl| 0.97 with a mean Cl of -0.01 was called deflected."""
    swinging = 1.2 * np.sin(2.0 * np.pi * np.arange(99) / 25.0)
    text = headline(shedding(Cl=swinging))
    assert "but the side force did not fall (mean |Cl| 0.64 to 0.76)" in text
    assert "deflected" not in text


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


def test_a_run_without_averages_says_so(shedding):
    log = shedding(averages=False)
    assert headline(log) == "No averages were asked for."
    assert drag_rows(log) == [("No averages were asked for.", "", "")]
    found = summary(log)
    assert found["Cd_controlled"] is None
    assert found["reduction_percent"] is None


def test_the_summary_holds_fault_counters_modes_settings_and_origin(shedding):
    found = json.loads(json.dumps(whole_summary(shedding(**FAULT)), allow_nan=False))
    assert found["headline"].startswith("ECU FAULT")
    assert found["fault"]["reason"] == "DEADLINE"
    assert (found["fault"]["t"], found["fault"]["period"]) == (pytest.approx(12.4), 62)
    assert found["modes"] == {"CONTROL": 2, "FAULT": 98}
    assert found["counters"] == {
        "overruns": 1, "missed": 2, "crc_errors": 3, "not_authentic": 0, "bus_off": 4, "frames_lost": 1,
            "frames_rejected": 2,
    }  # fmt: skip
    assert found["reduction_percent"] is None
    assert found["Cd_controlled"] == pytest.approx(0.88)
    assert found["settings"]["vehicle"] == {
        "actuator_delay": 0,
        "action_step": 0.075,
        "loss_window": 50,
        "loss_limit": 25,
    }
    assert found["settings"]["ecu"]["delay_steps"] == 0
    assert found["bundle"]["digest"] == "0123456789abcdef" * 4
    assert found["started_with"]["command"] == ["stillwake", "run", "a"]
    assert found["versions"] == {"python": "3.11"}


def test_the_summary_of_a_sound_run_has_no_fault(shedding):
    found = summary(shedding())
    assert (found["fault"], found["trouble"]) == (None, None)
    assert found["reduction_percent"] == pytest.approx(20.0, abs=1e-3)
    assert (found["cycles_uncontrolled"], found["cycles_controlled"]) == (2, 3)
    assert found["mpc_ms_p90"] == 2.0
