"""The search: the present first, hopeless trials given up, the budget kept, and stops that change nothing."""

from itertools import product

import numpy as np
import optuna
import pytest
from optuna.trial import TrialState

from contract.errors import ConfigError, OutputError
from firmware_sim.tuning.search import (
    JOURNAL,
    PHASES,
    check_place,
    complete,
    finished,
    importances,
    open_study,
    score_of,
    search,
    settings_of,
    spent,
)
from tests.firmware_sim.tuning.conftest import BLOCKS, MadeUpLoop, Stopped, plan_of

LABEL = {"of": "a test"}


def proposals(study) -> list[dict[str, float]]:
    return [dict(settings_of(trial)) for trial in finished(study)]


def test_the_first_trial_has_the_present_settings(loop, tmp_path) -> None:
    plan = plan_of(trials=3)
    study = open_study(tmp_path, LABEL)
    search(study, plan, loop, clock=loop.clock)
    assert [mpc for mpc, _ in loop.made[:2]] == [plan.present] * 2
    assert [phase for _, phase in loop.made[:6]] == [0, 1] * 3
    first = finished(study)[0]
    assert score_of(first) == pytest.approx(30.0 - 400.0 * 0.19**2 + 0.005)
    assert len(first.user_attrs[PHASES]) == 2


def test_settings_to_be_tried_come_after_the_present_and_once(tmp_path) -> None:
    tried = {"mpc.weights.lift": 0.2, "mpc.weights.smoothness": 4.0}
    for trials in (3, 5):
        loop = MadeUpLoop()
        study = open_study(tmp_path, LABEL)
        search(study, plan_of(trials=trials, tries=(tried,)), loop, clock=loop.clock)
    assert [number for number, found in enumerate(proposals(study)) if found == tried] == [1]


@pytest.mark.slow  # fifty proposals
def test_the_search_finds_what_is_best(tmp_path) -> None:
    loop, study = MadeUpLoop(), open_study(tmp_path, LABEL)
    search(study, plan_of(trials=50), loop, clock=loop.clock)
    best = settings_of(complete(study)[0])
    assert score_of(complete(study)[0]) > 29.0
    assert best["mpc.weights.lift"] == pytest.approx(0.2, abs=0.06)
    assert best["mpc.weights.smoothness"] == pytest.approx(8.0, abs=2.0)


def test_importances_are_shares_of_the_variance():
    """Over a square of x and y evenly filled, 3x + y has nine tenths of its variance from x."""
    study = optuna.create_study(direction="maximize")
    side = optuna.distributions.FloatDistribution(0.0, 1.0)
    for x, y in product(np.linspace(0.0, 1.0, 9), repeat=2):
        trial = optuna.trial.create_trial(
            params={"x": x, "y": y}, distributions={"x": side, "y": side}, value=3.0 * x + y
        )
        study.add_trial(trial)
    shares = importances(study, 0)
    assert list(shares) == ["x", "y"]
    assert shares["x"] == pytest.approx(0.9, abs=0.05)


def test_trials_that_fall_behind_are_given_up(loop, tmp_path) -> None:
    study = open_study(tmp_path, LABEL)
    search(study, plan_of(trials=20), loop, clock=loop.clock)
    given_up = [trial for trial in finished(study) if trial.state == TrialState.PRUNED]
    assert given_up
    # They cost less, and each was worse than what it was compared with: the median of those before it.
    assert loop.blocks < 20 * 2 * BLOCKS
    assert max(trial.number for trial in finished(study)[:5]) < min(trial.number for trial in given_up)
    for trial in given_up:
        before = sorted(score_of(one) for one in complete(study) if one.number < trial.number)
        last = list(trial.intermediate_values.values())[-1]
        assert last < before[len(before) // 2] + 0.1


def test_a_search_that_was_killed_proposes_what_it_would_have_without(tmp_path) -> None:
    for trials, stop_in in [(3, 3), (13, 17)]:
        plan, whole = plan_of(trials=trials), MadeUpLoop()
        search(open_study(tmp_path / f"whole{stop_in}", LABEL), plan, whole, clock=whole.clock)
        cut, again = MadeUpLoop(stop_in=stop_in), MadeUpLoop()
        with pytest.raises(Stopped):
            search(open_study(tmp_path / f"cut{stop_in}", LABEL), plan, cut, clock=cut.clock)
        study = open_study(tmp_path / f"cut{stop_in}", LABEL)
        search(study, plan, again, clock=again.clock)
        assert proposals(study) == proposals(open_study(tmp_path / f"whole{stop_in}", LABEL)), trials
        # The trial that was cut is made again from its first run on, those before it are not.
        settings, phase = cut.made[-1]
        assert again.made[0] == (settings, 0), trials
        assert len(cut.made) - (phase + 1) + len(again.made) == len(whole.made), trials


def test_no_trial_begins_after_the_budget_of_all_calls_is_spent(tmp_path) -> None:
    # A trial takes 20 s: the fourth begins at 60 and ends at 80. Without time the present settings are tried.
    for seconds, trials in ((1e-6, 1), (30.0, 2), (30.0, 2), (65.0, 4)):
        loop, study = MadeUpLoop(), open_study(tmp_path, LABEL)
        search(study, plan_of(seconds=seconds), loop, clock=loop.clock)
        assert len(finished(study)) == trials, seconds
        assert spent(study) == 20.0 * trials, seconds
    # So few of them show nothing about what matters.
    assert importances(study, 0) == {}


def test_present_settings_in_trouble_end_the_search(tmp_path) -> None:
    loop = MadeUpLoop(trouble=True)
    with pytest.raises(ConfigError, match="the present settings cannot be compared with: ECU FAULT: made up"):
        search(open_study(tmp_path, LABEL), plan_of(trials=3), loop, clock=loop.clock)
    assert len(loop.made) == 1


def test_a_folder_or_journal_of_something_else_is_refused(tmp_path) -> None:
    check_place(tmp_path / "missing")
    (tmp_path / "starts").mkdir()
    check_place(tmp_path)
    for _ in range(2):
        open_study(tmp_path / "a", {"seed": 1, "phases": (1, 2)})
    with pytest.raises(OutputError, match="holds a search with other phases, seed; give --overwrite"):
        open_study(tmp_path / "a", {"seed": 2})
    (tmp_path / JOURNAL).write_text("text\ntext\n")
    with pytest.raises(OutputError, match="not a search, or damaged"):
        open_study(tmp_path, LABEL)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "notes.txt").touch()
    with pytest.raises(OutputError, match="there is something that is no search"):
        check_place(tmp_path / "b")
