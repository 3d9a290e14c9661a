"""What a run is worth: drag, less side force above the bound, and nothing at all with trouble."""

import pytest

from contract.errors import ConfigError
from firmware_sim.tuning.loop import Course
from firmware_sim.tuning.score import TROUBLE, Goal, PhaseFigures


def run_of(reduction, abs_Cl, trouble=None) -> PhaseFigures:
    return PhaseFigures(
        reduction_percent=reduction, abs_Cl=abs_Cl, mean_Cl=0.0, rms_action=0.03, jet_power=0.04, trouble=trouble
    )


def test_side_force_costs_points_above_the_bound_alone_and_trouble_in_one_phase_all() -> None:
    goal = Goal(lift_bound=0.2, lift_penalty=100.0)
    for reduction, abs_Cl, score in (
        *((25.0, 0.2, 25.0), (25.0, 0.0, 25.0), (25.0, 0.3, 15.0), (-5.0, 1.2, -105.0), (0.0, 0.1, 0.0)),
    ):
        assert goal.score(run_of(reduction, abs_Cl)) == pytest.approx(score), (reduction, abs_Cl)
    good, held_in_part = run_of(25.0, 0.1), run_of(None, 0.1)
    assert goal.score(run_of(25.0, 0.1, "ECU FAULT")) == TROUBLE
    assert goal.score(PhaseFigures.failed("the flow diverged")) == TROUBLE
    assert goal.score_of_all([good, held_in_part, good]) == TROUBLE
    assert goal.score_of_all([good, run_of(27.0, 0.1)]) == 26.0
    # Nor has a summary without averages a reduction.
    names = ("reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action", "jet_power_controlled")
    net = {"Cd_net_uncontrolled": 1.0, "Cd_net_controlled": None, "trouble": None}
    figures = PhaseFigures.of({**dict.fromkeys(names), **net})
    assert figures.Cd_net_reduction_percent is None
    assert goal.score(figures) == TROUBLE
    for name in ("lift_bound", "lift_penalty"):
        for value in (-0.1, float("nan"), float("inf")):
            with pytest.raises(ConfigError, match=f"--{name.replace('_', '-')} {value}: must be a number, at least 0"):
                Goal(**{name: value})


def test_blocks_are_scored_against_the_time_without_control() -> None:
    course = Course(lead_in=4, block=2, goal=Goal(lift_bound=0.2, lift_penalty=100.0))
    assert [course.with_row(Cd, 0.9) for Cd in (0.9, 1.1, 1.1, 0.9)] == [None] * 4
    # A fifth less drag, lift of either sign within the bound; then drag as before, lift 0.1 above it.
    scored = [course.with_row(*row) for row in ((0.7, 0.1), (0.9, -0.1), (1.0, 0.3), (1.0, -0.3))]
    assert scored[0] is None and scored[2] is None
    ends = [one for one in scored if one is not None]
    assert [number for number, _ in ends] == [0, 1]
    assert [score for _, score in ends] == pytest.approx([20.0, -10.0])
