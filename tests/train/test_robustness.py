"""Faults change what they say they change, and the sliding error is a plain mean."""

import numpy as np
import pytest
import torch

from contract.errors import ConfigError
from contract.release.bundle import Scaling
from train.robustness import bias, dead, drift, noise, sliding_error
from train.rows import Rows
from train.scaling import global_deviation, unit_steps


@pytest.fixture
def scaling() -> Scaling:
    std = np.linspace(0.05, 0.5, 90)
    return Scaling(
        pressure_mean=(0.0,) * 90,
        pressure_std=tuple(std.tolist()),
        action_std=0.05,
        force_mean=(1.0, 0.0),
        force_std=(0.1, 1.0),
    )


def make_rows(n: int = 4000) -> Rows:
    inputs = torch.randn(n, 3, generator=torch.Generator().manual_seed(1))
    return Rows(inputs=inputs, actions=inputs[:, 2], forces=inputs[:, :2], lengths=(n // 4, n - n // 4))


def test_one_level_is_the_same_pressure_at_every_sensor(scaling: Scaling) -> None:
    assert global_deviation(scaling) == pytest.approx(np.sqrt(np.mean(np.array(scaling.pressure_std) ** 2)))
    chosen = np.array([0, 89])
    physical = unit_steps(scaling, chosen) * np.array(scaling.pressure_std)[chosen]
    assert physical == pytest.approx(global_deviation(scaling))


def test_noise_has_its_level_and_spares_the_action() -> None:
    rows, unit = make_rows(), np.array([1.0, 3.0])
    change = noise(0.5, unit, seed=2)(rows).inputs - rows.inputs
    # 4,000 draws: the deviation of a standard deviation is 1.1 %
    assert change[:, :2].std(dim=0).numpy() == pytest.approx([0.5, 1.5], rel=0.05)
    assert abs(float(torch.corrcoef(change[:, :2].T)[0, 1])) < 0.06
    assert bool((change[:, 2] == 0).all())
    assert torch.equal(noise(0.5, unit, seed=2)(rows).inputs, noise(0.5, unit, seed=2)(rows).inputs)
    assert not torch.equal(noise(0.5, unit, seed=3)(rows).inputs, noise(0.5, unit, seed=2)(rows).inputs)
    with pytest.raises(ConfigError, match=r"noise level -0\.1"):
        noise(-0.1, unit, seed=0)


def test_bias_drift_and_a_dead_sensor_touch_one_column() -> None:
    rows, unit = make_rows(), np.array([2.0, 3.0])
    shift = bias(0.5, unit, 1)(rows).inputs - rows.inputs
    torch.testing.assert_close(shift, torch.tensor([0.0, 1.5, 0.0]).expand_as(shift), atol=1e-6, rtol=0)
    slope = drift(0.5, unit, 0)(rows).inputs - rows.inputs
    for span in rows.spans():
        assert slope[span.start, 0] == 0
        assert float(slope[span.stop - 1, 0]) == pytest.approx(1.0, abs=1e-6)
    assert bool((slope[:, 1:] == 0).all())
    stuck = dead(0)(rows).inputs
    for span in rows.spans():
        assert bool((stuck[span, 0] == rows.inputs[span.start, 0]).all())
    assert torch.equal(stuck[:, 1:], rows.inputs[:, 1:])


def test_the_sliding_error_is_the_mean_over_each_run() -> None:
    generator = torch.Generator().manual_seed(0)
    decoded, reference = torch.randn(50, 2, generator=generator), torch.randn(50, 2, generator=generator)
    found = sliding_error(decoded, reference, 7)
    assert found.shape == (44, 2)
    sigma = reference.numpy().std(axis=0)
    expected = np.abs(decoded - reference).numpy()[12:19].mean(axis=0) / sigma
    assert found[12].numpy() == pytest.approx(expected, rel=1e-5)
    with pytest.raises(ConfigError, match="sliding window of 51 samples"):
        sliding_error(decoded, reference, 51)
