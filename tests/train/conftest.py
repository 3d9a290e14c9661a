"""A part of the shipped recording, and networks that train on it in seconds."""

from pathlib import Path

import numpy as np
import pytest
import torch

from contract.config.learning import ModelConfig, TrainConfig
from contract.config.tree import Config
from contract.recording import dataset
from contract.recording.dataset import Dataset, Episode, Role
from contract.recording.episode import PlantFacts
from contract.sensor_layout import SensorLayout
from tests import foreign_plant
from tests.foreign_plant import BASE, LIMIT, NAMES, PERIOD, POSITIONS
from train.networks.samples import Rows, fit_scaling, prepare

# Small networks gain nothing from more, and workers that run beside each other lose.
torch.set_num_threads(1)


@pytest.fixture(scope="session")
def small_config() -> Config:
    """Networks that train in seconds, and few draws of the ranking."""
    return Config(
        model=ModelConfig(window=12, lstm_width=32, dynamics_width=64, decoder_width=32, dropout=0.1),
        train=TrainConfig(
            segment=8, batch_size=256, schedule="one_cycle", learning_rate=5e-3, epochs=2.0, distil_epochs=2.0,
            shap_background=10, shap_explained=30, shap_repeats=2, shap_samples=4,
        ),
    )  # fmt: skip


@pytest.fixture(scope="session")
def small_recording(short_recording: Path) -> Dataset:
    """A forced and an unforced training episode and a test episode, 200 steps each."""
    return dataset.read(short_recording)


LAYOUT = SensorLayout.of(NAMES, np.array(POSITIONS), base=[NAMES.index(name) for name in BASE], symmetric=False)


@pytest.fixture(scope="session")
def foreign_recording() -> Dataset:
    """Of the plant that is not the truck's."""

    def episode(name: str, role: Role, steps: int, *, forced: bool = True) -> Episode:
        values = foreign_plant.series(steps, steps, forced=forced)
        return Episode(name=name, role=role, series=values, initial_action=0.0, provenance={})

    return Dataset(
        episodes=(
            episode("sweep", "train", 700),
            episode("calm", "train", 150, forced=False),
            episode("blink", "train", 20),
            episode("held out", "test", 300),
        ),
        layout=LAYOUT,
        facts=PlantFacts(control_period=PERIOD, action_limit=LIMIT),
    )


@pytest.fixture(scope="session")
def rows(small_recording: Dataset) -> Rows:
    """The training episodes and their mirror images, with all sensors."""
    episodes = small_recording.with_role("train")
    return prepare(episodes, fit_scaling(episodes), mirrored=True)
