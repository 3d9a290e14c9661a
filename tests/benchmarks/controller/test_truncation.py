"""The optimum that truncation is measured against, on small random programs."""

import numpy as np
import pytest

from benchmarks.controller.converged import converged, valleys
from benchmarks.controller.situations import choose_episode
from contract import sensors
from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.recording.dataset import UNITS, Dataset, Episode
from export.program.random_program import random_program
from export.reference.mpc import adam, plan_cost

SMALL = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
HORIZON = 6
GOAL = CostWeights(lift=0.05, lift_mean=0.3, smoothness=4.0, effort=0.5, rate=1.0)
FALLING = 3e-3 * 10.0 ** np.linspace(0.0, -2.0, 120)


def program(seed):
    return random_program(seed, model=SMALL, mpc=MpcConfig(horizon=HORIZON, weights=GOAL))


def situations(seed, n):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 3)), rng.uniform(-0.07, 0.07, (n, HORIZON)), rng.uniform(-0.05, 0.05, n)


@pytest.mark.parametrize("seed", range(4))
def test_no_adam_is_below_the_optimum_and_the_gap_shrinks_with_iterations(seed):
    ours, (z, plans, before) = program(seed), situations(seed, 1)
    found = converged(ours, z[0], before[0], np.zeros((1, HORIZON)), plans, FALLING)
    stages = [plans, *adam(ours, z, plans, before, np.full(50, 1e-3))]
    gaps = [float(plan_cost(ours, z, stages[count], before)[0]) - found.cost for count in (0, 1, 5, 20, 50)]
    assert min(gaps) >= 0.0
    assert gaps == sorted(gaps, reverse=True)
    assert found.cost == pytest.approx(plan_cost(ours, z, found.plan[None], before)[0], abs=1e-13)


def test_a_convex_cost_has_one_valley():
    """The smoothness term alone is convex: one valley, whatever the plans."""
    bowl = random_program(
        0,
        model=SMALL,
        mpc=MpcConfig(horizon=HORIZON, weights=CostWeights(drag_mean=0.0, drag_fluctuation=0.0, lift=0.0)),
    )
    _, plans, _ = situations(0, 4)
    assert valleys(bowl, np.zeros(3), 0.0, plans, gain=1e-9) == 1


def test_an_episode_under_a_controller_comes_before_the_chirp():
    def episode(name, role, signal):
        series = {item: np.zeros((3, sensors.COUNT) if item == "Cp" else 3) for item in UNITS}
        return Episode(name=name, role=role, series=series, initial_action=0.0, provenance={"forcing_signal": signal})

    chirp, driven = episode("chirp", "test", "chirp"), episode("driven", "train", "controlled")
    held_out = episode("held_out", "controlled", "controlled")
    assert choose_episode(Dataset(episodes=(driven, chirp, held_out))) is driven
    assert choose_episode(Dataset(episodes=(chirp, held_out))) is chirp
