"""Faults change what their descriptions name and nothing else, frame by frame as at once."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from contract.errors import ConfigError
from contract.sensor_faults import Bias, Dead, Drift, Noise, Quantised, SensorFault, Stuck, Swapped

UNIT = np.array([2.0, 3.0])
STEPS = 4000
READINGS = np.random.default_rng(1).standard_normal((STEPS, 2))

FAULTS: list[Callable[[], SensorFault]] = [
    lambda: Noise(0.5, UNIT, seed=2),
    lambda: Bias(0.5, UNIT, 1),
    lambda: Drift(0.5, UNIT, 0, steps=STEPS),
    lambda: Stuck(0),
    lambda: Dead(1),
    lambda: Swapped(0, 1),
    lambda: Quantised(0.5),
]


def test_frame_by_frame_is_as_at_once_and_the_argument_stays():
    kinds: list[Any] = [READINGS[:50].astype(np.float32), READINGS[:50]]
    for start in FAULTS:
        for readings in kinds:
            before = readings.copy()
            at_once = start()(readings)
            fault = start()
            one_by_one = np.stack([fault(frame) for frame in readings])
            np.testing.assert_array_equal(one_by_one, at_once, strict=True)
            fault = start()
            np.testing.assert_array_equal(np.vstack([fault(readings[:20]), fault(readings[20:])]), at_once)
            np.testing.assert_array_equal(readings, before)


def test_noise_drift_and_quantisation_have_their_sizes():
    change = Noise(0.5, UNIT, seed=2)(READINGS) - READINGS
    # 4,000 draws: the deviation of a standard deviation is 1.1 %
    assert change.std(axis=0) == pytest.approx([1.0, 1.5], rel=0.05)
    assert abs(np.asarray(np.corrcoef(change.T))[0, 1]) < 0.06
    assert not np.array_equal(Noise(0.5, UNIT, seed=3)(READINGS), Noise(0.5, UNIT, seed=2)(READINGS))
    fault = Noise(0.5, UNIT, seed=2)
    assert not np.array_equal(fault(READINGS), fault(READINGS))
    with pytest.raises(ConfigError, match=r"noise level -0\.1"):
        Noise(-0.1, UNIT, seed=0)
    # Drift grows evenly over its steps and stays.
    change = Drift(0.5, UNIT, 0, steps=101)(np.zeros((200, 2)))
    np.testing.assert_allclose(change[:101, 0], np.arange(101) / 100.0, atol=1e-12)
    assert np.all(change[101:, 0] == 1.0)
    assert np.all(change[:, 1] == 0.0)
    # A quantised reading is the nearest whole step.
    found = Quantised(0.25)(READINGS)
    np.testing.assert_array_equal(found * 4, np.rint(found * 4))
    assert np.abs(found - READINGS).max() <= 0.125


def test_a_fault_changes_its_own_sensors_alone():
    ones, first = np.ones(STEPS), np.full(STEPS, READINGS[0, 0])
    three = np.column_stack([READINGS, READINGS[:, 0] + 5.0])
    for fault, expected in (
        (Bias(0.5, np.array([2.0, 3.0, 1.0]), 1), [three[:, 0], three[:, 1] + 1.5 * ones, three[:, 2]]),
        (Stuck(0), [first, three[:, 1], three[:, 2]]),
        (Dead(1), [three[:, 0], 0.0 * ones, three[:, 2]]),
        (Swapped(2, 0), [three[:, 2], three[:, 1], three[:, 0]]),
    ):
        np.testing.assert_allclose(fault(three), np.column_stack(expected), atol=1e-12, err_msg=str(fault))
