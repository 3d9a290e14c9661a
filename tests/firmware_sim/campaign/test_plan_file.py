"""Test plans from TOML: the built-in one, a user's, and the error of one that is wrong."""

from collections import Counter
from dataclasses import replace

import pytest

from contract.errors import ConfigError
from firmware_sim.campaign.scenario import UNDISTURBED, Criteria, check_names, read_plan, selected, whole_plan
from tests.firmware_sim.campaign.conftest import scenario_of

OWN = """
[criteria]
useful = 0.5

[[group]]
title = "Mine"

[[group.scenario]]
name = "late_{each}"
each = [1, 2.5]
sentence = "It is {each} late."
disturb = ["noise:level={each}@{after:20}..{after:22.5}"]
set = ["ecu.delay_steps=2"]

[[group.scenario]]
name = "each_{each}"
each = "sensors"
sentence = "{each}, {base_sensor} and {sensor_2}, for {seconds:20} s."
criteria = { useful = 1, marginal = 0.25 }
"""


@pytest.fixture
def written(tmp_path):
    def write(text: str | bytes):
        path = tmp_path / "plan.toml"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return write


def test_an_entry_stands_for_a_scenario_a_value(written, place) -> None:
    first, second, *sensors = read_plan(written(OWN), place)
    assert (first.name, first.sentence, first.group) == ("late_1", "It is 1 late.", "Mine")
    # Control is asked for at 0.7 s, and 20 t_c are 2 s.
    assert first.disturb == ("noise:level=1@2.7..2.95",)
    assert first.settings == ("ecu.delay_steps=2",)
    assert second.name == "late_2.5"
    assert first.criteria == Criteria(useful=0.5)
    assert [one.name for one in sensors] == ["each_upper_39", "each_lower_39", "each_base_0", "each_base_9"]
    assert sensors[0].sentence == "upper_39, base_0 and lower_39, for 2 s."
    assert sensors[0].criteria == Criteria(useful=1.0, marginal=0.25)


def test_the_built_in_plan_comes_first_and_each_delay_differs_in_the_compensation_alone(written, place) -> None:
    plan = whole_plan([], place)
    for delay in (2, 4, 8, 12):
        (compensated,) = (one for one in plan if one.name == f"delay_{delay}")
        (uncompensated,) = (one for one in plan if one.name == f"delay_{delay}_uncompensated")
        assert set(compensated.settings) - set(uncompensated.settings) == {f"ecu.delay_steps={delay}"}
    assert plan[0].name == "undisturbed"
    assert max(Counter(one.sentence for one in plan).values()) == 1
    both = whole_plan([written(OWN)], place)
    assert both[: len(plan)] == plan
    assert [one.group for one in both[len(plan) :]] == ["Mine"] * 6


def test_a_wrong_file_is_one_line_that_names_file_and_field(written, place) -> None:
    for text, message in [
        ("[[group]\n", r"plan\.toml: "),
        (b"\xff\xfe", "UTF-8"),
        ("", "group"),
        ("[[group]]\ntitle = 'x'\n", "scenario"),
        (OWN.replace('sentence = "It', 'sentense = "It'), r"'late_\{each\}'.*sentense is unknown"),
        (OWN.replace("each = [1, 2.5]", "each = 'wheels'"), r"'late_\{each\}'.*each = 'wheels'"),
        (OWN.replace("each = [1, 2.5]", "each = []"), "each"),
        (OWN.replace("disturb = [", "disturb = [3, "), r"'late_\{each\}'.*disturb"),
        (OWN.replace("useful = 0.5", "useful = 'much'"), r"criteria\.useful = 'much'"),
        (OWN.replace("useful = 1,", "useful = nan,"), r"'each_\{each\}'.*useful"),
        (OWN.replace("useful = 1,", "useful = 60,"), r"useful = 60: must be between marginal \(0.25\) and 1"),
        (OWN.replace("{after:20}", "{before:20}"), r"'late_\{each\}'.*\{before\}"),
        (OWN.replace("{after:20}", "{after:soon}"), "soon"),
        (OWN.replace("{after:20}", "{after"), "cannot be filled in"),
        (OWN.replace("late_{each}", "Late {each}"), "lower-case"),
    ]:
        with pytest.raises(ConfigError, match=message) as raised:
            read_plan(written(text), place)
        line = str(raised.value)
        assert "plan.toml: " in line, text
        assert "\n" not in line, text
    with pytest.raises(ConfigError, match=r"nowhere\.toml: No such file"):
        read_plan(written(OWN).with_name("nowhere.toml"), place)
    with pytest.raises(ConfigError, match=r"\{base_sensor\}"):
        read_plan(written(OWN), replace(place, base_sensor=None))


def test_names_and_criteria_that_cannot_be_are_refused() -> None:
    for name in ("", "Upper", "with space", "../up", ".hidden", "a/b", "x" * 81, "ünder", "a\n"):
        with pytest.raises(ConfigError, match="name"):
            scenario_of(name)
    # Those of runs without control are taken.
    for name in ("uncontrolled", "gust.uncontrolled"):
        with pytest.raises(ConfigError, match="without control"):
            scenario_of(name)
    for shares in ({"useful": 0.1, "marginal": 0.2}, {"abs_Cl": 0.0}, {"marginal": float("inf")}):
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
