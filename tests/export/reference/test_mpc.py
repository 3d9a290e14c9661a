"""Properties of the control step that hold whatever the networks are."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.interface import TERMS
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram
from export.program.windows import random_window
from export.reference.cost import cost_terms
from export.reference.model import encode
from export.reference.mpc import control_step, evaluate, optimise, rollout, shift
from tests.examples import examples

SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
HORIZON = 6
actions = st.lists(st.floats(-0.075, 0.075), min_size=HORIZON, max_size=HORIZON).map(np.array)
masks = st.lists(st.sampled_from([0.0, 1.0]), min_size=HORIZON, max_size=HORIZON).map(np.array)


def small(seed: int = 0, prior_memory: int = 0, **mpc: Any) -> ControllerProgram:
    return random_program(seed, model=SMALL, mpc=MpcConfig(horizon=HORIZON, **mpc), prior_memory=prior_memory)


def a_window(program: ControllerProgram, seed: int = 0) -> np.ndarray:
    return random_window(program, np.random.default_rng(seed))


@examples(30)
@given(plan=actions, free=masks, rate=st.floats(1e-4, 0.2), seed=st.integers(0, 5), limit=st.floats(0.003, 0.2))
def test_actions_stay_in_bounds_and_committed_ones_stay_put(plan, free, rate, seed, limit):
    program = small(seed, iterations=3, learning_rate=rate, prior_memory=24 * (seed % 2))
    found = control_step(program, a_window(program, seed), plan, free, None, 1.0, limit).plan
    assert np.abs(found * free).max() <= min(limit, program.action_limit)
    np.testing.assert_array_equal(found[free == 0], shift(plan)[free == 0])


@pytest.mark.slow
def test_many_iterations_reach_the_optimum_of_an_independent_optimiser():
    """On smooth terms, against SciPy's L-BFGS-B with numerical gradients of the cost alone."""
    goal = CostWeights(drag_fluctuation=0.0, lift=0.0, lift_mean=0.3, smoothness=4.0, effort=0.5, rate=1.0)
    program = small(iterations=400, learning_rate=2e-3, weights=goal)
    z, weights = encode(program, a_window(program)), np.array(goal.as_tuple())

    def cost(plan: np.ndarray) -> float:
        return evaluate(program, z, plan, 0.01, weights).cost

    start, limit = np.zeros(HORIZON), program.action_limit
    best = minimize(cost, start, method="L-BFGS-B", bounds=[(-limit, limit)] * HORIZON)
    found = cost(optimise(program, z, start, 0.01, np.ones(HORIZON), weights))
    assert found - best.fun <= 1e-3 * (cost(start) - best.fun) + 1e-9


def test_first_forces_are_those_one_step_ahead():
    """An action at t acts on the forces at t+1, which is row 0: nothing earlier, nothing at t itself."""
    program = small(1)
    z = np.zeros(3)
    plan = np.zeros(HORIZON)
    plan[2] = 0.05
    difference = np.abs(rollout(program, z, plan) - rollout(program, z, np.zeros(HORIZON))).max(axis=1)
    assert (difference[:3] == 0).all() and (difference[3:] > 0).all()


def test_terms_of_a_small_example_by_hand():
    forces = np.array([[1.0, -0.4], [1.2, 0.2], [1.1, 0.5]])
    plan = np.array([0.02, 0.05, 0.01])
    start = np.array([0.02, 0.02, 0.02])
    terms = dict(zip(TERMS, cost_terms(forces, plan, 0.05, 1.051, start), strict=True))
    assert terms == pytest.approx(
        {
            "drag_mean": 1.1 - 1.051,
            "drag_fluctuation": 0.2,
            "lift": 1.1 / 3,
            "lift_mean": 0.1**2,
            "smoothness": (0.03**2 + 0.04**2) / 2,
            "effort": (0.02**2 + 0.05**2 + 0.01**2) / 3,
            "rate": 0.03**2,
            "prior": (0.03**2 + 0.01**2) / 3,
        }
    )
    # Terms have the order of the weights.
    named = CostWeights(**{name: float(i) for i, name in enumerate(TERMS)})
    assert named.as_tuple() == tuple(range(8))
