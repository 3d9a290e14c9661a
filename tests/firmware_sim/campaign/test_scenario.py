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


def test_a_plan_has_each_name_once_and_a_pattern_keeps_the_undisturbed_one() -> None:
    undisturbed, twice = scenario_of(UNDISTURBED), [scenario_of("twice", place) for place in ("here", "there")]
    for plan, message in (([undisturbed, *twice], r"'twice'.*'here'.*'there'"), (twice[:1], UNDISTURBED)):
        with pytest.raises(ConfigError, match=message):
            check_names(plan)
    plan = [scenario_of("noise_0.1"), undisturbed, scenario_of("gust"), scenario_of("noise_0.9")]
    names = [one.name for one in selected(plan, ["noise_0.9", "noise_0.1"])]
    assert (names, selected(plan, [])) == (["noise_0.1", UNDISTURBED, "noise_0.9"], tuple(plan))
    with pytest.raises(ConfigError, match=r"noize"):
        selected(plan, ["noize*"])
