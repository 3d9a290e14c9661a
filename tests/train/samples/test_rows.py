"""Rows against the episodes they are made of."""

from dataclasses import replace

import pytest
import torch

from contract import sensors
from train.samples.rows import fit_scaling, prepare


def test_rows_are_standardised_with_the_action_before_them(rows):
    for values in (rows.inputs[:, : sensors.COUNT], rows.actions[:, None], rows.forces):
        torch.testing.assert_close(values.mean(dim=0), torch.zeros(values.shape[1]), rtol=0, atol=1e-5)
        torch.testing.assert_close(values.std(dim=0, correction=0), torch.ones(values.shape[1]), rtol=1e-5, atol=0)
    # Chosen sensors keep their order and the action.
    slim = rows.with_sensors(sensors.TRUCK.indices(["base_9", "upper_02"]))
    assert torch.equal(slim.inputs, rows.inputs[:, [89, 2, 90]])


def test_a_row_holds_the_pressures_and_the_action_before_them(make_episode):
    episode = replace(make_episode("one", "train", 20, 1), initial_action=0.03)
    scaling = fit_scaling([episode])
    rows = prepare([episode], scaling, mirrored=False)
    for k in (0, 1, 13):
        before = 0.03 if k == 0 else episode.series["action"][k - 1]
        assert rows.inputs[k, -1].item() == pytest.approx(before / scaling.action_std, rel=1e-6)
        assert rows.actions[k].item() == pytest.approx(episode.series["action"][k] / scaling.action_std, rel=1e-6)
        physical = rows.inputs[k, 55].item() * scaling.pressure_std[55] + scaling.pressure_mean[55]
        assert physical == pytest.approx(episode.series["Cp"][k, 55], rel=1e-5)
