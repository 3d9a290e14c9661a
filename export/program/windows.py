"""The windows of a controller, recorded or random, for gates, calibration and benchmarks."""

import numpy as np

from contract.arrays import Array
from contract.errors import ExportError
from contract.recording.dataset import Episode
from contract.sensor_layout import SensorLayout
from contract.sensors import TRUCK
from export.program.controller_program import ControllerProgram


def recorded_windows(
    program: ControllerProgram, episode: Episode, count: int, layout: SensorLayout = TRUCK
) -> list[Array]:
    """Return the episode's last `count` consecutive windows (L, S+1) of L rows and S sensors; row k is (Cp_k, a_{k-1}).
    The last windows are used because a recording begins with a transient. Raises ConfigError if the layout lacks a
    sensor of the program; ExportError if the episode is too short."""
    needed = program.window + count - 1
    if count < 1 or len(episode) < needed:
        raise ExportError(f"episode {episode.name}: {len(episode)} steps, {count} windows need {needed}")
    rows = episode.rows(layout.indices(program.sensors))[-needed:]
    return [rows[i : i + program.window] for i in range(count)]


def random_window(program: ControllerProgram, rng: np.random.Generator) -> Array:
    """Return a random window (L, S+1) that varies about as fast as recorded windows: each column is a sum of a few slow
    sines. Pressures have the mean and standard deviation of the program's scaling; actions are within the program's
    limit."""
    columns = len(program.sensors) + 1
    t = np.arange(program.window)[:, None, None]
    frequency = rng.uniform(0.01, 0.1, (1, columns, 3))
    waves = np.sin(2 * np.pi * (frequency * t + rng.random((1, columns, 3)))).mean(axis=-1)
    pressure = np.array(program.scaling.pressure_mean) + 2.0 * waves[:, :-1] * program.scaling.pressure_std
    return np.column_stack([pressure, waves[:, -1] * program.action_limit])


def random_windows(program: ControllerProgram, count: int, *, seed: int = 0) -> list[Array]:
    """Return `count` independent random windows, which are not consecutive."""
    rng = np.random.default_rng(seed)
    return [random_window(program, rng) for _ in range(count)]
