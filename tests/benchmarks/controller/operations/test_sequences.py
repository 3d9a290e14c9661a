"""Recorded control steps as the ECU meets them, and the optimum of a cost that is known in closed form."""

import numpy as np

from benchmarks.controller.operations.chosen import RELEASE
from benchmarks.controller.operations.sequences import Sequences, gaps, optima, zero_costs
from contract import sensors
from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.recording.dataset import UNITS, Episode
from export.program.random_program import random_program

HORIZON = 6
ALONE = CostWeights(drag_mean=0.0, drag_fluctuation=0.0, lift=0.0, smoothness=4.0, effort=0.5, rate=1.0)
PROGRAM = random_program(
    0,
    model=ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8),
    mpc=MpcConfig(horizon=HORIZON, iterations=2, weights=ALONE),
)
WEIGHTS = np.array(ALONE.as_tuple())


def sequences(steps=7):
    rng = np.random.default_rng(0)
    action = rng.uniform(-0.05, 0.05, 60)
    series = {name: rng.normal(size=(60, sensors.COUNT)) if name == "Cp" else action for name in UNITS}
    one = Episode(name="one", role="train", series=series, initial_action=0.0, provenance={})
    return Sequences.of(PROGRAM, [one, one], 2, steps, 10)


def test_every_plan_begins_with_the_action_that_is_under_way():
    one = sequences()
    assert one.z.shape == (7, 4, 3)
    before = np.zeros((4, HORIZON))
    for k, (problem, plans) in enumerate(one.travelled(RELEASE, WEIGHTS)):
        np.testing.assert_array_equal(plans[:, 0], one.pending[k])
        np.testing.assert_array_equal(problem.start[:, 1:-1], before[:, 2:])
        before = plans
    np.testing.assert_array_equal(one.pending[:-1], one.previous_action[1:])


def test_the_optimum_of_a_quadratic_cost_is_found():
    """Without forces the cost is a quadratic form in the free actions, whose minimum a linear system gives."""
    one = sequences(3)
    increments = np.diff(np.eye(HORIZON), axis=0)
    whole = 2.0 * (4.0 / (HORIZON - 1) * increments.T @ increments + 0.5 / HORIZON * np.eye(HORIZON))
    expected = []
    for k in (1, 2):
        first = one.pending[k]
        free = np.linalg.solve(whole[1:, 1:], -whole[1:, 0][:, None] * first).T
        plans = np.concatenate([first[:, None], free], axis=1)
        form = 0.5 * np.einsum("ni,ij,nj->n", plans, whole, plans)
        expected.append(form + (first - one.previous_action[k]) ** 2)
    nothing = np.zeros((1, 2, 4, HORIZON))
    nothing[0, :, :, 0] = one.pending[1:]
    found = optima(one, (1, 2), nothing, WEIGHTS)
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    assert (gaps(zero_costs(one, (1, 2), WEIGHTS), zero_costs(one, (1, 2), WEIGHTS), found) == 1.0).all()
