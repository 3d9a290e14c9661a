"""Figures of the release over its phases: what the jets cost, and the spread."""

import pytest

from benchmarks.release.release_loop import FIGURES, SPANS, spread, with_net

RUN = dict.fromkeys(FIGURES, 1.0) | {
    "Cd_net_uncontrolled": 1.25,
    "Cd_net_controlled": 0.75,
    "jet_power_controlled": 0.25,
}


def test_the_jets_power_is_paid_from_the_reduction() -> None:
    found = with_net(RUN)
    assert found["net_reduction_percent"] == pytest.approx(40.0)
    # 0.5 less force, of which 0.25 goes into the jets.
    assert found["net_of_power_percent"] == pytest.approx(20.0)


def test_the_spread_has_mean_least_and_most_and_no_figure_that_a_phase_lacks() -> None:
    rows = [{**RUN, "abs_Cl_controlled": value, "reduction_percent": value} for value in (0.1, 0.4, 0.1)]
    rows[1]["reduction_percent"] = None  # type: ignore[assignment]
    found = spread(rows)
    assert found["abs_Cl_controlled"] == pytest.approx({"mean": 0.2, "least": 0.1, "most": 0.4})
    assert set(found) == set(FIGURES) - {"reduction_percent"}


def test_the_runs_are_as_long_as_those_of_the_command() -> None:
    assert (SPANS.lead_in, SPANS.controlled, SPANS.controlled - SPANS.settle) == (25.0, 100.0, 60.0)
