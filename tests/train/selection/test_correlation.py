"""Pearson correlations against SciPy's and against signals whose correlation is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import pearsonr

from contract.errors import ConfigError, DatasetError
from contract.recording.dataset import Dataset
from train.selection.correlation import correlation


def test_all_pairs_are_scipy_s_over_the_joined_episodes(small_recording: Dataset) -> None:
    names = ["base_0", "upper_10", "lower_39"]
    episodes = small_recording.with_role("train")
    found = correlation(episodes, names)
    joined = np.concatenate([episode.series["Cp"] for episode in episodes])
    for i, one in enumerate((80, 10, 79)):
        for j, two in enumerate((80, 10, 79)):
            assert found[i, j] == pytest.approx(pearsonr(joined[:, one], joined[:, two]).statistic, abs=1e-12)


def test_known_signals_and_one_sensor(small_recording: Dataset) -> None:
    episode = small_recording.episodes[0]
    t = 2 * np.pi * np.arange(300) / 300
    Cp = episode.series["Cp"].copy()
    Cp[:, 0], Cp[:, 1], Cp[:, 2] = np.sin(t), np.sin(t + np.pi / 3), -np.sin(t)
    known = replace(episode, series={**episode.series, "Cp": Cp})
    expected = [[1.0, 0.5, -1.0], [0.5, 1.0, -0.5], [-1.0, -0.5, 1.0]]
    np.testing.assert_allclose(correlation([known], ["upper_00", "upper_01", "upper_02"]), expected, atol=1e-12)
    np.testing.assert_allclose(correlation([known], ["upper_00"]), [[1.0]])
    Cp[:, 4] = 0.3
    with pytest.raises(DatasetError, match="sensor upper_04 is constant"):
        correlation([replace(known, series={**known.series, "Cp": Cp})], ["upper_00", "upper_04"])
    with pytest.raises(ConfigError, match="unknown sensor 'roof'"):
        correlation([known], ["roof"])
