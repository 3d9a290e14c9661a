"""From a data set to a linear model folder, and what is refused before anything is written."""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.tree import Config
from contract.errors import ConfigError, DatasetError
from contract.model import linear_model_folder
from contract.recording import dataset
from tests.train.linear.systems import KNOWN, NAMES, PERIOD, episode, recorded
from train.linear.pipeline import PHASES, Design, Identification, identify_all

HOW = Identification(episodes=("run*",), leave_out=20, window=2, ridge=1e-12, sensors=NAMES)
WEIGHTS = Design(action=4.0, differences=2.0, lift=0.5, probe=0.0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "known.h5"
    dataset.write(path, recorded([episode(f"run_{seed}", 400, seed) for seed in range(3)] + [episode("other", 30, 9)]))
    return path


def test_the_folder_holds_the_system_that_was_recorded(recording, tmp_path):
    phases: list[str] = []
    done = identify_all(recording, tmp_path / "m", Config(), HOW, WEIGHTS, phase=phases.append)
    assert tuple(phases) == PHASES
    assert done.episodes == ("run_0", "run_1", "run_2")
    assert done.steps == 3 * (400 - 20 - 2)
    # Pressures are stored with a quantum of 1.2e-4.
    assert min(min(values) for values in done.r2.values()) > 0.999
    assert done.closed_loop < 1.0
    found = linear_model_folder.read(tmp_path / "m")
    np.testing.assert_allclose(found.model, KNOWN, atol=0.02)
    about = found.description
    assert about.config.flow.control_period == PERIOD
    assert about.config.model.window == 2
    # Mirrored sensors share a mean, and so the empty window is a symmetric flow.
    assert about.scaling.pressure_mean[0] == about.scaling.pressure_mean[1]
    assert about.scaling.force_mean[0] == pytest.approx(0.9, abs=0.02)
    assert about.metrics["r2"].keys() == {"1", "10", "25", "50"}


def test_what_cannot_be_identified_leaves_nothing(recording, tmp_path):
    for how, weights, error, named in (
        (replace(HOW, episodes=("none",)), WEIGHTS, DatasetError, "no episode is called none"),
        (replace(HOW, leave_out=400), WEIGHTS, DatasetError, "none is left"),
        (HOW, replace(WEIGHTS, probe=1.0), DatasetError, "'Uy_probe' is missing"),
    ):
        with pytest.raises(error, match=named):
            identify_all(recording, tmp_path / "m", Config(), how, weights)
        assert list(tmp_path.iterdir()) == []
    # Numbers outside their range are refused.
    with pytest.raises(ConfigError, match="window = 1: must be at least 2"):
        Identification(window=1)
    with pytest.raises(ConfigError, match="weight = "):
        Design(lift=-1.0)
