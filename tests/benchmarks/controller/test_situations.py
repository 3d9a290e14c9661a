"""Windows of an episode and the plans that recede over them, against the reference step by step."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from benchmarks.controller.situations import LEAD, encode_windows, receding, snapshot_steps
from contract import sensors
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.recording.dataset import UNITS, Episode
from export.program.random_program import random_program
from export.program.recorded_windows import recorded_windows
from export.reference.model import encode
from export.reference.mpc import optimise, shift

PROGRAM = random_program(
    0,
    model=ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8),
    mpc=MpcConfig(horizon=6, iterations=2),
)


def episode(steps: int) -> Episode:
    rng = np.random.default_rng(0)
    series = {name: rng.normal(size=(steps, sensors.COUNT) if name == "Cp" else steps) for name in UNITS}
    return Episode(name="one", role="test", series=series, initial_action=0.0, provenance={})


def test_snapshots_span_the_episode_and_each_has_its_lead():
    one = episode(60)
    steps = snapshot_steps(PROGRAM, one, 3)
    assert steps.shape == (LEAD + 1, 3)
    assert steps.min() == 0 and steps.max() == len(one) - PROGRAM.window
    assert (np.diff(steps, axis=0) == 1).all()


def test_windows_are_encoded_one_by_one_with_the_action_before_them():
    one = episode(60)
    steps = snapshot_steps(PROGRAM, one, 2)
    z, previous_action = encode_windows(PROGRAM, one, steps)
    windows = recorded_windows(PROGRAM, one, len(one) - PROGRAM.window + 1)
    for i in np.ndindex(steps.shape):
        np.testing.assert_allclose(z[i], encode(PROGRAM, windows[steps[i]]), rtol=1e-12, atol=1e-14)
        assert previous_action[i] == one.previous_action[steps[i] + PROGRAM.window - 1]


def test_each_plan_starts_from_the_one_before_it():
    rng = np.random.default_rng(1)
    z, previous_action = rng.normal(size=(4, 2, 3)), rng.uniform(-0.05, 0.05, (4, 2))
    rate = PROGRAM.mpc.learning_rate
    plans = receding(PROGRAM, z, previous_action, np.array([rate, 10.0 * rate]))
    assert plans.shape == (4, 2, 6)
    np.testing.assert_allclose(plans[0], optimised(z[0], np.zeros(6), previous_action[0], rate), atol=1e-12)
    for k, (before, after) in enumerate(pairwise(plans), start=1):
        np.testing.assert_allclose(after, optimised(z[k], shift(before), previous_action[k], rate), atol=1e-12)


def optimised(z, starts, previous_action, rate):
    return [
        optimise(at_rate(factor * rate), z[i], np.broadcast_to(starts, (2, 6))[i], float(previous_action[i]))
        for i, factor in enumerate((1.0, 10.0))
    ]


def at_rate(rate):
    return replace(PROGRAM, mpc=replace(PROGRAM.mpc, learning_rate=rate))
