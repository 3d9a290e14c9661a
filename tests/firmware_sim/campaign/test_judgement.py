"""What came of a campaign: worked out on paper."""

import json
from math import isnan

import numpy as np
import pytest

from firmware_sim.campaign.folder import KeptCourse, MeanFigures, RunOutcome
from firmware_sim.campaign.judgement import PhaseOutcomes, Use
from firmware_sim.campaign.scenario import Criteria
from tests.firmware_sim.campaign.conftest import phase_of, rows_of, scenario_of


def test_means_are_over_the_instants_from_the_end_of_settling_on() -> None:
    n = np.arange(5.0)
    series = {"t": 0.2 * n, "Cd": 0.1 * n, "Cl": np.array([9.0, 9.0, -0.3, 0.1, 0.5]), "action": 0.0 * n - 0.02}
    figures = MeanFigures.over(KeptCourse.of(series, 0.2), from_t=0.4)
    assert (figures.Cd, figures.abs_Cl, figures.mean_Cl, figures.rms_action) == pytest.approx((0.3, 0.3, 0.1, 0.02))


def test_reduction_and_use_follow_their_criteria_over_all_phases() -> None:
    # Undisturbed there is 20 % less: three quarters of it are 15 %.
    cases = [(0.85, 0.2, Use.USEFUL), (0.86, 0.2, Use.MARGINAL), (0.99, 0.2, Use.MARGINAL), (1.00, 0.2, Use.NONE)]
    # Without control |Cl| is 0.9: less drag with more side force is not useful.
    cases += [(1.10, 0.2, Use.NONE), (0.80, 0.91, Use.MARGINAL), (0.80, 0.90, Use.USEFUL)]
    for Cd, abs_Cl, use in cases:
        _, row = rows_of((scenario_of("one"), [phase_of(Cd, abs_Cl=abs_Cl)] * 2))
        assert row.use == use, Cd
    assert rows_of((scenario_of("one", criteria=Criteria(useful=1.0)), [phase_of(0.81)]))[1].use == Use.MARGINAL
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


def test_a_broken_invariant_or_a_run_that_did_not_finish_in_one_phase_is_unsafe() -> None:
    broken, failed, unknown = rows_of(
        (scenario_of("one"), [phase_of(), phase_of(broken=["period 7: the jets move in OFF"])]),
        (scenario_of("two"), [phase_of(), phase_of(failure="the flow diverged")]),
        (scenario_of("free"), [PhaseOutcomes(under=phase_of().under, free=RunOutcome(key="f", failure="it diverged"))]),
    )[1:]
    assert (broken.safe, broken.use, broken.total("violations")) == (False, Use.USEFUL, 1)
    assert broken.broken == ["phase 1: period 7: the jets move in OFF"]
    assert {(one.safe, one.use, isnan(one.reduction.mean)) for one in (failed, unknown)} == {(False, Use.NONE, True)}
    assert failed.broken == ["phase 1: did not finish: the flow diverged"]
    assert unknown.broken == ["phase 0: did not finish without control: it diverged"]
    assert (figures := failed.figures())["reduction_percent"] is None
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures
