"""The tables and the headline of a run."""

import pytest

from can_bridge.wire.messages import Mode
from firmware_sim.runs.tables import drag_rows, headline, service_rows

NAN = float("nan")


def test_tables_show_the_figures(log_of):
    log = log_of(
        Cd=[1.0, 1.2, 9.0, 9.0, 0.8, 0.9],
        Cl=[-1.0, 1.0, 9.0, 9.0, 0.1, -0.1],
        mode=[Mode.CONTROL] * 6,
        step_ms=[2.0] * 6,
        age_ms=[NAN, 8.3, 8.4, 8.3, NAN, NAN],
    )
    assert ("mean Cd (wall)", "1.1000", "0.8500") in drag_rows(log)
    service = dict(service_rows(log))
    assert (service["plant"], service["control step computed by"]) == ("two numbers", "a test")
    assert service["frames sent"] == "12"
    assert service["frames lost"] == "1"
    assert service["frames rejected"] == "2"
    assert service["sample to jets in virtual time, max"] == "8.40 ms"
    assert service["periods in control / in all"] == "6 / 6"


@pytest.mark.parametrize(
    ("cd", "cl", "contained"),
    [
        (0.88, 0.1, ["22.7 % less", "side force down"]),
        (0.88, 2.0, ["22.7 % less", "but the wake is deflected"]),
        (1.32, 0.1, ["20.0 % more"]),
    ],
)
def test_the_headline_judges_whether_a_reduction_counts(log_of, cd, cl, contained):
    before = 1.1 if cd > 1.0 else 1.138
    log = log_of(Cd=[before, before, 9.0, 9.0, cd, cd], Cl=[-1.0, 1.0, 9.0, 9.0, cl, cl])
    for words in contained:
        assert words in headline(log)


def test_a_run_without_controlled_time_has_no_headline(log_of):
    assert "too short" in headline(log_of(settle=50.0, Cd=[1.0] * 6))
