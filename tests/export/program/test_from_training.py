"""Reading what training writes: the networks arrive unchanged, and every kind of damage is refused by name."""

import hashlib
import json

import numpy as np
import pytest
import torch

from contract import sensors
from contract.config.tree import Config, ModelConfig, MpcConfig
from contract.errors import ExportError
from contract.release.bundle import Scaling
from export.program.from_training import DESCRIPTION, WEIGHTS, load_trained
from export.reference.model import decode, encode, step
from train import model_store
from train.model import Encoder, WakeModel

MODEL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8, decoder_blocks=3)
CHOSEN = ("base_9", "upper_39", "base_0", "lower_39")


@pytest.fixture
def trained():
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    return model_store.TrainedModel(
        config=Config(model=MODEL),
        scaling=Scaling(
            pressure_mean=tuple(rng.normal(size=sensors.COUNT).tolist()),
            pressure_std=tuple(rng.uniform(0.1, 1.0, sensors.COUNT).tolist()),
            action_std=0.04,
            force_mean=(1.0, 0.1),
            force_std=(0.2, 0.7),
        ),
        teacher=WakeModel(sensors.COUNT, MODEL).eval(),
        slim=Encoder(len(CHOSEN), MODEL).eval(),
        predictor=None,
        sensors=CHOSEN,
        dataset_sha256="d" * 64,
        metrics={"slim": {"r2": 0.9}},
        ranking={"method": "shap"},
        versions={"torch": torch.__version__},
    )


@pytest.fixture
def directory(trained, tmp_path):
    model_store.save(tmp_path / "model", trained)
    return tmp_path / "model"


def test_the_networks_compute_what_the_trained_modules_do(directory, trained):
    """Float32 modules against the float64 reference: 1e-5."""
    mpc = MpcConfig(horizon=7, iterations=2)
    program = load_trained(directory).program(mpc)
    assert (program.mpc, program.window, program.sensors) == (mpc, 6, CHOSEN)
    assert program.action_limit == trained.config.flow.action_limit
    rng = np.random.default_rng(1)
    chosen = sensors.indices(CHOSEN)
    pressure, action = rng.normal(size=(6, 4)), rng.uniform(-0.07, 0.07, 6)
    scaled = (pressure - np.array(trained.scaling.pressure_mean)[chosen]) / np.array(trained.scaling.pressure_std)[
        chosen
    ]
    rows = torch.tensor(np.column_stack([scaled, action / 0.04]), dtype=torch.float32)
    with torch.no_grad():
        z = trained.slim(rows[None])[0]
        after = trained.deployed.dynamics(z, torch.tensor(0.05 / 0.04))
        forces = trained.deployed.decoder(after).numpy() * trained.scaling.force_std + trained.scaling.force_mean
    found = encode(program, np.column_stack([pressure, action]))
    np.testing.assert_allclose(found, z.numpy(), atol=1e-5)
    found = step(program, found, np.array(0.05))
    np.testing.assert_allclose(found, after.numpy(), atol=1e-5)
    np.testing.assert_allclose(decode(program, found), forces, atol=1e-5)


def test_provenance_carries_what_a_manifest_holds(directory):
    provenance = load_trained(directory).provenance
    assert provenance.dataset_sha256 == "d" * 64
    assert provenance.weights_sha256 == hashlib.sha256((directory / WEIGHTS).read_bytes()).hexdigest()
    assert provenance.training().keys() == {"metrics", "versions", "config"}
    assert provenance.metrics == {"slim": {"r2": 0.9}}
    assert provenance.config["model"]["latent"] == 3
    json.dumps(provenance.training())


def rewrite(directory, **changes):
    path = directory / DESCRIPTION
    body = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({key: value for key, value in body.items() if value is not None}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": "stillwake-model/9"}, "schema 'stillwake-model/9'"),
        ({"weights_sha256": "0" * 64}, "SHA-256 does not match"),
        ({"sensors": ["base_0", "base_1"]}, r"lstm\.weight_ih_l0"),
        ({"sensors": ["base_0", "roof"]}, "unknown sensor 'roof'"),
        ({"scaling": None}, "'scaling' is missing"),
        ({"metrics": None}, "'metrics' is missing"),
        ({"config": {"flow": {"reynold": 1.0}}}, "reynold"),
        ({"scaling": {"pressure_mean": [0.0]}}, "pressure_std"),
    ],
)
def test_a_description_that_does_not_fit_is_refused(directory, changes, message):
    rewrite(directory, **changes)
    with pytest.raises(ExportError, match=message) as caught:
        load_trained(directory).program(MpcConfig())
    assert "\n" not in str(caught.value)


def test_altered_weights_are_refused(directory):
    raw = bytearray((directory / WEIGHTS).read_bytes())
    raw[-1] ^= 1
    (directory / WEIGHTS).write_bytes(raw)
    with pytest.raises(ExportError, match=r"model\.safetensors: SHA-256"):
        load_trained(directory)


@pytest.mark.parametrize("name", [WEIGHTS, DESCRIPTION])
def test_a_missing_file_is_named(directory, name):
    (directory / name).unlink()
    with pytest.raises(ExportError, match=name):
        load_trained(directory)


def test_files_that_are_something_else_are_refused(directory):
    (directory / WEIGHTS).write_bytes(b"not tensors")
    rewrite(directory, weights_sha256=hashlib.sha256(b"not tensors").hexdigest())
    with pytest.raises(ExportError, match=r"model\.safetensors: not a safetensors file"):
        load_trained(directory)
    (directory / DESCRIPTION).write_text("{")
    with pytest.raises(ExportError, match=r"model\.json: not JSON"):
        load_trained(directory)
    (directory / DESCRIPTION).write_text("[]")
    with pytest.raises(ExportError, match="schema None"):
        load_trained(directory)
