"""From a model of another plant and its recording to a bundle and a C library: both, or nothing on the disk. Speeds,
wakes and estimators of a release are those that were given."""

import hashlib
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleControllerError, BundleError, ExportError
from contract.model import model_folder
from contract.model.model_folder import ModelFolder
from contract.recording import dataset
from contract.recording.dataset import Dataset, Episode, Role
from contract.recording.episode import PlantFacts
from contract.release import bundle, signing
from contract.release.bundle import MadeEstimator
from contract.release.manifest import RestingWake, SensorEstimator, SpeedRange
from contract.runtime.onnx_session import OnnxController
from contract.sensor_layout import SensorLayout
from ecu.bundle_policy import BundlePolicy
from ecu.in_c.host_library import CController
from examples.random_programs import random_program
from export.int8 import rounded_estimator, rounded_on
from export.program.controller_program import ControllerProgram, random_windows
from export.release import pipeline
from export.release.gated import Gated, Lowered, gate, lower
from export.release.pipeline import write_release
from export.to_c.library import c_library
from export.to_onnx.control_step import build_controller
from export.to_onnx.sensor_estimator import build_estimator
from tests import foreign_plant
from tests.conftest import model_of
from tests.contract.controller.test_estimator import random_network
from tests.foreign_plant import LIMIT, NAMES, PERIOD, POSITIONS
from tests.train.conftest import LAYOUT
from tests.untrained_model import untrained
from train import model_store
from train.networks.samples import fit_scaling

pytestmark = pytest.mark.slow  # every lowering is built and gated

MODEL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
CONFIG = Config(
    flow=FlowConfig(control_period=PERIOD, action_limit=LIMIT), model=MODEL, mpc=MpcConfig(horizon=6, iterations=3)
)
KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))
CHOSEN = ("x.y", "tap A", "q'")
FACTS = PlantFacts(control_period=PERIOD, action_limit=LIMIT)


def episode(name: str, role: Role, steps: int) -> Episode:
    return Episode(name=name, role=role, series=foreign_plant.series(steps, steps), initial_action=0.0, provenance={})


EPISODES = (episode("sweep", "train", 200), episode("blink", "train", 20), episode("held out", "test", 80))


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    path: Path = tmp_path_factory.mktemp("recording") / "my.h5"
    dataset.write(path, Dataset(episodes=EPISODES, layout=LAYOUT, facts=FACTS))
    return path


@pytest.fixture(scope="module")
def model(tmp_path_factory, recording) -> Path:
    path: Path = tmp_path_factory.mktemp("model") / "model"
    digest = hashlib.sha256(recording.read_bytes()).hexdigest()
    model_store.save(path, untrained(CONFIG, fit_scaling(EPISODES[:1], LAYOUT), CHOSEN, LAYOUT, digest))
    return path


Export = Callable[..., Gated]


@pytest.fixture
def export(model, recording, tmp_path, monkeypatch) -> Export:
    monkeypatch.setattr(pipeline, "GATE_WINDOWS", 10)

    def run(*, library: bool = False, **changes: Any) -> Gated:
        arguments: dict[str, Any] = {"precision": "int8", "name": "other-plant", "created": date(2026, 1, 2)}
        arguments |= {"recording": recording, "config": CONFIG}
        if library:
            compiled = partial(CController, flags=("-O0",))
            arguments["library"] = pipeline.CLibrary(folder=tmp_path / "c", compiled=compiled)
        return pipeline.export_all(model, tmp_path / "bundle", **{**arguments, **changes})[0]

    return run


def test_bundle_and_library_are_of_one_program_and_run_on_their_plant_and_on_no_other(export, model, tmp_path):
    for precision in ("float32", "int8"):
        begun, lines = list[str](), list[str]()
        gated = export(library=True, precision=precision, named=False, key=KEY, phase=begun.append, notice=lines.append)
        assert lines == []
        read = bundle.load(tmp_path / "bundle")
        stated = re.search(r'SW_PROGRAM_SHA256 "(\w+)"', (tmp_path / "c" / "sw_settings.h").read_text())
        assert stated is not None
        manifest, exported = read.manifest, read.manifest.provenance["export"]
        assert (manifest.precision, manifest.program_sha256) == (precision, stated.group(1))
        assert (exported["quantisation"] is None) == (precision == "float32")
        assert exported["parity"]["action"] == gated.graph.parity["action"]
        figures = dict(pipeline.gate_figures(gated))
        assert figures["graph against reference: cases"] == pipeline.GATE_WINDOWS
        assert ("int8 C against float32: cases" in figures) == (precision == "int8")
        assert tuple(begun) == pipeline.EXPORT_PHASES
    assert read.signer == signing.public_key(KEY)
    assert manifest.sensors == CHOSEN
    assert manifest.sensor_positions == tuple(POSITIONS[NAMES.index(name)] for name in CHOSEN)
    assert (manifest.control_period, manifest.action_limit) == (PERIOD, LIMIT)
    assert (manifest.created, manifest.compute_time_ms, manifest.mpc) == ("2026-01-02", 8.0, CONFIG.mpc)
    about = model_folder.read(model)
    tree, weights, told = about.config_tree, about.weights_sha256, about.description
    assert (manifest.dataset_sha256, manifest.weights_sha256) == (told.dataset_sha256, weights)
    trained = {"versions": told.versions, "metrics": told.metrics, "config": tree}
    assert manifest.provenance == {**trained, "export": exported}
    BundlePolicy(read, OnnxController.of(read), LAYOUT)
    with pytest.raises(BundleError, match=r"'other-plant' is for another plant: unknown sensor 'x\.y'"):
        BundlePolicy(read, OnnxController.of(read))


def test_calibration_leaves_out_what_is_too_short_and_takes_what_there_is():
    program = random_program(0, model=MODEL, mpc=CONFIG.mpc, sensors=CHOSEN)
    windows = pipeline.calibration_windows(program, EPISODES[:2], LAYOUT)
    assert len(windows) == 200 - (MODEL.window - 1)
    # The provenance is any JSON object.
    described = [replace(item, provenance={"forcing_signal": ["sweep", 0.2]}) for item in EPISODES[:2]]
    assert len(pipeline.calibration_windows(program, described, LAYOUT)) == len(windows)
    with pytest.raises(ExportError, match="longest, blink, has 20 steps, but 50 windows need 55; --precision float32"):
        pipeline.calibration_windows(program, EPISODES[1:2], LAYOUT)
    # The gates replay the first test episode that is long enough.
    one, two = pipeline.gate_windows(program, EPISODES[1:], LAYOUT)[-1], EPISODES[2].series["Cp"][-1]
    np.testing.assert_array_equal(one[-1, :-1], two[LAYOUT.indices(CHOSEN)])
    with pytest.raises(ExportError, match="episode blink has 20 steps, but 50 windows need 55"):
        pipeline.gate_windows(program, EPISODES[1:2], LAYOUT)


def other_recording(folder: Path, layout: SensorLayout) -> Path:
    path = folder / "other.h5"
    episodes = (episode("sweep", "train", 150), episode("held out", "test", 90))
    dataset.write(path, Dataset(episodes=episodes, layout=layout, facts=FACTS))
    return path


def test_another_recording_is_taken_if_it_is_named_and_said(export, tmp_path):
    other = other_recording(tmp_path, LAYOUT)
    lines: list[str] = []
    with pytest.raises(ExportError, match=r"other\.h5 .* is not the recording that the model .* with --dataset"):
        export(recording=other, named=False)
    assert not (tmp_path / "bundle").exists()
    export(recording=other, notice=lines.append)
    (line,) = lines
    assert "other.h5" in line
    assert "is not the recording that the model was fitted to" in line
    places = np.array(POSITIONS)
    places[2, 0] = 0.72
    moved = SensorLayout.of(NAMES, places, base=LAYOUT.base.tolist(), symmetric=False)
    with pytest.raises(ExportError, match="the sensors differ: the position of Ø3"):
        export(recording=other_recording(tmp_path, moved))


def test_settings_that_do_not_fit_are_refused_before_the_work(export, tmp_path):
    # A rig of 0.1 m at 20 m/s: a period of 0.3 t_c is 1.5 ms.
    rig = replace(CONFIG, operating_point=OperatingPoint(width=0.1, speed=20.0, density=1.2))
    changes: tuple[tuple[dict[str, Any], str], ...] = (
        ({"config": replace(CONFIG, flow=replace(CONFIG.flow, control_period=0.2))}, "trained with 0.3"),
        ({"config": replace(CONFIG, flow=replace(CONFIG.flow, action_limit=0.075))}, "trained with 0.2"),
        ({"config": rig}, "ecu.compute_time_ms = 8: must be within the control period of 1.5 ms"),
        ({"precision": "int4"}, "--precision int4: must be int8 or float32"),
    )
    for change, message in changes:
        phases: list[str] = []
        with pytest.raises(ExportError, match=re.escape(message)):
            export(**change, phase=phases.append)
        assert phases in ([], ["read"]), message
    assert list(tmp_path.iterdir()) == []


def test_a_lowering_that_fails_its_gate_keeps_both_from_the_disk(export, tmp_path, monkeypatch):
    for broken in ("graph", "library"):

        def lower_wrongly(program: Any, *, of: str = broken, **arguments: Any) -> Lowered:
            """One of the two lowerings optimises once more than the program does."""
            other = replace(program, mpc=replace(program.mpc, iterations=program.mpc.iterations + 1))
            lowered = lower(program, **arguments)
            if of == "graph":
                return replace(lowered, graph=build_controller(other).SerializeToString())
            return replace(lowered, library=c_library(other))

        monkeypatch.setattr(pipeline, "lower", lower_wrongly)
        with pytest.raises(ExportError, match="and reference differ by"):
            export(library=True, precision="float32")
        assert list(tmp_path.iterdir()) == [], broken


FIGURES = SensorEstimator(fast=((0.5,) * 4,) * 4, slow=((0.25,) * 4,) * 4)


@pytest.fixture(scope="module")
def program() -> ControllerProgram:
    model = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
    return random_program(0, model=model, mpc=MpcConfig(horizon=6))


def release(path, program: ControllerProgram, trained: ModelFolder | None = None, **changes) -> None:
    gated = gate(lower(program, calibration=(), with_library=False), random_windows(program, 3))
    trained = trained or model_of(program)
    write_release(path, gated, trained, name="test", created=date(2026, 1, 2), config=Config(), **changes)


def test_the_speeds_that_a_prior_was_trained_at_are_the_releases(tmp_path, program):
    resting = RestingWake(speeds=(0.6, 1.4), base=(-0.3, -0.5), swing=(0.1, 0.3))
    trained = model_of(program, resting=np.array([[0.6, -0.3, 0.1], [1.4, -0.5, 0.3]]))
    trained = replace(trained, config_tree={"refine": {"slowest": 0.6, "fastest": 1.4}})
    # A training without `refine` may have read one file of settings with it.
    release(tmp_path / "release", program, replace(model_of(program), config_tree=trained.config_tree))
    assert bundle.load(tmp_path / "release").manifest.speeds is None
    size = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
    release(tmp_path / "release", random_program(0, model=size, mpc=MpcConfig(horizon=6), prior_memory=4), trained)
    manifest = bundle.load(tmp_path / "release").manifest
    assert manifest.resting == resting
    assert manifest.speeds == SpeedRange(slowest=0.6, fastest=1.4)
    # 5 steps of the design speed last as long as 9 periods at the slowest.
    assert manifest.past == 10


def test_a_sensor_estimator_of_the_controllers_window_is_written_with_its_manifest(tmp_path, program):
    other, made = (
        MadeEstimator(
            graph=build_estimator(
                rounded_estimator(random_network(window=window, sensors=len(program.sensors)))
            ).SerializeToString(),
            figures=FIGURES,
            provenance={"judged_on": ["test"]},
        )
        for window in (program.window + 1, program.window)
    )
    with pytest.raises(BundleControllerError, match="'window' has shape"):
        release(tmp_path / "release", program, estimator=other)
    assert not (tmp_path / "release").exists()
    release(tmp_path / "release", program, estimator=made)
    loaded = bundle.load(tmp_path / "release")
    assert loaded.files[ESTIMATOR] == made.graph
    assert loaded.manifest.sensor_estimator == FIGURES
    assert loaded.manifest.provenance["sensor_estimator"] == {"judged_on": ["test"]}


def test_rounding_that_changes_too_much_is_refused(program):
    windows = random_windows(program, 30)
    lowered = lower(rounded_on(program, windows), calibration=windows, with_library=False)
    with pytest.raises(ExportError, match=r"int8 weights: rms_action_error is .*; at most 1e-15 is allowed"):
        gate(lowered, windows[:3], {"rms_action_error": 1e-15})
