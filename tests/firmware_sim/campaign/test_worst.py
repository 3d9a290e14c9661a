"""The two that hurt most."""

from firmware_sim.campaign.worst import two_worst
from tests.firmware_sim.campaign.conftest import phase_of, rows_of, scenario_of


def made(name: str, group: str, Cd: float, in_control: int = 100, **fields):
    return scenario_of(name, group, **fields), [phase_of(Cd, in_control=in_control)]


def test_the_two_of_least_reduction_are_combined_from_two_groups() -> None:
    rows = rows_of(
        made("mild", "A", 0.85, disturb=("noise:level=0.1",)),
        made("bad", "B", 0.95, disturb=("gust:amplitude=0.1,period=20",), settings=("bus.background.load=0.9",)),
        made("worse", "A", 0.99, disturb=("noise:level=0.9",)),
        made("also_bad", "A", 0.97),
    )
    found = two_worst(rows)
    assert found is not None
    assert found.disturb == ("gust:amplitude=0.1,period=20", "noise:level=0.9")
    assert found.settings == ("bus.background.load=0.9",)
    assert "bad and worse" in found.sentence


def test_what_shut_the_jets_is_left_out() -> None:
    rows = rows_of(made("shut", "A", 1.2, in_control=10), made("one", "B", 0.9), made("two", "C", 0.95))
    found = two_worst(rows)
    assert found is not None
    assert "one and two" in found.sentence


def test_two_that_set_the_same_thing_do_not_go_together() -> None:
    rows = rows_of(
        made("twelve", "A", 0.99, settings=("vehicle.actuator_delay=12",)),
        made("four", "B", 0.98, settings=(" vehicle.actuator_delay = 4",)),
        made("mild", "C", 0.85),
    )
    found = two_worst(rows)
    assert found is not None
    assert "twelve and mild" in found.sentence


def test_without_two_groups_there_is_none() -> None:
    assert two_worst(rows_of(made("one", "A", 0.9), made("two", "A", 0.95))) is None
    assert two_worst(rows_of()) is None
