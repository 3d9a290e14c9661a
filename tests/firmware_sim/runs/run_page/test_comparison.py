"""Runs next to each other, and the events of a run."""

from dataclasses import replace
from pathlib import Path

import pytest

from can_bridge.wire.messages import Mode, Reason
from contract.errors import StillwakeError
from firmware_sim.runs.metadata import InjectedFault
from firmware_sim.runs.run_page import run_data as listing
from firmware_sim.runs.run_page.report import differing, figure_rows, names_of
from firmware_sim.runs.run_page.run_data import MOST_EVENTS, disturbed, events


def test_names_are_as_long_as_it_takes_and_one_run_alone_is_not_compared():
    for paths, names in (("/x/a /x/b", "a b"), ("/x/new/run /x/old/run /x/old/other", "new/run old/run old/other")):
        assert names_of([Path(path) for path in paths.split()]) == names.split()
    with pytest.raises(StillwakeError, match="1 runs: between 2 and 6"):
        names_of([Path("a")])


def test_differences_are_against_the_first_run(shedding):
    # Known means: Cd 1.1 without control, and as given under it.
    rows = dict(figure_rows([shedding(0.88), shedding(0.99), shedding(0.88, averages=False)]))
    assert rows["mean Cd (wall), controlled"] == [("0.8800", ""), ("0.9900", "+0.1100"), ("\N{EN DASH}", "")]
    assert rows["less wall drag / %"] == [("20.00", ""), ("10.00", "-10.00"), ("\N{EN DASH}", "")]
    assert rows["periods in control"] == [("100", ""), ("100", "="), ("100", "=")]


def test_only_what_is_not_the_same_is_listed(shedding):
    one = shedding()
    assert differing([one, shedding(0.99)]) == []
    weights = replace(one.metadata.weights, lift=9.0)
    fault = InjectedFault(text="dead:sensor=base_0@4..", acted=3)
    other = shedding(weights=weights, faults=(fault,), settle=8.0)
    assert differing([one, other]) == [
        ("left out of the averages / t_c", ["4", "8"]),
        ("disturbances", ["none", "dead:sensor=base_0@4.."]),
        ("mpc.weights.lift", [f"{one.metadata.weights.lift}", "9.0"]),
    ]


def test_request_states_and_disturbances_are_listed_in_order(shedding):
    # A period is 20 ms; control is requested in period 60.
    faults = (
        InjectedFault(text="ecu:drop:probability=1@1.25..1.3", acted=3),
        InjectedFault(text="noise:level=1", acted=9),
    )
    log = shedding(modes={3: Mode.HOLD}, reasons={3: Reason.STREAM_LOST}, faults=faults)
    assert [tuple(event) for event in events(log)] == [
        (0, "set", "disturbed by noise:level=1"),
        (0, "state", "OFF: the jets are shut"),
        (60, "set", "control is requested"),
        (60, "state", "OFF to CONTROL: the jets follow the controller"),
        (63, "set", "disturbed by ecu:drop:probability=1"),
        (63, "state", "CONTROL to HOLD: no pressures arrived; the last command is held"),
        (64, "state", "HOLD to CONTROL: the jets follow the controller"),
        (65, "set", "no longer disturbed by ecu:drop:probability=1"),
    ]


def test_the_sensor_and_the_time_of_a_disturbance_are_known(shedding):
    for text, expected in {
        "dead:sensor=base_7@1.25..1.3": (("base_7", "dead"), 63, 65),
        "bias:level=2,sensor=upper_39": (("upper_39", "bias"), 0, 160),
        "swap:first=a,second=b@1..": (None, 50, 160),
        # At no time: it begins with the run.
        "reset@x..nan": (None, 0, 160),
    }.items():
        (one,) = disturbed(shedding(faults=(InjectedFault(text=text, acted=1),)))
        assert (one.sensor, one.first, one.after) == expected, text


def test_a_loop_that_flaps_ends_in_a_count(shedding, monkeypatch):
    monkeypatch.setattr(listing, "MOST_EVENTS", 10)
    found = events(shedding(modes=dict.fromkeys(range(1, 99, 2), Mode.HOLD)))
    assert len(found) == 10 < MOST_EVENTS
    # 1 request, and OFF, CONTROL, then 49 times HOLD and back.
    assert found[-1].text == f"and {1 + 2 + 98 - 9} events more"
