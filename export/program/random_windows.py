"""Windows drawn at random, for the parity gates of programs without a recording."""

import numpy as np

from contract.arrays import Array
from export.program.controller_program import ControllerProgram


def random_window(program: ControllerProgram, rng: np.random.Generator) -> Array:
    """A window (L, S+1) with the roughness of recorded ones: each column a few slow random sines.

    Pressures have the mean and spread of the program's scaling, actions stay within its limit.
    """
    columns = len(program.sensors) + 1
    t = np.arange(program.window)[:, None, None]
    frequency = rng.uniform(0.01, 0.1, (1, columns, 3))
    waves = np.sin(2 * np.pi * (frequency * t + rng.random((1, columns, 3)))).mean(axis=-1)
    pressure = np.array(program.scaling.pressure_mean) + 2.0 * waves[:, :-1] * program.scaling.pressure_std
    return np.column_stack([pressure, waves[:, -1] * program.action_limit])


def random_windows(program: ControllerProgram, count: int, *, seed: int = 0) -> list[Array]:
    """So many windows, each by itself: not consecutive ones."""
    rng = np.random.default_rng(seed)
    return [random_window(program, rng) for _ in range(count)]
