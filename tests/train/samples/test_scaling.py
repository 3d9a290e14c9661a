"""Scaling against its mirror image, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from contract import sensors
from contract.errors import DatasetError
from contract.recording.dataset import Episode
from train.samples.rows import fit_scaling, prepare


def with_series(episode: Episode, **series: np.ndarray) -> Episode:
    return replace(episode, series={**episode.series, **series})


def test_scaling_commutes_with_mirroring(small_recording):
    scaling = fit_scaling(small_recording.with_role("train"))
    (episode,) = small_recording.with_role("test")
    reflected = replace(
        with_series(
            episode,
            action=-episode.series["action"],
            Cl=-episode.series["Cl"],
            Cp=episode.series["Cp"][:, np.array(sensors.TRUCK.mirror)],
        ),
        initial_action=-episode.initial_action,
    )
    both = prepare([episode], scaling, mirrored=True)
    direct = prepare([reflected], scaling, mirrored=False)
    half = len(episode)
    for name in ("inputs", "actions", "forces"):
        torch.testing.assert_close(getattr(both, name)[half:], getattr(direct, name), rtol=1e-5, atol=1e-5)
    assert scaling.force_mean[1] == 0.0
    mirror = np.array(sensors.TRUCK.mirror)
    np.testing.assert_array_equal(np.array(scaling.pressure_mean)[mirror], scaling.pressure_mean)


def test_a_signal_that_never_changes_is_refused(small_recording):
    for series, message in (("Cp", "sensor upper_03 is constant at 0.25"), ("Cl", "Cl is constant")):
        stuck = []
        for episode in small_recording.with_role("train"):
            values = episode.series[series].copy()
            values[(slice(None), 3) if series == "Cp" else slice(None)] = 0.25 if series == "Cp" else 0.0
            stuck.append(with_series(episode, **{series: values}))
        with pytest.raises(DatasetError, match=message):
            fit_scaling(stuck)
