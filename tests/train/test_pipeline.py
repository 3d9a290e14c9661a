"""Recording in, model directory out; interrupted, damaged and unsuitable ones too."""

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from contract import sensors
from contract.config.learning import ModelConfig, TrainConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import ConfigError, ModelError
from contract.recording import dataset
from tests.foreign_plant import LIMIT, NAMES, PERIOD
from tests.train.conftest import LAYOUT
from train import model_store
from train.distillation.evaluate import evaluate
from train.fitting.fit import fit_joint
from train.fitting.progress import Phase
from train.networks.samples import prepare
from train.pipeline import train_all
from train.selection.shap_ranking import SensorChoice

pytestmark = pytest.mark.slow  # whole trainings


@pytest.fixture(scope="module")
def recording(small_recording, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "recording.h5"
    dataset.write(path, small_recording)
    return path


@pytest.fixture(scope="module")
def config(small_config) -> Config:
    """With dynamics and decoder that are distilled, too."""
    narrow = replace(small_config.model, slim_dynamics_width=24, slim_decoder_width=16)
    train = replace(small_config.train, predictor_epochs=0.1, predictor_lessons=512)
    return replace(small_config, model=narrow, train=train)


@pytest.fixture(scope="module")
def stored(recording, config, tmp_path_factory) -> Path:
    """Never written to. Every phase has one thread unless more are asked for, and the caller's are given back."""
    path = tmp_path_factory.mktemp("trained") / "model"
    seen, before = set[tuple[Phase, int]](), torch.get_num_threads()
    torch.set_num_threads(3)
    train_all(recording, config, path, progress=lambda phase, *_: seen.add((phase, torch.get_num_threads())))
    assert torch.get_num_threads() == 3
    torch.set_num_threads(before)
    without = {Phase.FINISH, Phase.SELECT, Phase.STREAM, Phase.REFINE, Phase.REST, Phase.AIR_SPEED}
    assert seen == {(phase, 1) for phase in set(Phase) - without}
    assert [item.name for item in path.parent.iterdir()] == ["model"], "checkpoints are left"
    return path


def test_the_stored_model_is_the_trained_one(stored, recording, small_config, config):
    assert sorted(item.name for item in stored.iterdir()) == ["model.json", "model.safetensors"]
    model = model_store.load(stored)
    assert model.config == config and model.versions["torch_threads"] == "1"
    assert model.predictor is not None and model.predictor.dynamics.hidden.out_features == 24
    assert model.predictor.decoder.output.in_features == 16
    assert len(model.sensors) == 4
    assert list(model.sensors) == list(model.ranking.order[:4])
    whole = dataset.read(recording)
    rows = prepare(whole.with_role("test"), model.scaling, mirrored=False)
    assert evaluate(model.teacher.encoder, model.teacher, rows) == model.metrics.teacher
    slim_rows = rows.with_sensors(sensors.TRUCK.indices(model.sensors))
    assert evaluate(model.slim, model.teacher, slim_rows) == model.metrics.slim
    assert evaluate(model.slim, model.predictor, slim_rows) == model.metrics.deployed
    # The teacher is that of a run that slims the encoder alone.
    alone = fit_joint(prepare(whole.with_role("train"), model.scaling, mirrored=True), small_config)
    for one, two in zip(model.teacher.parameters(), alone.parameters(), strict=True):
        assert torch.equal(one, two)


def test_an_interrupted_run_goes_on_to_the_same_model(stored, recording, config, tmp_path):
    output = tmp_path / "resumed"
    for reached in ("rank", "distil"):

        def interrupt(phase: Phase, step: int, total: int, terms: Mapping[str, float], at: str = reached) -> None:
            if phase == at:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            train_all(recording, config, output, progress=interrupt)
        assert not output.exists()
    phases = []
    train_all(recording, config, output, progress=lambda *args: phases.append(args[0]))
    assert not {"fit", "rank"} & set(phases)
    assert (output / "model.safetensors").read_bytes() == (stored / "model.safetensors").read_bytes()


FOREIGN = Config(
    flow=FlowConfig(control_period=PERIOD, action_limit=LIMIT),
    model=ModelConfig(window=12, lstm_width=16, dynamics_width=24, decoder_width=16, dropout=0.0),
    train=TrainConfig(
        segment=8, batch_size=128, schedule="one_cycle", learning_rate=1e-2, epochs=8.0, distil_epochs=4.0, sensors=3,
        selection="greedy", shap_background=5, shap_explained=10, shap_repeats=1, shap_samples=2,
    ),
)  # fmt: skip


def test_a_model_of_another_plant_predicts_its_forces_and_keeps_its_layout(foreign_recording, tmp_path):
    """Of seven sensors without mirror images."""
    dataset.write(tmp_path / "my.h5", foreign_recording)
    lines, phases = list[str](), set[Phase]()
    said: dict[str, Any] = {"notice": lines.append, "progress": lambda phase, *_: phases.add(phase)}
    trained = train_all(tmp_path / "my.h5", FOREIGN, tmp_path / "model", **said)
    assert [line.split(",")[0] for line in lines] == ["episode blink has 20 steps"]
    # Six seconds of training: lift is nearly linear in every pressure.
    assert trained.metrics.slim.lift.r2 > 0.8
    read = model_store.load(tmp_path / "model")
    assert read.layout.difference(LAYOUT) is None
    assert set(read.sensors) < set(NAMES) and len(read.scaling.pressure_mean) == 7
    assert Phase.SELECT in phases and Phase.RANK not in phases
    assert read.predictor is None and read.metrics.deployed is None
    assert read.ranking == SensorChoice(method="greedy", order=trained.sensors)


def test_what_cannot_be_trained_is_refused_before_training(recording, small_config, tmp_path):
    more = replace(small_config, train=replace(small_config.train, sensors=91))
    cases: list[tuple[Config, dict[str, Any], str]] = [
        (small_config, {"chosen": ["roof_1"]}, "unknown sensor 'roof_1'"),
        (more, {}, "train.sensors = 91: must be from 1 to 90"),
        (small_config, {"device": "tpu"}, "device 'tpu'"),
    ]
    if not torch.cuda.is_available():
        cases.append((small_config, {"device": "cuda"}, "no CUDA"))
    for config, options, message in cases:
        with pytest.raises(ConfigError, match=message):
            train_all(recording, config, tmp_path / "model", progress=lambda *_: pytest.fail("trained"), **options)
        assert not (tmp_path / "model").exists()


def test_a_model_whose_networks_do_not_fit_its_settings_is_refused(stored, tmp_path):
    altered = Path(shutil.copytree(stored, tmp_path / "model"))
    text = (altered / "model.json").read_text()
    (altered / "model.json").write_text(text.replace('"latent": 8', '"latent": 6'))
    with pytest.raises(ModelError, match=r"has shape .*, but the configuration needs"):
        model_store.load(altered)
