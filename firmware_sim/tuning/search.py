"""The search: Optuna proposes settings, runs judge them, a journal in the folder keeps every trial.

The journal is written as the search goes on. A call that is stopped at any point, or killed, is continued by the next
one: a trial that was under way is made again with the same settings. What is proposed depends on the seed and on the
finished trials alone, so that a search that was stopped proposes what it would have proposed without the stop.
"""

import json
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution, IntDistribution
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState

from contract.config.controller import MpcConfig
from contract.errors import ConfigError, OutputError
from firmware_sim.tuning.loop import Report
from firmware_sim.tuning.score import TROUBLE, Goal, PhaseFigures
from firmware_sim.tuning.space import Range, Values, ranges_around, rounded, values_of, with_values

JOURNAL: Final = "trials.log"
STARTS: Final = "starts"
"""What is in the folder of a search; a start may be there before the search has begun."""
LABEL: Final = "label"
SECONDS: Final = "seconds"
PHASES: Final = "phases"
SETTINGS: Final = "settings"
"""Names of what a trial keeps with its score."""
FINISHED: Final = (TrialState.COMPLETE, TrialState.PRUNED)

_STUDY: Final = "tune"
_AT_RANDOM: Final = 10
"""Trials before the sampler follows what it has seen."""
_NEVER_PRUNED: Final = 5
"""Trials whose runs are all made, for the later ones to be compared with."""
_UNJUDGED_BLOCKS: Final = 3
"""Blocks of the first run in which no trial is given up: the side force is still large then."""
_ENOUGH: Final = 8
"""Trials without which nothing is known about what matters."""


class RunPhase(Protocol):
    """Makes one run."""

    def __call__(self, mpc: MpcConfig, phase: int, report: Report) -> PhaseFigures:
        """With these settings, from that start; calls `report` after every block."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is searched, and how long.

    Attributes:
        present: settings of the release, which are the first trial.
        names: settings that are varied.
        phases: starts of every trial.
        blocks: of a run.
        goal: what runs are worth.
        seed: of the proposals.
        seconds: for all calls together; a trial that began before is made to its end.
        trials: at most; None for no bound.
        tries: settings that are tried before any is proposed.
    """

    present: MpcConfig
    names: tuple[str, ...]
    phases: int
    blocks: int
    goal: Goal
    seed: int
    seconds: float
    trials: int | None = None
    tries: tuple[Values, ...] = ()

    def ranges(self) -> dict[str, Range]:
        """Range of every setting that is varied."""
        return ranges_around(self.present, self.names)


def open_study(folder: Path, label: Mapping[str, Any]) -> optuna.Study:
    """The study in a folder: the one that was begun there, or a new one.

    Args:
        label: what the search is of, as plain JSON.

    Raises:
        OutputError: there is something that is no search, or a search of something else.
    """
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        storage = JournalStorage(JournalFileBackend(str(folder / JOURNAL)))
        # A look at a search of something else must not change its journal.
        if _STUDY in optuna.get_all_study_names(storage):
            study = optuna.load_study(study_name=_STUDY, storage=storage)
        else:
            study = optuna.create_study(storage=storage, study_name=_STUDY, direction="maximize")
    except (KeyError, ValueError, AssertionError, TypeError) as error:
        raise OutputError(f"{folder / JOURNAL}: not a search, or damaged ({error!r})") from error
    plain = json.loads(json.dumps(label))
    held = study.user_attrs.get(LABEL)
    if held is None:
        study.set_user_attr(LABEL, plain)
    elif held != plain:
        names = ", ".join(sorted(name for name in held.keys() | plain.keys() if held.get(name) != plain.get(name)))
        raise OutputError(
            f"{folder}: holds a search with other {names}; give --overwrite to replace it, or another folder"
        )
    return study


def check_place(folder: Path) -> None:
    """Raises OutputError if the folder holds something, and no search."""
    if folder.is_dir() and {item.name for item in folder.iterdir()} - {STARTS} and not (folder / JOURNAL).is_file():
        raise OutputError(f"{folder}: there is something that is no search; name another folder")


def search(
    study: optuna.Study,
    plan: Plan,
    run: RunPhase,
    *,
    clock: Callable[[], float],
    ended: Callable[[FrozenTrial], None] = lambda trial: None,
) -> None:
    """Make trials until the budget is spent; at least the present settings are tried.

    Args:
        run: makes the runs.
        clock: seconds; what trials took is added up over all calls.
        ended: called with every trial of this call.

    Raises:
        ConfigError: the present settings themselves have trouble, so that nothing can be compared with them.
    """
    distributions = {name: _distribution(range_) for name, range_ in plan.ranges().items()}
    _queue(study, plan)
    study.pruner = optuna.pruners.MedianPruner(n_startup_trials=_NEVER_PRUNED, n_warmup_steps=_UNJUDGED_BLOCKS)
    while True:
        if is_done(study, plan):
            return
        before = finished(study)
        study.sampler = _sampler(plan.seed, len(before))
        trial = study.ask(distributions)
        since = clock()
        settings = {name: rounded(float(value)) for name, value in trial.params.items()}
        if not before:
            settings = values_of(plan.present, plan.names)
        trial.set_user_attr(SETTINGS, settings)
        try:
            score: float | None = _attempt(trial, with_values(plan.present, settings), plan, run)
        except optuna.TrialPruned:
            score = None
        trial.set_user_attr(SECONDS, clock() - since)
        ended_trial = study.tell(trial, state=TrialState.PRUNED) if score is None else study.tell(trial, score)
        ended(ended_trial)
        if not before and score == TROUBLE:
            why = ended_trial.user_attrs[PHASES][-1]["trouble"] or "there are no averages"
            raise ConfigError(f"the present settings cannot be compared with: {why}")


def is_done(study: optuna.Study, plan: Plan) -> bool:
    """Whether the budget is spent, or there are as many trials as were asked for."""
    made = len(finished(study))
    return made > 0 and (spent(study) >= plan.seconds or (plan.trials is not None and made >= plan.trials))


def finished(study: optuna.Study) -> list[FrozenTrial]:
    """Trials that were made to their end or given up, in order."""
    return study.get_trials(deepcopy=False, states=FINISHED)


def complete(study: optuna.Study) -> list[FrozenTrial]:
    """Trials of which all runs were made, best first; of equals the first one."""
    made = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    return sorted(made, key=lambda trial: (-score_of(trial), trial.number))


def score_of(trial: FrozenTrial) -> float:
    """Score of a complete trial."""
    assert trial.value is not None
    return trial.value


def settings_of(trial: FrozenTrial) -> Values:
    """What was varied, with the values of a trial."""
    values: Values = trial.user_attrs[SETTINGS]
    return values


def spent(study: optuna.Study) -> float:
    """Seconds that the finished trials took."""
    return float(sum(trial.user_attrs.get(SECONDS, 0.0) for trial in finished(study)))


def importances(study: optuna.Study, seed: int) -> dict[str, float]:
    """Share of each setting in the variance of the scores (functional analysis of variance), most important first.

    Of Hutter, Hoos, Leyton-Brown: An efficient approach for assessing hyperparameter importance, ICML 2014. Empty with
    too few complete trials. Trials in trouble are left out: their score is a mark and no measurement.
    """
    sound = [trial for trial in complete(study) if score_of(trial) > TROUBLE]
    if len(sound) < _ENOUGH:
        return {}
    # scikit-learn, which it needs, takes two seconds to load.
    from optuna.importance import FanovaImportanceEvaluator, get_param_importances

    copy = optuna.create_study(direction="maximize")
    copy.add_trials(sound)
    return dict(get_param_importances(copy, evaluator=FanovaImportanceEvaluator(seed=seed % 2**32)))


def _attempt(trial: optuna.Trial, mpc: MpcConfig, plan: Plan, run: RunPhase) -> float:
    """Score of the runs of a trial; raises TrialPruned once they are hopeless."""
    runs = list[PhaseFigures]()

    def report(score: float, step: int) -> None:
        trial.report(score, step)
        if trial.should_prune():
            raise optuna.TrialPruned

    for phase in range(plan.phases):
        first = phase * (plan.blocks + 1)

        def see(block: int, score: float, first: int = first) -> None:
            report((sum(map(plan.goal.score, runs)) + score) / (len(runs) + 1), first + block)

        runs.append(run(mpc, phase, see))
        trial.set_user_attr(PHASES, [one.to_tree() for one in runs])
        score = plan.goal.score_of_all(runs)
        if score == TROUBLE:
            return TROUBLE
        if phase + 1 < plan.phases:
            report(score, first + plan.blocks)
    return score


def _queue(study: optuna.Study, plan: Plan) -> None:
    """Have the trial made again that was under way when a call was stopped; a new search begins with the present."""
    for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        study.tell(trial.number, state=TrialState.FAIL)
        if trial.params:
            study.enqueue_trial(dict(trial.params), skip_if_exists=False)
    if not study.get_trials(deepcopy=False, states=(*FINISHED, TrialState.WAITING)):
        study.enqueue_trial(values_of(plan.present, plan.names))
    for values in plan.tries:
        study.enqueue_trial(dict(values), skip_if_exists=True)


def _sampler(seed: int, made: int) -> optuna.samplers.TPESampler:
    """The proposer after so many trials: a fresh one each time, so that none hangs on what a process did before."""
    own = int(np.random.SeedSequence([seed, made]).generate_state(1)[0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        return optuna.samplers.TPESampler(seed=own, n_startup_trials=_AT_RANDOM, multivariate=True)


def _distribution(range_: Range) -> BaseDistribution:
    if range_.whole:
        return IntDistribution(int(range_.low), int(range_.high))
    return FloatDistribution(range_.low, range_.high, log=range_.log)
