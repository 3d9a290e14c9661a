"""Encoder windows out of a recording, for gates, calibration and benchmarks."""

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
    """The episode's last `count` windows (L, S+1), consecutive ones, with rows (Cp_k, a_{k-1}).

    The last ones, because a recording's start is a transient. Raises ConfigError if the program has a sensor that the
    layout has not; ExportError if the episode is too short.
    """
    needed = program.window + count - 1
    if count < 1 or len(episode) < needed:
        raise ExportError(f"episode {episode.name}: {len(episode)} steps, {count} windows need {needed}")
    pressure = episode.series["Cp"][:, layout.indices(program.sensors)]
    rows = np.column_stack([pressure, episode.previous_action])[-needed:]
    return [rows[i : i + program.window] for i in range(count)]
