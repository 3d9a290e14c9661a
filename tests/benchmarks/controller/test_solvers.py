"""The comparison with CasADi's solvers: what its gaps are shares of."""

import numpy as np
import pytest

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from export.program.random_program import random_program, random_window
from export.reference.mpc import evaluate

pytest.importorskip("casadi", reason="casadi (extra bench) is not installed")

from benchmarks.controller.solvers import compare, random_problem

SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
GOAL = CostWeights(lift=0.05, lift_mean=0.3, smoothness=4.0, effort=0.5, rate=1.0)


def test_gaps_are_shares_of_what_the_best_gains_over_doing_nothing():
    program = random_program(3, model=SMALL, mpc=MpcConfig(horizon=6, weights=GOAL))
    problem = random_problem(program, random_window(program, np.random.default_rng(3)))
    found = compare(program, [problem])
    gaps = {row["variant"]: row["gap"] for row in found["solvers"]}
    assert min(gaps.values()) == 0.0
    assert gaps["single shooting, IPOPT"] < 1.0 and gaps["multiple shooting, IPOPT"] < 1.0
    # Our iterations start from the shifted plan and lower its cost; the best lies below both.
    assert 0.0 < found["ours"]["gap"] < found["start"]["gap"]
    # The start's gap by hand, from the multiple-shooting optimum.
    from benchmarks.controller.casadi_mpc import variants

    weights = np.array(GOAL.as_tuple())
    plans = [solver.solve(problem.z, problem.start, problem.previous_action) for solver in variants(program)]

    def cost(plan):
        return evaluate(program, problem.z, plan, problem.previous_action, weights).cost

    best, nothing = min(map(cost, plans)), cost(np.zeros_like(problem.start))
    expected = 100.0 * (cost(problem.start) - best) / (nothing - best)
    assert found["start"]["gap"] == pytest.approx(expected, rel=1e-6)
