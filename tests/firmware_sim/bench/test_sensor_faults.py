"""Faults change what their descriptions name and nothing else, frame by frame as at once."""

import numpy as np
import pytest

from contract.config.tree import Config
from firmware_sim.bench.sensor_faults import (
    GLOBAL_DEVIATION,
    Bias,
    Dead,
    Drift,
    Noise,
    Quantise,
    SensorDisturbance,
    SensorFault,
    Stuck,
    Swap,
)

STEPS = 4000
READINGS = np.random.default_rng(1).standard_normal((STEPS, 2))
FAULTS: tuple[tuple[SensorDisturbance, tuple[int, ...]], ...] = (
    (Noise(level=0.5), ()),
    (Bias(sensor="", level=0.5), (1,)),
    (Drift(sensor="", level=0.5, over_s=1.0), (0,)),
    (Stuck(sensor=""), (0,)),
    (Dead(sensor=""), (1,)),
    (Swap(sensors=("a", "b")), (0, 1)),
    (Quantise(step=5.0), ()),
)


def begun(one: SensorDisturbance, *at: int, seed: int = 2) -> SensorFault:
    return one.begun(at, Config(), seed)


def test_frame_by_frame_is_as_at_once_and_the_argument_stays():
    readings = READINGS[:80]
    before = readings.copy()
    for one, at in FAULTS:
        at_once = begun(one, *at)(readings)
        fault = begun(one, *at)
        np.testing.assert_array_equal(np.stack([fault(frame) for frame in readings]), at_once, strict=True)
        fault = begun(one, *at)
        np.testing.assert_array_equal(np.vstack([fault(readings[:20]), fault(readings[20:])]), at_once)
        np.testing.assert_array_equal(readings, before)


def test_noise_drift_and_quantisation_have_their_sizes():
    noise = Noise(level=0.5)
    change = begun(noise)(READINGS) - READINGS
    # 4,000 draws: the deviation of a standard deviation is 1.1 %
    assert change.std(axis=0) == pytest.approx([0.5 * GLOBAL_DEVIATION] * 2, rel=0.05)
    assert abs(np.asarray(np.corrcoef(change.T))[0, 1]) < 0.06
    assert not np.array_equal(begun(noise, seed=3)(READINGS), begun(noise)(READINGS))
    fault = begun(noise)
    assert not np.array_equal(fault(READINGS), fault(READINGS))
    # Drift grows evenly over its 100 periods of 20 ms and stays.
    change = begun(Drift(sensor="", level=0.5, over_s=2.0), 0)(np.zeros((200, 2))) / GLOBAL_DEVIATION
    np.testing.assert_allclose(change[:101, 0], np.arange(101) / 200.0, atol=1e-12)
    np.testing.assert_allclose(change[101:, 0], 0.5)
    assert np.all(change[:, 1] == 0.0)
    # A quantised reading is the nearest whole step: 93.75 Pa are 0.25 in Cp.
    found = begun(Quantise(step=93.75))(READINGS)
    np.testing.assert_array_equal(found * 4, np.rint(found * 4))
    assert np.abs(found - READINGS).max() <= 0.125


def test_a_fault_changes_its_own_sensors_alone():
    a, b, c = np.column_stack([READINGS, READINGS[:, 0] + 5.0]).T
    for one, at, expected in (
        (Bias(sensor="", level=0.5), (1,), [a, b + 0.5 * GLOBAL_DEVIATION, c]),
        (Stuck(sensor=""), (0,), [np.full(STEPS, a[0]), b, c]),
        (Dead(sensor=""), (1,), [a, 0.0 * b, c]),
        (Swap(sensors=("a", "c")), (2, 0), [c, b, a]),
    ):
        found = begun(one, *at)(np.column_stack([a, b, c]))
        np.testing.assert_allclose(found, np.column_stack(expected), atol=1e-12, err_msg=str(one))
