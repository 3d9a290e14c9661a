"""The fit of the air speed's estimate: what it reads is what the ECU reads, and it finds weights that there are."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from contract.config.learning import RefineConfig
from contract.config.tree import Config
from contract.controller.air_speed import FIRST_PERIOD, LAGS, MEAN_PERIODS, feature_count, features, terms, weight_count
from contract.controller.goal import Goal
from ecu.controller_memory import ControllerMemory
from tests.each import each
from tests.train.refinement.oscillator import MIDDLES, START, Oscillator
from train.fitting.progress import Phase
from train.refinement.air_speed import DESIGN_SPEED_EVERY, MOST_WRONG, RUN_PERIODS, fit, run, wrong_speeds
from train.refinement.feedback import Feedback
from train.refinement.imitation import watch
from train.refinement.pipeline import air_speed_of

SETTINGS = RefineConfig(slowest=0.7, fastest=1.3)


def test_speeds_stay_in_the_range_and_a_run_tells_one_ratio_within_its_limit():
    ratios = list[float]()
    for number in range(50):
        true, told = wrong_speeds(number, 0.7, 1.3, seed=0)
        assert len(true) == RUN_PERIODS + 1 == len(told) + 1
        assert true[0] == 1.0 and true.min() >= 0.7 and true.max() <= 1.3
        said = told * true[:-1]
        free = (said > 0.701) & (said < 1.299)
        assert np.ptp(told[free]) < 1e-9 and said.min() > 0.7 - 1e-9 and said.max() < 1.3 + 1e-9
        ratios.append(float(np.median(told)))
    assert np.std(ratios) > 0.03 and max(abs(np.array(ratios) - 1.0)) <= MOST_WRONG
    assert ratios[::DESIGN_SPEED_EVERY] == [1.0] * len(ratios[::DESIGN_SPEED_EVERY]) and 15 < ratios.count(1.0) < 40


def test_the_equations_have_the_features_of_the_ecus_window():
    """The window of an ECU that gets the same pressures, the told speed, and sends the same actions."""
    policy = Feedback(4, 3, (0.3, 0.3, 0.05), MIDDLES, 0.075, 0)
    torch.nn.init.normal_(policy.output, 0.0, 0.5, generator=torch.Generator().manual_seed(0))
    seen, logarithm = run(Oscillator(), policy, [START], SETTINGS, Goal(), seed=1, number=5)
    true, told = wrong_speeds(5, 0.7, 1.3, seed=1)
    assert logarithm == pytest.approx(np.log(told[-len(seen) :])) and np.ptp(true) > 0.1
    rows = watch(Oscillator(), policy, START, true, Goal(), told=told).rows.numpy()
    assert np.abs(rows[:, -1]).max() > 0.01
    memory, found = ControllerMemory.empty(length=max(LAGS) + 1, sensors=4, horizon=2, delay=0, past=20), []
    for (*values, action), ratio, speed in zip(rows.tolist(), told, true, strict=False):
        differences, sums = np.reshape(values, (2, 2)) / ratio**2
        cp = np.column_stack([sums + differences, sums - differences]).ravel() / 2.0
        memory = memory.observed(cp, speed * ratio)
        found.append(features(memory.window))
        memory = memory.commanded(action)
    assert seen[50:] == pytest.approx(np.array(found)[-len(seen) + 50 :], rel=1e-9, abs=1e-12)
    assert seen.shape[1] == feature_count(2)


def test_the_fit_finds_the_weights_of_an_estimate_that_there_is():
    rng, weights = np.random.default_rng(0), np.zeros(weight_count(2))
    weights[[3, 10, 20]], weights[-1] = (0.5, -0.2, 0.3), 0.01
    found = []
    for _ in range(12):
        seen, means, wanted = rng.normal(0.0, 1.0, (400, feature_count(2))), np.zeros(feature_count(2)), []
        for k, row in enumerate(seen, 1):
            means = means + (row - means) / min(k, MEAN_PERIODS)
            wanted.append(float(terms(means, 2) @ weights))
        found.append((seen, np.array(wanted)))
    fitted, error = fit(found, 2, seed=0)
    assert error < 0.02 * np.std(np.concatenate([wanted[FIRST_PERIOD:] for _, wanted in found]))
    assert fitted == pytest.approx(weights, abs=0.01)


@each("slowest", (0.7, 0.3))
def test_a_refinement_over_speeds_ends_with_the_fit(monkeypatch, slowest):
    monkeypatch.setattr("train.refinement.air_speed.RUNS", 3)
    policy, told = Feedback(4, 3, (0.3, 0.3, 0.05), MIDDLES, 0.075, 0), list[tuple[str, int, int]]()
    settings = Config(refine=replace(SETTINGS, slowest=slowest))
    weights = air_speed_of(Oscillator(), [START], policy, settings, lambda *seen: told.append(seen[:3]))
    assert weights.shape == (weight_count(2),) and np.isfinite(weights).all()
    assert told == [(Phase.AIR_SPEED, number, 3) for number in (1, 2, 3)]
