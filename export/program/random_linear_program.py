"""Linear programs with random numbers, for parity tests and samples; what a step takes depends on the sizes only."""

import numpy as np

from contract.config.controller import MpcConfig
from contract.release.manifest import Scaling
from export.program.linear_program import LinearProgram
from export.program.random_program import SENSORS


def random_linear_program(
    seed: int,
    *,
    window: int = 16,
    mpc: MpcConfig | None = None,
    action_limit: float = 0.075,
    sensors: tuple[str, ...] = SENSORS,
) -> LinearProgram:
    """A program whose differences die out slowly and whose feedback reaches the limit now and then.

    Args:
        seed: of the draw.
        window: L.
        mpc: horizon and weights; the paper's if None.
        sensors: pairs.
    """
    rng = np.random.default_rng(seed)
    columns = len(sensors) // 2 + 1
    model = rng.normal(0.0, 0.3 / np.sqrt(window), (columns, window, columns))
    # Each difference mostly follows its own last value.
    for pair in range(columns - 1):
        model[pair, -1, pair] += 0.7
    gain = rng.normal(0.0, 0.1 / np.sqrt(window), (window, columns))
    gain[-1, -1] = 0.0
    mean = np.repeat(rng.normal(-0.5, 0.2, columns - 1), 2)
    std = np.repeat(rng.uniform(0.05, 0.3, columns - 1), 2)
    return LinearProgram(
        model=model,
        gain=gain,
        scaling=Scaling(
            pressure_mean=tuple(mean.tolist()),
            pressure_std=tuple(std.tolist()),
            action_std=0.6 * action_limit,
            force_mean=(0.8, 0.0),
            force_std=(0.1, 0.5),
        ),
        mpc=MpcConfig() if mpc is None else mpc,
        action_limit=action_limit,
        sensors=sensors,
    )
