"""Faults frame by frame are as at once; `test_simulation.py` has what each does to readings on the bus."""

import numpy as np
import pytest

from contract.config.tree import Config
from firmware_sim.bench.sensor_faults import GLOBAL_DEVIATION, Bias, Dead, Drift, Noise, Quantise, Stuck, Swap

READINGS = np.random.default_rng(1).standard_normal((4000, 2))


def test_frame_by_frame_is_as_at_once_and_the_argument_stays():
    readings = READINGS[:80]
    before = readings.copy()
    for one, at in (
        (Noise(level=0.5), ()),
        (Bias(sensor="", level=0.5), (1,)),
        (Drift(sensor="", level=0.5, over_s=1.0), (0,)),
        (Stuck(sensor=""), (0,)),
        (Dead(sensor=""), (1,)),
        (Swap(sensors=("a", "b")), (0, 1)),
        (Quantise(step=5.0), ()),
    ):
        at_once, singly, halved = (one.begun(at, Config(), 2) for _ in range(3))
        expected = at_once(readings)
        np.testing.assert_array_equal(np.stack([singly(frame) for frame in readings]), expected, strict=True)
        np.testing.assert_array_equal(np.vstack([halved(readings[:20]), halved(readings[20:])]), expected)
        np.testing.assert_array_equal(readings, before)


def test_noise_has_its_size_and_depends_on_the_seed():
    fault, same, other = (Noise(level=0.5).begun((), Config(), seed) for seed in (2, 2, 3))
    change = fault(READINGS) - READINGS
    # 4,000 draws: the deviation of a standard deviation is 1.1 %
    assert change.std(axis=0) == pytest.approx([0.5 * GLOBAL_DEVIATION] * 2, rel=0.05)
    assert abs(np.asarray(np.corrcoef(change.T))[0, 1]) < 0.06
    np.testing.assert_array_equal(same(READINGS) - READINGS, change)
    assert not np.array_equal(other(READINGS) - READINGS, change)
    assert not np.array_equal(fault(READINGS) - READINGS, change)
