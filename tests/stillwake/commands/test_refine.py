"""`refine` on a coarse mesh, and its model through `export`: what it learned is where the controller starts."""

import hashlib

import numpy as np
import pytest

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.model import model_folder
from contract.recording import dataset
from export.program.controller_program import program_of
from export.reference.mpc import starting_plan
from tests.untrained_model import untrained
from train import model_store
from train.networks.samples import fit_scaling

pytestmark = pytest.mark.slow  # numba compiles the adjoint

SENSORS = ("upper_30", "lower_30", "base_0", "base_9")  # not the sensors that are chosen by hand
MODEL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
SMALL = tuple(
    word
    for setting in (
        *("memory=8", "units=3", "updates=4", "shortest=16", "longest=16", "streams=1", "refinement=0.4"),
        *("substeps=10", "single_precision=false"),  # double precision is compiled for other tests
    )
    for word in ("--set", f"refine.{setting}")
)


@pytest.fixture
def model(tmp_path, short_recording):
    """With the sensors of the refinement."""
    recording, digest = dataset.read(short_recording), hashlib.sha256(short_recording.read_bytes()).hexdigest()
    scaling = fit_scaling(recording.episodes[:1], recording.layout)
    made = untrained(Config(model=MODEL, mpc=MpcConfig(horizon=6)), scaling, SENSORS, recording.layout, digest)
    model_store.save(tmp_path / "model", made)
    return tmp_path / "model"


def test_a_refined_model_is_exported_and_its_prior_acts(cli, printed, tmp_path, model, short_recording):
    data = ("--dataset", short_recording)
    odd = cli("refine", tmp_path / "odd", "--model", model, "--sensors", "upper_39,base_0", *data, *SMALL)
    assert odd.code == 1 and "upper_39 and base_0 are not a pair" in odd.err
    inside = cli("refine", model / "odd", "--model", model, *data, *SMALL)
    assert f"{model / 'odd'} is the same path as {model}, or lies in it" in inside.err
    other = cli("refine", tmp_path / "odd", "--model", model, "--dataset", model / "model.json", *SMALL)
    assert "model.json is not the recording that the model was fitted to" in other.err
    out = printed("refine", tmp_path / "refined", "--model", model, *data, *SMALL, "--json", tmp_path / "refined.json")
    assert "64 control periods of the plant" in out
    assert not (tmp_path / "refined.checkpoints").exists()
    folder = model_folder.read(tmp_path / "refined")
    config = folder.description.config
    assert config.refine.memory == 8 and folder.description.sensors == SENSORS
    # The optimiser's steps are those of a plan that starts from a prior; the horizon is the model's.
    assert (config.mpc.epsilon, config.mpc.horizon) == (load_config().mpc.epsilon, 6)
    program = program_of(folder, config.mpc)
    assert program.prior is not None and (program.window, program.encoder_rows) == (8, 6)
    window = np.random.default_rng(0).normal(-0.3, 0.2, (8, 5))
    start = starting_plan(program, window, np.zeros(6), np.array([0.0, *np.ones(5)]))
    assert start[0] == 0.0 and 0.0 < np.abs(start[1:]).max() < 0.075
    again = model_store.load(tmp_path / "refined")
    assert again.prior is not None
    assert set(again.prior) == {"filters", "first", "gate", "sums", "output", "predictor"}
    printed("refine", tmp_path / "more", "--model", tmp_path / "refined", *data, "--set", "train.seed=1")
    changed = model_store.load(tmp_path / "more")
    assert changed.config.train.seed == 1 and changed.prior is not None
    assert not np.array_equal(changed.prior["output"], again.prior["output"])
    printed("export", tmp_path / "refined", tmp_path / "bundle", "--precision", "float32", *data)
