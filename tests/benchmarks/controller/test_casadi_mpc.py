"""CasADi's solvers are given our problem: its cost is the reference's, and what they return is judged by that."""

import numpy as np
import pytest

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from export.program.random_program import random_program
from export.reference.mpc import evaluate, optimise

pytest.importorskip("casadi")
from benchmarks.controller.casadi_mpc import cost_function, variants

SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
HORIZON = 6
EVERY_TERM = CostWeights(lift=0.05, lift_mean=0.3, smoothness=4.0, effort=0.5, rate=1.0)


def program(seed):
    return random_program(seed, model=SMALL, mpc=MpcConfig(horizon=HORIZON, weights=EVERY_TERM))


@pytest.mark.parametrize("seed", range(3))
def test_the_cost_is_the_references(seed):
    """Both in float64, sums in another order."""
    ours, rng = program(seed), np.random.default_rng(seed)
    theirs = cost_function(ours)
    weights = np.array(EVERY_TERM.as_tuple())
    for _ in range(5):
        z, plan, before = rng.normal(size=3), rng.uniform(-0.075, 0.075, HORIZON), float(rng.uniform(-0.05, 0.05))
        assert float(theirs(z, plan, before)) == pytest.approx(evaluate(ours, z, plan, before, weights).cost, abs=1e-13)


def test_every_variant_keeps_the_limit_and_the_whole_ones_beat_five_iterations_of_adam():
    ours, z = program(1), np.random.default_rng(1).normal(size=3)
    weights, start = np.array(EVERY_TERM.as_tuple()), np.zeros(HORIZON)
    adam = evaluate(ours, z, optimise(ours, z, start, 0.01, np.ones(HORIZON), weights), 0.01, weights).cost
    for variant in variants(ours):
        plan = variant.solve(z, start, 0.01)
        assert np.abs(plan).max() <= ours.action_limit, variant.name
        if "iterations" not in variant.name:
            assert evaluate(ours, z, plan, 0.01, weights).cost <= adam + 1e-9, variant.name
