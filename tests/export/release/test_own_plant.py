"""From seven sensors of another plant to a bundle and a C library, and what an export refuses about its recording."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import BundleError, ExportError, LibraryError
from contract.recording import dataset
from contract.recording.dataset import Dataset, Episode, Role
from contract.recording.facts import PlantFacts
from contract.release import bundle
from contract.runtime.onnx_session import OnnxController
from contract.sensor_layout import SensorLayout
from export.program.random_program import random_program
from export.release import pipeline
from export.release.gated import Gated
from firmware_sim.ecu.bundle_policy import BundlePolicy
from firmware_sim.in_c.compiler import host_compiler
from tests import foreign_plant
from tests.foreign_plant import BASE, LIMIT, NAMES, PERIOD, POSITIONS
from train import model_store
from train.distillation.evaluate import ModelMetrics
from train.networks.model import Encoder, WakeModel
from train.samples.scaling import fit_scaling
from train.selection.choice import GIVEN, SensorChoice

pytestmark = pytest.mark.slow  # every lowering is built and gated

LAYOUT = SensorLayout.of(NAMES, np.array(POSITIONS), base=[NAMES.index(name) for name in BASE], symmetric=False)
MODEL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
CONFIG = Config(
    flow=FlowConfig(control_period=PERIOD, action_limit=LIMIT), model=MODEL, mpc=MpcConfig(horizon=6, iterations=3)
)
CHOSEN = ("x.y", "tap A", "q'")
FACTS = PlantFacts(control_period=PERIOD, action_limit=LIMIT)

try:
    host_compiler()
except LibraryError as error:
    pytest.skip(str(error), allow_module_level=True)


def episode(name: str, role: Role, steps: int) -> Episode:
    return Episode(name=name, role=role, series=foreign_plant.series(steps, steps), initial_action=0.0, provenance={})


EPISODES = (episode("sweep", "train", 200), episode("blink", "train", 20), episode("held out", "test", 80))


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    path: Path = tmp_path_factory.mktemp("recording") / "my.h5"
    dataset.write(path, Dataset(episodes=EPISODES, layout=LAYOUT, facts=FACTS))
    return path


@pytest.fixture(scope="module")
def model(tmp_path_factory, recording: Path, metrics: ModelMetrics) -> Path:
    """Untrained, but for that as `train` writes it."""
    torch.manual_seed(0)
    path: Path = tmp_path_factory.mktemp("model") / "model"
    model_store.save(
        path,
        model_store.TrainedModel(
            config=CONFIG,
            scaling=fit_scaling(EPISODES[:1], LAYOUT),
            teacher=WakeModel(len(NAMES), MODEL).eval(),
            slim=Encoder(len(CHOSEN), MODEL).eval(),
            predictor=None,
            sensors=CHOSEN,
            dataset_sha256=hashlib.sha256(recording.read_bytes()).hexdigest(),
            metrics=metrics,
            ranking=SensorChoice(method=GIVEN, order=CHOSEN),
            versions={},
            layout=LAYOUT,
        ),
    )
    return path


Export = Callable[..., Gated]


@pytest.fixture
def export(model: Path, recording: Path, tmp_path: Path) -> Export:
    def run(**changes: Any) -> Gated:
        arguments = {
            "precision": "int8",
            "name": "other-plant",
            "recording": recording,
            "config": CONFIG,
            "c_folder": None,
            "created": date(2026, 1, 2),
        }
        return pipeline.export_all(model, tmp_path / "bundle", **{**arguments, **changes})

    return run


def test_a_bundle_of_another_plant_runs_on_that_plant_and_on_no_other(export: Export, tmp_path: Path) -> None:
    lines: list[str] = []
    export(c_folder=tmp_path / "c", named=False, notice=lines.append)
    assert lines == []
    read = bundle.load(tmp_path / "bundle")
    assert read.manifest.sensors == CHOSEN
    assert read.manifest.sensor_positions == tuple(POSITIONS[NAMES.index(name)] for name in CHOSEN)
    assert (read.manifest.control_period, read.manifest.action_limit) == (PERIOD, LIMIT)
    assert (tmp_path / "c" / "sw_settings.h").is_file()

    policy = BundlePolicy(read, OnnxController.of(read), LAYOUT)
    memory, held_out = policy.start(), EPISODES[2]
    commands = []
    for Cp, action in zip(held_out.series["Cp"][:20], held_out.previous_action[:20], strict=True):
        command, memory = policy.step(memory, Cp, float(action))
        commands.append(command)
    assert commands[: MODEL.window - 1] == [0.0] * (MODEL.window - 1)
    assert all(0 < abs(command) <= LIMIT for command in commands[MODEL.window :])
    with pytest.raises(BundleError, match=r"'other-plant' is of another plant: unknown sensor 'x\.y'"):
        BundlePolicy(read, OnnxController.of(read))


def test_calibration_leaves_out_what_is_too_short_and_takes_what_there_is() -> None:
    program = random_program(0, model=MODEL, mpc=CONFIG.mpc, sensors=CHOSEN)
    windows = pipeline.calibration_windows(program, EPISODES[:2], LAYOUT)
    assert len(windows) == 200 - (MODEL.window - 1)
    with pytest.raises(ExportError, match="longest, blink, has 20 steps, 50 windows need 55; --precision float32"):
        pipeline.calibration_windows(program, EPISODES[1:2], LAYOUT)


def test_gates_replay_the_first_test_episode_that_is_long_enough() -> None:
    program = random_program(0, model=MODEL, mpc=CONFIG.mpc, sensors=CHOSEN)
    one, two = pipeline.gate_windows(program, EPISODES[1:], LAYOUT)[-1], EPISODES[2].series["Cp"][-1]
    np.testing.assert_array_equal(one[-1, :-1], two[LAYOUT.indices(CHOSEN)])
    with pytest.raises(ExportError, match="episode blink: 20 steps, 50 windows need 55"):
        pipeline.gate_windows(program, EPISODES[1:2], LAYOUT)


def other_recording(folder: Path, layout: SensorLayout) -> Path:
    path = folder / "other.h5"
    episodes = (episode("sweep", "train", 150), episode("held out", "test", 90))
    dataset.write(path, Dataset(episodes=episodes, layout=layout, facts=FACTS))
    return path


def test_another_recording_is_taken_if_it_is_named_and_said(export: Export, tmp_path: Path) -> None:
    other = other_recording(tmp_path, LAYOUT)
    lines: list[str] = []
    with pytest.raises(ExportError, match=r"other\.h5 .* is not the recording that the model .* with --dataset"):
        export(recording=other, named=False)
    assert not (tmp_path / "bundle").exists()
    export(recording=other, notice=lines.append)
    (line,) = lines
    assert "other.h5" in line
    assert "is not the recording that the model was fitted to" in line


def test_a_recording_of_other_sensors_is_refused(export: Export, tmp_path: Path) -> None:
    places = np.array(POSITIONS)
    places[2, 0] = 0.72
    moved = SensorLayout.of(NAMES, places, base=LAYOUT.base.tolist(), symmetric=False)
    with pytest.raises(ExportError, match="of other sensors, in the position of Ø3"):
        export(recording=other_recording(tmp_path, moved))


@pytest.mark.parametrize(
    ("flow", "message"),
    [
        ({"control_period": 0.2}, r"flow\.control_period = 0\.2 in the settings, the model was trained with 0\.3"),
        ({"action_limit": 0.075}, r"flow\.action_limit = 0\.075 in the settings, the model was trained with 0\.2"),
    ],
)
def test_another_clock_or_limit_than_the_model_s_is_refused(export: Export, flow: Any, message: str) -> None:
    with pytest.raises(ExportError, match=message):
        export(config=replace(CONFIG, flow=replace(CONFIG.flow, **flow)))
