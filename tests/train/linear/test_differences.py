"""Pairs of mirror images, and which episodes are taken."""

import numpy as np
import pytest

from contract.errors import ConfigError, DatasetError
from contract.sensors import TRUCK
from tests.train.linear.systems import LAYOUT, NAMES, episode, simulated
from train.linear.differences import SENSORS, check_pairs, chosen_episodes, series_of


def test_rows_are_differences_of_pairs_of_mirror_images():
    check_pairs(TRUCK, SENSORS)
    for sensors, error, named in (
        (("up", "left"), DatasetError, "up and left are no pair: the mirror image of up is down"),
        (("up", "under"), ConfigError, "unknown sensor 'under'"),
        (SENSORS, DatasetError, "of another body than the truck: name pairs of its sensors with --sensors"),
    ):
        with pytest.raises(error, match=named):
            check_pairs(LAYOUT, sensors)
    # Rows are differences and actions without the transient.
    found = series_of(episode("one", 50, 0), LAYOUT, NAMES, ("Cl",), 10)
    rows, lift = simulated(50, 0)
    np.testing.assert_allclose(found.rows, rows[10:], atol=1e-12)
    np.testing.assert_allclose(found.responses[:, 0], lift[10:])
    with pytest.raises(DatasetError, match="50 steps, of which the first 50 are left out"):
        series_of(episode("one", 50, 0), LAYOUT, NAMES, ("Cl",), 50)
    with pytest.raises(DatasetError, match="'Uy_probe' is missing; give it no weight"):
        series_of(episode("one", 50, 0), LAYOUT, NAMES, ("Cl", "Uy_probe"), 0)
    # Episodes are chosen by patterns.
    episodes = [episode(name, 5, 0) for name in ("controlled_1", "free", "controlled_2")]
    assert [item.name for item in chosen_episodes(episodes, ["controlled*"])] == ["controlled_1", "controlled_2"]
