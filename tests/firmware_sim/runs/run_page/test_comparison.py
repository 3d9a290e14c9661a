"""Runs next to each other: names that differ, differences, and settings that are not the same."""

from dataclasses import replace
from pathlib import Path

import pytest

from contract.errors import StillwakeError
from firmware_sim.runs.metadata import InjectedFault
from firmware_sim.runs.run_page.comparison import differing, figure_rows, names_of


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
