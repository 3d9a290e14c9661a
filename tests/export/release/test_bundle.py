"""Releases: what is written loads, answers like the reference and names its program, in the graph and in C alike."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.controller.air_speed import weight_count
from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleControllerError, BundleManifestError, ExportError
from contract.model.model_folder import ModelFolder
from contract.release import bundle, signing
from contract.release.bundle import MadeEstimator
from contract.release.checks import CONTROLLER
from contract.release.manifest import RestingWake, SensorEstimator, SpeedRange
from contract.runtime.onnx_session import OnnxController
from examples.random_programs import random_program
from export.gates import QuantisationLimits
from export.int8.calibrate import rounded_on
from export.int8.rounded_program import rounded_estimator
from export.program.controller_program import ControllerProgram
from export.program.windows import random_window, random_windows
from export.reference.mpc import control_step
from export.release.gated import Gated, gate, lower
from export.release.pipeline import write_release
from export.to_onnx.sensor_estimator import build_estimator
from tests.conftest import model_of
from tests.contract.controller.test_estimator import random_network

FIGURES = SensorEstimator(fast=((0.5,) * 4,) * 4, slow=((0.25,) * 4,) * 4)
LOOSE = QuantisationLimits(rms_action_error=0.01, max_cost_gap=0.01)


@pytest.fixture(scope="module")
def program() -> ControllerProgram:
    model = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
    return random_program(0, model=model, mpc=MpcConfig(horizon=6))


def gated(program, precision) -> Gated:
    windows = random_windows(program, 30)
    program = rounded_on(program, windows) if precision == "int8" else program
    return gate(lower(program, calibration=windows, with_library=False), windows[:3], LOOSE)


def release(path, lowerings: Gated, trained: ModelFolder | None = None, **changes) -> None:
    trained = trained or model_of(lowerings.lowered.effective)
    write_release(path, lowerings, trained, name="test", created=date(2026, 1, 2), config=Config(), **changes)


def test_the_speeds_that_a_prior_was_trained_at_are_the_releases(tmp_path, program):
    resting = RestingWake(speeds=(0.6, 1.4), base=(-0.3, -0.5), swing=(0.1, 0.3))
    trained = model_of(program, resting=np.array([[0.6, -0.3, 0.1], [1.4, -0.5, 0.3]]))
    trained = replace(trained, config_tree={"refine": {"slowest": 0.6, "fastest": 1.4}})
    release(tmp_path / "release", gated(program, "float32"), trained)
    manifest = bundle.load(tmp_path / "release").manifest
    assert manifest.resting == resting
    for changed, refused in (
        ({"speeds": (1.4, 0.6)}, "must rise"),
        ({"base": (-0.3,)}, "resting.base: must have a value for each"),
        ({"base": (-0.3, 0.1)}, "resting.base, of a wake's suction: minus -0.1: must be positive"),
        ({"swing": (0.1, float("nan"))}, "resting.swing: nan"),
    ):
        with pytest.raises(BundleManifestError, match=refused):
            replace(manifest, resting=replace(resting, **changed))
    for weights, refused in (
        ((0.0,) * 4, r"air_speed has 4 weights: must have \d+"),
        ((1e7,) * weight_count(len(manifest.sensors) // 2), "air_speed: 10000000.0 must be in -1e"),
    ):
        with pytest.raises(BundleManifestError, match=refused):
            replace(manifest, window=20, air_speed=weights)
    with pytest.raises(BundleManifestError, match="needs pairs of sensors, and a window of more than 6 rows"):
        replace(manifest, window=5, air_speed=(0.0,))
    assert manifest.speeds == SpeedRange(slowest=0.6, fastest=1.4)
    # 5 steps of the design speed last as long as 9 periods at the slowest.
    assert manifest.past == 10
    with pytest.raises(BundleManifestError, match=r"speeds = 1\.1\.\.1\.4: must include 1"):
        replace(manifest, speeds=SpeedRange(slowest=1.1, fastest=1.4))


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
        release(tmp_path / "release", gated(program, "float32"), estimator=other)
    assert not (tmp_path / "release").exists()
    release(tmp_path / "release", gated(program, "float32"), estimator=made)
    loaded = bundle.load(tmp_path / "release")
    assert loaded.files[ESTIMATOR] == made.graph
    assert loaded.manifest.sensor_estimator == FIGURES
    assert loaded.manifest.provenance["sensor_estimator"] == {"judged_on": ["test"]}


@pytest.mark.parametrize("precision", ["float32", "int8"])
def test_a_written_release_loads_and_controls(tmp_path, program, precision):
    lowerings, name = gated(program, precision), "release"
    report, key = lowerings.graph, Ed25519PrivateKey.generate()
    release(tmp_path / name, lowerings, key=key)
    loaded = bundle.load(tmp_path / name, signing.public_key(key))
    manifest = loaded.manifest
    assert (manifest.sensors, manifest.window, manifest.mpc) == (program.sensors, program.window, program.mpc)
    assert (manifest.scaling, manifest.precision) == (program.scaling, precision)
    assert (manifest.created, manifest.compute_time_ms) == ("2026-01-02", 8.0)
    assert (manifest.dataset_sha256, manifest.weights_sha256) == ("0" * 64, "1" * 64)
    exported = manifest.provenance["export"]
    assert manifest.provenance == {
        "versions": {"torch": "2"},
        "metrics": {"slim": {"r2": 0.9}},
        "config": {},
        "export": exported,
    }
    assert exported["parity"]["action"] == report.parity.action
    assert (report.quantisation is None) == (precision == "float32")

    model = loaded.files[CONTROLLER]
    assert len(model) == report.controller_bytes
    window = random_window(program, np.random.default_rng(3)).astype(np.float32).astype(float)
    effective = lowerings.lowered.effective
    assert isinstance(effective, ControllerProgram)
    found = OnnxController.of(loaded).control_step(window, np.zeros(6), np.ones(6))
    np.testing.assert_allclose(found.plan, control_step(effective, window, np.zeros(6), np.ones(6)).plan, atol=2.5e-5)


def test_rounding_that_changes_too_much_is_refused(program):
    windows = random_windows(program, 30)
    lowered = lower(rounded_on(program, windows), calibration=windows, with_library=False)
    with pytest.raises(ExportError, match=r"int8 weights: rms_action_error is .*, at most 1e-15 is allowed"):
        gate(lowered, windows[:3], QuantisationLimits(rms_action_error=1e-15))
