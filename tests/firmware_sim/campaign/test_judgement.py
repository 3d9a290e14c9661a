"""What came of a campaign: worked out on paper."""

import json
from math import isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.campaign.judgement import Use, two_worst, use_of
from firmware_sim.campaign.scenario import Criteria
from tests.firmware_sim.campaign.conftest import phase_of, rows_of, scenario_of

numbers = st.floats(-200, 200)


def test_reduction_and_use_follow_their_criteria_over_all_phases() -> None:
    for Cd, abs_Cl, use in [
        # Undisturbed there is 20 % less: three quarters of it are 15 %.
        (0.85, 0.2, Use.USEFUL),
        (0.86, 0.2, Use.MARGINAL),
        (0.99, 0.2, Use.MARGINAL),
        (1.00, 0.2, Use.NONE),
        (1.10, 0.2, Use.NONE),
        # Without control |Cl| is 0.9: less drag with more side force is not useful.
        (0.80, 0.91, Use.MARGINAL),
        (0.80, 0.90, Use.USEFUL),
    ]:
        _, row = rows_of((scenario_of("one"), [phase_of(Cd, abs_Cl=abs_Cl)] * 2))
        assert row.use == use, Cd
    strict = scenario_of("one", criteria=Criteria(useful=1.2))
    assert rows_of((strict, [phase_of()]))[1].use == Use.MARGINAL
    # Nothing is useful next to a loop that reduces nothing.
    rows = rows_of((scenario_of("one"), [phase_of(0.5)]), undisturbed=[phase_of(1.0)])
    assert [row.use for row in rows] == [Use.NONE, Use.NONE]
    # Against the same phase, spread over them; time in control and reasons are of all.
    _, row = rows_of((scenario_of("one"), [phase_of(0.9, in_control=50, latches=2), phase_of(0.7)]))
    assert (row.reduction.mean, row.reduction.least, row.reduction.most) == pytest.approx((20.0, 10.0, 30.0))
    assert row.lost == pytest.approx(0.0)
    figures = row.figures()
    assert [figures[f"reduction_percent_{end}"] for end in ("min", "max")] == pytest.approx([10.0, 30.0])
    assert (row.in_control, row.reasons, figures["latches"]) == (75.0, {"STREAM_LOST": 50}, 2)


@given(numbers, numbers, numbers)
def test_more_reduction_is_never_less_useful(one, other, undisturbed) -> None:
    order = [Use.NONE, Use.MARGINAL, Use.USEFUL]
    low, high = sorted((one, other))
    first, second = (use_of(value, undisturbed, 0.5, Criteria()) for value in (low, high))
    assert order.index(first) <= order.index(second)


def test_a_broken_invariant_or_a_run_that_did_not_finish_in_one_phase_is_unsafe() -> None:
    broken, failed = rows_of(
        (scenario_of("one"), [phase_of(), phase_of(broken=["period 7: the jets move in OFF"])]),
        (scenario_of("two"), [phase_of(), phase_of(failure="the flow diverged")]),
    )[1:]
    assert (broken.safe, broken.use, broken.violations) == (False, Use.USEFUL, 1)
    assert broken.broken == ["phase 1: period 7: the jets move in OFF"]
    assert (failed.safe, failed.use) == (False, Use.NONE)
    assert isnan(failed.reduction.mean)
    assert failed.broken == ["phase 1: did not finish: the flow diverged"]
    figures = failed.figures()
    assert figures["reduction_percent"] is None
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures


def made(name: str, group: str, Cd: float, in_control: int = 100, **fields):
    return scenario_of(name, group, **fields), [phase_of(Cd, in_control=in_control)]


def test_the_two_of_least_reduction_are_combined_from_two_groups() -> None:
    rows = rows_of(
        made("mild", "A", 0.85, disturb=("noise:level=0.1",)),
        made("bad", "B", 0.95, disturb=("gust:amplitude=0.1,period=20",), settings=("bus.background.load=0.9",)),
        made("worse", "A", 0.99, disturb=("noise:level=0.9",)),
        made("also_bad", "A", 0.97),
    )
    both = two_worst(rows)
    assert both is not None
    assert both.disturb == ("gust:amplitude=0.1,period=20", "noise:level=0.9")
    assert both.settings == ("bus.background.load=0.9",)
    assert "bad and worse" in both.sentence


def test_pairs_that_do_not_go_together_are_left_out() -> None:
    for chosen, rows in (
        # What shut the jets hides what any other does to them.
        ("one and two", (made("shut", "A", 1.2, in_control=10), made("one", "B", 0.9), made("two", "C", 0.95))),
        # Two that set the same thing.
        (
            "twelve and mild",
            (
                made("twelve", "A", 0.99, settings=("vehicle.actuator_delay=12",)),
                made("four", "B", 0.98, settings=(" vehicle.actuator_delay = 4",)),
                made("mild", "C", 0.85),
            ),
        ),
    ):
        both = two_worst(rows_of(*rows))
        assert both is not None and chosen in both.sentence, chosen
    # Without two groups there is none.
    assert two_worst(rows_of(made("one", "A", 0.9), made("two", "A", 0.95))) is two_worst(rows_of()) is None
