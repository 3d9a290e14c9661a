"""A linear model on disk comes back as it was, or is refused by name."""

import json

import numpy as np
import pytest

from contract.config.tree import Config
from contract.errors import ModelError
from contract.model import linear_model_folder
from contract.model.linear_model_folder import DESCRIPTION, LinearDescription
from contract.release.manifest import Scaling

RNG = np.random.default_rng(0)
MODEL = RNG.normal(size=(3, 5, 3))
GAIN = RNG.normal(size=(5, 3)) * (np.arange(15).reshape(5, 3) < 14)
ABOUT = LinearDescription(
    config=Config(),
    sensors=("a", "b", "c", "d"),
    positions=((1.0, 0.5), (1.0, -0.5), (2.0, 0.2), (2.0, -0.2)),
    scaling=Scaling(
        pressure_mean=(-0.5,) * 4, pressure_std=(0.1,) * 4, action_std=0.03, force_mean=(0.8, 0.0), force_std=(0.1, 0.5)
    ),
    identification={"window": 5},
    design={"action": 100.0},
    metrics={"closed_loop": 0.98},
    dataset_sha256="d" * 64,
    versions={"numpy": "2"},
)


@pytest.fixture
def folder(tmp_path):
    linear_model_folder.write(tmp_path / "m", ABOUT, MODEL, GAIN)
    return tmp_path / "m"


def test_it_comes_back_as_it_was(folder):
    found = linear_model_folder.read(folder)
    assert linear_model_folder.is_linear(folder)
    np.testing.assert_array_equal(found.model, MODEL)
    np.testing.assert_array_equal(found.gain, GAIN)
    assert found.description == ABOUT or vars(found.description) == vars(ABOUT)
    assert {"kind": "linear", "design": {"action": 100.0}}.items() <= found.provenance.training().items()


def test_a_description_or_a_gain_that_does_not_fit_is_refused(folder):
    sound = (folder / DESCRIPTION).read_text()
    for changes, message in (
        ({"schema": "stillwake-model/2"}, "'stillwake-model/2', this version reads 'stillwake-linear-model/1'"),
        ({"weights_sha256": "0" * 64}, "model.safetensors was altered"),
        ({"sensors": ["a", "b"]}, r"model \(3, 5, 3\) and gain \(5, 3\) do not fit each other and 2 sensors"),
    ):
        (folder / DESCRIPTION).write_text(json.dumps({**json.loads(sound), **changes}))
        with pytest.raises(ModelError, match=message):
            linear_model_folder.read(folder)
    linear_model_folder.write(folder, ABOUT, MODEL, np.ones_like(GAIN))
    with pytest.raises(ModelError, match="gain has one for its own action"):
        linear_model_folder.read(folder)
