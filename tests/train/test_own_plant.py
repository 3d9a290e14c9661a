"""A plant of seven sensors without mirror images: rows, scaling and selection know nothing of the truck."""

from typing import Any

import pytest
import torch

from contract.config.learning import ModelConfig, TrainConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import ConfigError
from contract.recording import dataset
from tests.foreign_plant import LIMIT, NAMES, PERIOD
from tests.train.conftest import LAYOUT
from train import model_store
from train.fitting.progress import Phase
from train.networks.samples import fit_scaling, prepare
from train.pipeline import train_all
from train.selection.shap_ranking import SensorChoice

CONFIG = Config(
    flow=FlowConfig(control_period=PERIOD, action_limit=LIMIT),
    model=ModelConfig(window=12, lstm_width=16, dynamics_width=24, decoder_width=16, dropout=0.0),
    train=TrainConfig(
        segment=8, batch_size=128, schedule="one_cycle", learning_rate=1e-2, epochs=8.0, distil_epochs=4.0, sensors=3,
        selection="greedy", shap_background=5, shap_explained=10, shap_repeats=1, shap_samples=2,
    ),
)  # fmt: skip


def test_without_mirror_images_scaling_is_that_of_the_recording_alone(foreign_recording):
    episodes = foreign_recording.with_role("train")
    rows = prepare(episodes, fit_scaling(episodes, LAYOUT), mirrored=False, layout=LAYOUT)
    assert rows.inputs.shape == (870, 8)
    torch.testing.assert_close(rows.inputs[:, :7].mean(dim=0), torch.zeros(7), rtol=0, atol=1e-5)
    # An action is not shifted: none stays zero.
    assert rows.actions[-100:-20].abs().max() == 0.0
    with pytest.raises(ConfigError, match="no mirror images"):
        prepare(
            foreign_recording.episodes, fit_scaling(foreign_recording.episodes, LAYOUT), mirrored=True, layout=LAYOUT
        )


@pytest.mark.slow  # a whole training
def test_a_model_of_it_predicts_its_forces_and_keeps_its_layout_and_the_choice_of_sensors(foreign_recording, tmp_path):
    dataset.write(tmp_path / "my.h5", foreign_recording)
    lines, phases = list[str](), set[Phase]()
    said: dict[str, Any] = {"notice": lines.append, "progress": lambda phase, *_: phases.add(phase)}
    trained = train_all(tmp_path / "my.h5", CONFIG, tmp_path / "model", **said)
    assert [line.split(",")[0] for line in lines] == ["episode blink has 20 steps"]
    # Six seconds of training: lift is nearly linear in every pressure.
    assert trained.metrics.slim.lift.r2 > 0.8
    read = model_store.load(tmp_path / "model")
    assert read.layout.difference(LAYOUT) is None
    assert set(read.sensors) < set(NAMES)
    assert len(read.scaling.pressure_mean) == 7
    assert Phase.SELECT in phases and Phase.RANK not in phases
    assert read.predictor is None and read.metrics.deployed is None
    assert read.ranking == SensorChoice(method="greedy", order=trained.sensors)
