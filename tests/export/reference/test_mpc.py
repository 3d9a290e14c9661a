"""Properties of the control step that hold whatever the networks are.

Many at once = one after the other, whatever the leading axes. A matrix product of many rows adds up in another order
than that of one. In double precision, at these widths, that is 1e-15 a product and 1e-13 after a roll-out with its
adjoint. Adam divides by a gradient plus 1e-8, so a plan may differ by more, where a gradient is small: by 1e-8 of the
learning rate.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes
from scipy.optimize import minimize

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.interface import TERMS
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram
from export.program.windows import random_window
from export.reference.model import encode, encoder_layers, layer_norm
from export.reference.mpc import adam, control_step, cost_terms, evaluate, gradient, optimise, predict, rollout, shift
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


EVERY_TERM = CostWeights(lift=0.05, lift_mean=0.3, smoothness=4.0, effort=0.5, rate=1.0)
CLOSE: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-13}


def draw(seed: int, shape: tuple[int, ...]):
    """Latent states, plans and previous actions of this shape."""
    rng = np.random.default_rng(seed)
    return (
        rng.normal(size=(*shape, 3)),
        rng.uniform(-0.07, 0.07, (*shape, HORIZON)),
        rng.uniform(-0.05, 0.05, shape),
    )


@examples(8)
@given(shape=array_shapes(min_dims=0, max_dims=3, max_side=3), seed=st.integers(0, 5))
def test_every_function_acts_on_the_last_axes(shape, seed):
    program, (z, plan, before) = small(seed, weights=EVERY_TERM), draw(seed, shape)
    rng = np.random.default_rng(seed)
    free = rng.integers(0, 2, (*shape, HORIZON)).astype(float)
    rates = rng.uniform(1e-4, 1e-2, (4, *shape))
    windows = np.array([random_window(program, rng) for _ in range(int(np.prod(shape)))]).reshape(*shape, 5, -1)
    weights = rng.uniform(0.1, 2.0, 8)

    encoded = encode(program, windows)
    latents = rollout(program, z, plan)
    forces = predict(program, z, plan)
    cost = cost_terms(forces, plan, before, program.mpc.drag_reference) @ weights
    slope = gradient(program, z, plan, before, weights)
    optimised = optimise(program, z, plan, before, free, weights)
    *_, moved = adam(program, z, plan, before, rates, free_mask=free)
    assert encoded.shape == z.shape
    assert latents.shape == (*shape, HORIZON + 1, 3)
    assert forces.shape == (*shape, HORIZON, 2)
    assert cost.shape == shape
    assert slope.shape == optimised.shape == moved.shape == plan.shape
    for i in np.ndindex(shape):
        one = (program, z[i], plan[i], float(before[i]))
        np.testing.assert_allclose(encoded[i], encode(program, windows[i]), **CLOSE)
        np.testing.assert_allclose(latents[i], rollout(*one[:3]), **CLOSE)
        np.testing.assert_allclose(forces[i], evaluate(*one, weights).forces, **CLOSE)
        np.testing.assert_allclose(cost[i], evaluate(*one, weights).cost, **CLOSE)
        np.testing.assert_allclose(slope[i], gradient(*one, weights), **CLOSE)
        np.testing.assert_allclose(optimised[i], optimise(*one, free[i], weights), rtol=0, atol=1e-10)
        *_, alone = adam(*one, rates[(slice(None), *i)], free_mask=free[i])
        np.testing.assert_allclose(moved[i], alone, rtol=0, atol=1e-10)


def test_the_lstm_starts_at_zero_and_takes_one_row_at_a_time():
    program = small(3)
    window = random_window(program, np.random.default_rng(3))
    recurrent = encoder_layers(program, window).recurrent
    assert not recurrent[0].any()
    for k in range(1, len(window)):
        head = layer_norm(program.encoder.norm, recurrent[k])
        np.testing.assert_array_equal(head, encoder_layers(program, window[:k]).head)
