"""A test plan as data."""

import pytest

from contract.errors import ConfigError
from firmware_sim.campaign.scenario import UNDISTURBED, Criteria, check_names, selected


def test_a_name_that_is_no_files_name_is_refused(scenario) -> None:
    for name in ["", "Upper", "with space", "../up", ".hidden", "a/b", "x" * 81, "ünder", "a\n"]:
        with pytest.raises(ConfigError, match="name"):
            scenario(name)


def test_names_of_runs_without_control_are_taken(scenario) -> None:
    for name in ["uncontrolled", "gust.uncontrolled"]:
        with pytest.raises(ConfigError, match="without control"):
            scenario(name)


def test_criteria_that_make_no_sense_are_refused() -> None:
    for shares in [
        {"useful": float("nan")},
        {"useful": 0.1, "marginal": 0.2},
        {"abs_Cl": 0.0},
        {"marginal": float("inf")},
    ]:
        with pytest.raises(ConfigError, match=next(iter(shares))):
            Criteria(**shares)


def test_two_of_one_name_are_refused_with_both_places(scenario) -> None:
    with pytest.raises(ConfigError, match=r"'twice'.*'here'.*'there'"):
        check_names([scenario(UNDISTURBED), scenario("twice", "here"), scenario("twice", "there")])


def test_a_plan_needs_what_its_scenarios_are_held_against(scenario) -> None:
    with pytest.raises(ConfigError, match=UNDISTURBED):
        check_names([scenario("alone")])


def test_the_campaigns_own_name_is_taken(scenario) -> None:
    with pytest.raises(ConfigError, match="two_worst"):
        check_names([scenario(UNDISTURBED), scenario("two_worst")])


def test_a_pattern_selects_in_the_plans_order_and_keeps_the_undisturbed_one(scenario) -> None:
    plan = [scenario(name) for name in ("noise_0.1", UNDISTURBED, "gust", "noise_0.9")]
    names = [one.name for one in selected(plan, ["noise_0.9", "noise_0.1"])]
    assert names == ["noise_0.1", UNDISTURBED, "noise_0.9"]
    assert len(selected(plan, [])) == 4


def test_a_pattern_that_selects_nothing_is_an_error(scenario) -> None:
    with pytest.raises(ConfigError, match=r"noize"):
        selected([scenario(UNDISTURBED)], ["noize*"])
