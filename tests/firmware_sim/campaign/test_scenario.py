"""A test plan as data."""

import pytest

from contract.errors import ConfigError
from firmware_sim.campaign.scenario import UNDISTURBED, Criteria, check_names, selected
from tests.firmware_sim.campaign.conftest import scenario_of


def test_names_and_criteria_that_cannot_be_are_refused() -> None:
    for name in ("", "Upper", "with space", "../up", ".hidden", "a/b", "x" * 81, "ünder", "a\n"):
        with pytest.raises(ConfigError, match="name"):
            scenario_of(name)
    # Those of runs without control are taken.
    for name in ("uncontrolled", "gust.uncontrolled"):
        with pytest.raises(ConfigError, match="without control"):
            scenario_of(name)
    for shares in (
        *({"useful": float("nan")}, {"useful": 0.1, "marginal": 0.2}, {"abs_Cl": 0.0}, {"marginal": float("inf")}),
    ):
        with pytest.raises(ConfigError, match=next(iter(shares))):
            Criteria(**shares)


def test_a_plan_has_each_name_once_and_the_undisturbed_scenario() -> None:
    undisturbed = scenario_of(UNDISTURBED)
    with pytest.raises(ConfigError, match=r"'twice'.*'here'.*'there'"):
        check_names([undisturbed, scenario_of("twice", "here"), scenario_of("twice", "there")])
    with pytest.raises(ConfigError, match=UNDISTURBED):
        check_names([scenario_of("alone")])


def test_a_pattern_selects_in_the_plans_order_and_keeps_the_undisturbed_one() -> None:
    plan = [scenario_of(name) for name in ("noise_0.1", UNDISTURBED, "gust", "noise_0.9")]
    names = [one.name for one in selected(plan, ["noise_0.9", "noise_0.1"])]
    assert names == ["noise_0.1", UNDISTURBED, "noise_0.9"]
    assert len(selected(plan, [])) == 4
    with pytest.raises(ConfigError, match=r"noize"):
        selected(plan, ["noize*"])
