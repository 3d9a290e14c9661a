"""The model folder: what is written is read back to the bit, and every kind of damage is refused by name."""

import hashlib
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contract import sensors
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.errors import ConfigError, ModelError, StillwakeError
from contract.model import model_folder
from contract.model.model_folder import DESCRIPTION, MODEL_WEIGHTS, Description
from contract.release.manifest import Scaling
from contract.sensor_layout import SensorLayout

RNG = np.random.default_rng(0)
SCALING = Scaling(
    pressure_mean=tuple(RNG.normal(size=sensors.COUNT).tolist()),
    pressure_std=tuple(RNG.uniform(0.1, 1.0, sensors.COUNT).tolist()),
    action_std=0.04,
    force_mean=(1.0, 0.1),
    force_std=(0.2, 0.7),
)
TENSORS = {
    f"{network}.layer.weight": RNG.normal(size=(2, 3)).astype(np.float32)
    for network in ("encoder", "slim", "dynamics", "decoder", "slim_decoder")
}


def description(**changes) -> Description:
    facts = {
        "config": Config(model=ModelConfig(latent=3)),
        "scaling": SCALING,
        "sensors": ("base_9", "upper_39"),
        "dataset_sha256": "d" * 64,
        "metrics": {"slim": {"r2": 0.9}},
        "ranking": {"method": "shap"},
        "versions": {"torch": "2"},
    }
    return Description(**{**facts, **changes})


@pytest.fixture
def folder(tmp_path):
    model_folder.write(tmp_path / "model", description(), TENSORS)
    return tmp_path / "model"


def test_what_is_written_is_read_back(folder, tmp_path):
    read = model_folder.read(folder)
    found, expected = vars(read.description), vars(description())
    assert found.pop("layout").difference(expected.pop("layout")) is None
    assert found == expected
    assert read.tensors.keys() == TENSORS.keys()
    for name, tensor in TENSORS.items():
        assert read.tensors[name].dtype == np.float32
        np.testing.assert_array_equal(read.tensors[name], tensor)
    # Networks have the names of their own state.
    np.testing.assert_array_equal(read.network("slim")["layer.weight"], TENSORS["slim.layer.weight"])
    assert read.network("slim_dynamics") == {}
    np.testing.assert_array_equal(read.deployed("dynamics")["layer.weight"], TENSORS["dynamics.layer.weight"])
    np.testing.assert_array_equal(read.deployed("decoder")["layer.weight"], TENSORS["slim_decoder.layer.weight"])
    assert read.weights_sha256 == hashlib.sha256((folder / MODEL_WEIGHTS).read_bytes()).hexdigest()
    # A model of the first schema is the truck's.
    body = json.loads((folder / DESCRIPTION).read_text())
    del body["layout"]
    (folder / DESCRIPTION).write_text(json.dumps({**body, "schema": "stillwake-model/1"}))
    assert model_folder.read(folder).description.layout is sensors.TRUCK
    # Another body s sensors are kept with their places.
    layout = SensorLayout.of(("lid", "tail", "tail'"), np.array([[0.0, 0.4], [1.0, 0.2], [1.0, -0.2]]), base=(1, 2))
    scaling = replace(SCALING, pressure_mean=(0.1, 0.2, 0.3), pressure_std=(1.0, 1.0, 1.0))
    model_folder.write(tmp_path / "model", description(layout=layout, scaling=scaling, sensors=("tail",)), TENSORS)
    assert model_folder.read(tmp_path / "model").description.layout.difference(layout) is None
    with pytest.raises(ConfigError, match="unknown sensor 'base_9': the sensors are lid, tail, tail'"):
        description(layout=layout, scaling=scaling)


def rewrite(folder, **changes):
    path = folder / DESCRIPTION
    body = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({key: value for key, value in body.items() if value is not None}))


def test_only_a_model_is_replaced(tmp_path, folder):
    model_folder.write(folder, description(dataset_sha256="e" * 64), TENSORS)
    assert model_folder.read(folder).description.dataset_sha256 == "e" * 64
    (tmp_path / "chapter_1.txt").write_text("years of work")
    with pytest.raises(StillwakeError, match="is not a model directory; name another directory"):
        model_folder.write(tmp_path, description(), TENSORS)
    assert (tmp_path / "chapter_1.txt").read_text() == "years of work"


def test_a_description_that_does_not_fit_is_refused(folder):
    sound = (folder / DESCRIPTION).read_text()
    cases: list[tuple[dict[str, Any], str]] = [
        ({"schema": "stillwake-model/9"}, "schema 'stillwake-model/9'; this version reads 'stillwake-model/2'"),
        ({"weights_sha256": "0" * 64}, r"model\.safetensors was altered \(SHA-256 does not match model\.json\)"),
        ({"sensors": ["base_0", "roof"]}, "unknown sensor 'roof'"),
        ({"scaling": None}, "lacks 'scaling'"),
        ({"layout": {"names": ["a"], "positions": [[0, 0]], "base": [], "mirror": [1]}}, "mirror|out of bounds"),
        ({"layout": {"names": ["a"], "positions": [[0, 0]], "base": [2**64], "mirror": None}}, "int too large"),
        ({"config": {"flow": {"reynold": 1.0}}}, "reynold"),
        ({"scaling": {**vars(SCALING), "force_mean": [1.0]}}, r"scaling\.force_mean has 1 values, must have 2"),
    ]
    for changes, message in cases:
        (folder / DESCRIPTION).write_text(sound)
        rewrite(folder, **changes)
        with pytest.raises(ModelError, match=message) as caught:
            model_folder.read(folder)
        assert str(folder) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_files_that_are_missing_or_something_else_are_refused(folder):
    model_folder.write(folder, description(), {**TENSORS, "critic.weight": np.zeros(2, np.float32)})
    with pytest.raises(ModelError, match=r"unknown tensor critic\.weight"):
        model_folder.read(folder)
    (folder / MODEL_WEIGHTS).write_bytes(b"not tensors")
    rewrite(folder, weights_sha256=hashlib.sha256(b"not tensors").hexdigest())
    with pytest.raises(ModelError, match=r"model\.safetensors is not a safetensors file"):
        model_folder.read(folder)
    (folder / MODEL_WEIGHTS).unlink()
    with pytest.raises(ModelError, match=f"{MODEL_WEIGHTS} cannot be read"):
        model_folder.read(folder)
    (folder / DESCRIPTION).write_text("{")
    with pytest.raises(ModelError, match=r"model\.json is not JSON"):
        model_folder.read(folder)
