"""From a model folder and a recording to a bundle and a C library: both, or nothing on the disk."""

import re
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
import torch

from contract import sensors
from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.operating_point import OperatingPoint
from contract.config.tree import Config
from contract.errors import ExportError, LibraryError, StillwakeError
from contract.recording import dataset
from contract.recording.dataset import UNITS, Dataset, Episode
from contract.release import bundle
from contract.release.manifest import Scaling
from export.release import pipeline
from export.release.gated import Gated
from export.release.lowering import Lowered, library_of, lower
from export.to_onnx.control_step import build_controller
from firmware_sim.in_c.compiler import host_compiler
from train import model_store
from train.networks.model import Encoder, WakeModel
from train.selection.choice import GIVEN, SensorChoice

pytestmark = pytest.mark.slow  # every lowering is built and gated

MODEL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
CONFIG = Config(model=MODEL, mpc=MpcConfig(horizon=6))
CHOSEN = ("upper_39", "lower_39", "base_0", "base_9")

try:
    host_compiler()
except LibraryError as error:
    pytest.skip(str(error), allow_module_level=True)


@pytest.fixture(scope="module")
def model(tmp_path_factory, metrics):
    """Untrained, but for that as `train` writes it."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("model") / "model"
    trained = model_store.TrainedModel(
        config=CONFIG,
        scaling=Scaling(
            pressure_mean=(-0.4,) * sensors.COUNT,
            pressure_std=(0.2,) * sensors.COUNT,
            action_std=0.04,
            force_mean=(1.0, 0.0),
            force_std=(0.1, 0.8),
        ),
        teacher=WakeModel(sensors.COUNT, MODEL).eval(),
        slim=Encoder(len(CHOSEN), MODEL).eval(),
        predictor=None,
        sensors=CHOSEN,
        dataset_sha256="d" * 64,
        metrics=metrics,
        ranking=SensorChoice(method=GIVEN, order=CHOSEN),
        versions={},
    )
    model_store.save(path, trained)
    return path


def episode(name: str, role: dataset.Role) -> Episode:
    """A swing at the shedding's frequency, long enough for calibration."""
    steps = MODEL.window + pipeline.CALIBRATION_WINDOWS
    phase = 2 * np.pi * 0.04 * np.arange(steps)
    series: dict[str, Array] = {name: np.zeros(steps) for name in UNITS}
    series["t"] = 0.2 * np.arange(steps, dtype=np.float64)
    series["Cp"] = -0.4 + 0.2 * np.sin(phase[:, None] + np.linspace(0.0, 3.0, sensors.COUNT))
    series["action"] = 0.05 * np.cos(phase)
    return Episode(name=name, role=role, series=series, initial_action=0.0, provenance={})


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "recording.h5"
    dataset.write(path, Dataset(episodes=(episode("swing", "train"), episode("chirp", "test"))))
    return path


@pytest.fixture
def export(model, recording, tmp_path):
    def run(**changes) -> Gated:
        settings = {
            "precision": "int8",
            "name": "test",
            "recording": recording,
            "config": CONFIG,
            "c_folder": tmp_path / "c",
            "created": date(2026, 1, 2),
        }
        return pipeline.export_all(model, tmp_path / "bundle", **{**settings, **changes})

    return run


@pytest.mark.parametrize("precision", ["float32", "int8"])
def test_bundle_and_library_are_of_one_program(export, tmp_path, precision):
    gated = export(precision=precision)
    manifest = bundle.load(tmp_path / "bundle").manifest
    stated = re.search(r'SW_PROGRAM_SHA256 "(\w+)"', (tmp_path / "c" / "sw_settings.h").read_text())
    assert stated is not None
    assert (manifest.precision, manifest.program_sha256) == (precision, stated.group(1))
    assert manifest.dataset_sha256 == "d" * 64
    figures = dict(pipeline.gate_figures(gated))
    assert figures["graph against reference: cases"] == pipeline.GATE_WINDOWS
    assert ("int8 C against float32: cases" in figures) == (precision == "int8")


def test_without_a_c_folder_there_is_no_library(export, tmp_path):
    assert export(c_folder=None).library is None
    assert [item.name for item in tmp_path.iterdir()] == ["bundle"]


@pytest.mark.parametrize("broken", ["graph", "library"])
def test_a_lowering_that_fails_its_gate_keeps_both_from_the_disk(export, tmp_path, monkeypatch, broken):
    def lower_wrongly(program, **arguments) -> Lowered:
        """One of the two lowerings optimises once more than the program does."""
        other = replace(program, mpc=replace(program.mpc, iterations=program.mpc.iterations + 1))
        lowered = lower(program, **arguments)
        if broken == "graph":
            return replace(lowered, graph=build_controller(other).SerializeToString())
        return replace(lowered, library=library_of(other, ()))

    monkeypatch.setattr(pipeline, "lower", lower_wrongly)
    with pytest.raises(ExportError, match="and reference differ by"):
        export(precision="float32")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("occupied", ["bundle", "c"])
def test_neither_is_written_where_one_place_holds_something_else(export, tmp_path, occupied):
    (tmp_path / occupied).mkdir()
    (tmp_path / occupied / "thesis.txt").write_text("years of work")
    with pytest.raises(StillwakeError, match="holds something else; name another"):
        export()
    assert sorted(item.name for item in tmp_path.rglob("*")) == sorted([occupied, "thesis.txt"])


def test_a_precision_that_does_not_exist_is_refused(export, tmp_path):
    with pytest.raises(ExportError, match="--precision int4: must be int8 or float32"):
        export(precision="int4")
    assert list(tmp_path.iterdir()) == []


def test_a_step_that_takes_longer_than_a_period_is_refused_before_the_work(export, tmp_path):
    """A rig of 0.1 m at 20 m/s: a period of 0.2 t_c is 1 ms."""
    rig = replace(CONFIG, operating_point=OperatingPoint(width=0.1, speed=20.0, density=1.2))
    phases: list[str] = []
    with pytest.raises(ExportError, match=r"ecu\.compute_time_ms = 8: must be within the control period of 1 ms"):
        export(config=rig, phase=phases.append)
    assert phases == ["read"]
    assert not list(tmp_path.iterdir())


def test_every_phase_is_announced_once_and_in_order(export):
    begun: list[str] = []
    export(c_folder=None, precision="float32", phase=begun.append)
    assert tuple(begun) == pipeline.PHASES
