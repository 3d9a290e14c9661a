"""Many at once = one after the other, whatever the leading axes.

A matrix product of many rows adds up in another order than that of one. In double precision, at these widths, that is
1e-15 a product and 1e-13 after a roll-out with its adjoint. Adam divides by a gradient plus 1e-8, so a plan may differ
by more, where a gradient is small: by 1e-8 of the learning rate.
"""

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram
from export.program.windows import random_window
from export.reference.cost import cost_terms
from export.reference.model import encode, encoder_layers, layer_norm
from export.reference.mpc import adam, evaluate, gradient, optimise, predict, rollout
from tests.examples import examples

HORIZON, LATENT = 6, 3
SMALL = ModelConfig(window=5, latent=LATENT, lstm_width=5, dynamics_width=10, decoder_width=8)
EVERY_TERM = CostWeights(lift=0.05, lift_mean=0.3, smoothness=4.0, effort=0.5, rate=1.0)
CLOSE: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-13}
leading = array_shapes(min_dims=0, max_dims=3, max_side=3)


def small(seed: int = 0) -> ControllerProgram:
    return random_program(seed, model=SMALL, mpc=MpcConfig(horizon=HORIZON, weights=EVERY_TERM))


def draw(seed: int, shape: tuple[int, ...]):
    """Latent states, plans and previous actions of this shape."""
    rng = np.random.default_rng(seed)
    return (
        rng.normal(size=(*shape, LATENT)),
        rng.uniform(-0.07, 0.07, (*shape, HORIZON)),
        rng.uniform(-0.05, 0.05, shape),
    )


@examples(8)
@given(shape=leading, seed=st.integers(0, 5))
def test_every_function_acts_on_the_last_axes(shape, seed):
    program, (z, plan, before) = small(seed), draw(seed, shape)
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
    assert latents.shape == (*shape, HORIZON + 1, LATENT)
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
