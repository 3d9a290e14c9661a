"""Windows cut from a recording: the right columns, the right action with each row, the right end."""

from itertools import pairwise

import numpy as np
import pytest

from contract import sensors
from contract.arrays import Array
from contract.config.learning import ModelConfig
from contract.errors import ExportError
from contract.recording.dataset import UNITS, Episode
from examples.random_programs import random_program
from export.program.recorded_windows import recorded_windows

PROGRAM = random_program(0, model=ModelConfig(window=3, lstm_width=2, dynamics_width=4, decoder_width=4))


def episode(steps: int) -> Episode:
    series: dict[str, Array] = {name: np.zeros(steps) for name in UNITS}
    step = np.arange(steps, dtype=np.float64)
    series["Cp"] = 100.0 * step[:, None] + np.arange(sensors.COUNT)
    series["action"] = 0.001 * step
    return Episode(name="chirp", role="test", series=series, initial_action=-0.05, provenance={})


def test_rows_pair_pressures_with_the_action_before_them():
    *_, last = recorded_windows(PROGRAM, episode(6), 2)
    # upper_39, lower_39, base_0, base_9 are sensors 39, 79, 80, 89.
    np.testing.assert_array_equal(last[-1, :4], [539, 579, 580, 589])
    np.testing.assert_allclose(last[:, -1], [0.002, 0.003, 0.004])
    # Windows are consecutive and reach back to the action in force at the start.
    windows = recorded_windows(PROGRAM, episode(6), 4)
    assert windows[0][0, -1] == -0.05
    for earlier, later in pairwise(windows):
        np.testing.assert_array_equal(earlier[1:], later[:-1])
    # An episode that is too short is refused.
    for count in (0, 5):
        with pytest.raises(ExportError, match="episode chirp: 6 steps"):
            recorded_windows(PROGRAM, episode(6), count)
