"""Programs whose sizes and settings are drawn at random."""

import numpy as np

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram

NAMES = ("upper_39", "lower_39", "base_0", "base_9", "upper_07", "lower_07")


def drawn_program(seed: int) -> ControllerProgram:
    """Sizes that are mostly no multiple of any padding, and solver settings off their defaults."""
    rng, of_prior = np.random.default_rng([seed, 3]), np.random.default_rng([seed, 4])
    model = ModelConfig(
        window=int(rng.integers(1, 12)),
        latent=int(rng.integers(1, 11)),
        lstm_width=int(rng.integers(1, 40)),
        dynamics_width=int(rng.integers(2, 50)),
        decoder_width=int(rng.integers(2, 40)),
        decoder_blocks=int(rng.integers(1, 4)),
    )
    mpc = MpcConfig(
        horizon=int(rng.integers(2, 36)),
        iterations=int(rng.integers(1, 10)),
        learning_rate=float(10.0 ** rng.uniform(-4, -2)),
        drag_reference=float(rng.uniform(0.5, 1.5)),
        epsilon=float(10.0 ** of_prior.uniform(-8, -2)),
        weights=CostWeights(
            **dict(zip(vars(CostWeights()), [*rng.uniform(0.0, 3.0, 7), of_prior.uniform(0.0, 3.0)], strict=True))
        ),
    )
    limit, sensors = float(rng.uniform(0.02, 0.2)), NAMES[: int(rng.integers(1, 7))]
    memory = 0 if len(sensors) % 2 else int(of_prior.integers(2, 18))
    return random_program(seed, model=model, mpc=mpc, action_limit=limit, sensors=sensors, prior_memory=memory)
