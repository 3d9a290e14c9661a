"""The lengths that are asked of a recording are those at which the phases of training themselves refuse."""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.learning import FinishConfig
from contract.config.tree import Config
from contract.errors import DatasetError
from contract.recording import needs
from contract.recording.dataset import Dataset
from train.distillation.distil import distil, encode_all
from train.distillation.evaluate import evaluate, rollout_starts
from train.fitting.fit import fit_joint
from train.networks.model import WakeModel
from train.networks.samples import Rows, fit_scaling, prepare


@pytest.fixture
def config(small_config) -> Config:
    return replace(small_config, train=replace(small_config.train, epochs=0.01))


def rows_of(recording: Dataset, steps: int) -> Rows:
    whole = recording.episodes[0]
    short = replace(whole, series={name: values[:steps] for name, values in whole.series.items()})
    return prepare([short], fit_scaling([whole]), mirrored=False)


def test_the_joint_fit(small_recording, config):
    for finish in (0.0, 0.01):
        config = replace(config, train=replace(config.train, finish=FinishConfig(epochs=finish)))
        need = needs.fitting_need(config)
        fit_joint(rows_of(small_recording, need.steps), config)
        short = f"episode training_1 has {need.steps - 1} steps, too short: {need.reason} need {need.steps}"
        with pytest.raises(DatasetError, match=short):
            fit_joint(rows_of(small_recording, need.steps - 1), config)


def test_the_stream(small_recording, config):
    config = replace(config, train=replace(config.train, stream_epochs=0.01, distil_epochs=0.01))
    need = needs.fitting_need(config)
    assert need.steps == 12 - 1 + 64
    teacher, chosen = WakeModel(90, config.model).encoder, np.array([3, 4])
    distil(teacher, rows_of(small_recording, need.steps), chosen, config)
    with pytest.raises(DatasetError, match="too short"):
        distil(teacher, rows_of(small_recording, need.steps - 1), chosen, config)


def test_the_judging_and_the_windows_of_an_episode(small_recording, config):
    need = needs.judging_need(config)
    model = WakeModel(90, config.model).eval()
    # One step more, because a single roll-out has no deviation to compare with.
    evaluate(model.encoder, model, rows_of(small_recording, need.steps + 1))
    assert len(rollout_starts(rows_of(small_recording, need.steps), config.model.window, 25)) == 1
    with pytest.raises(DatasetError, match="too short"):
        evaluate(model.encoder, model, rows_of(small_recording, need.steps - 1))
    for steps in (5, 11, 12, 40):
        latents = encode_all(model.encoder, rows_of(small_recording, steps))
        assert needs.windows_in(steps, config.model.window) == int(np.sum(~latents[:, 0].isnan().numpy()))
