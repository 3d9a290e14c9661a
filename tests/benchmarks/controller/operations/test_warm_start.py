"""The learned warm start on a small random program: it learns to cost less than the shifted plan."""

import numpy as np
import pytest

from benchmarks.controller.operations.chosen import RELEASE
from benchmarks.controller.operations.sequences import Sequences
from benchmarks.controller.operations.warm_start import learn, random_weights
from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from export.program.random_program import random_program

GOAL = CostWeights(lift=0.05, lift_mean=0.3, smoothness=4.0, effort=0.5, rate=1.0)
PROGRAM = random_program(
    0,
    model=ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8),
    mpc=MpcConfig(horizon=6, weights=GOAL),
)


def sequences(seed):
    rng = np.random.default_rng(seed)
    action = rng.uniform(-0.05, 0.05, (15, 20))
    return Sequences(program=PROGRAM, z=rng.normal(size=(14, 20, 3)), previous_action=action[:-1], pending=action[1:])


@pytest.mark.slow
def test_it_proposes_cheaper_plans_where_it_was_not_taught():
    taught = learn(sequences(0), RELEASE, weight_sets=4, passes=40, seed=0)
    weights = np.array(GOAL.as_tuple())
    problems = [problem for problem, _ in sequences(1).travelled(RELEASE, weights)][10:]
    proposed = [np.where(problem.free, np.clip(taught(problem), -0.075, 0.075), problem.start) for problem in problems]
    shifted = [problem.cost(problem.start).mean() for problem in problems]
    assert np.mean([p.cost(plan).mean() for p, plan in zip(problems, proposed, strict=True)]) < np.mean(shifted)


def test_weights_are_drawn_around_the_releases():
    about = np.array([1.0, 0.0, 2.0])
    drawn = np.array([random_weights(about, np.random.default_rng(seed)) for seed in range(200)])
    assert (drawn[:, 1] == 0.0).all()
    assert drawn[:, 2].min() < 1.0 and drawn[:, 2].max() > 4.0
    assert drawn[:, 0].min() >= 1.0 / 3.0 and drawn[:, 0].max() <= 3.0
