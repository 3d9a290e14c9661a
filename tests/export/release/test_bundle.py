"""Releases: speeds, wakes and estimators are those that were given, and what does not fit is not written."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.controller.air_speed import weight_count
from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleControllerError, BundleManifestError, ExportError
from contract.model.model_folder import ModelFolder
from contract.release import bundle
from contract.release.bundle import MadeEstimator
from contract.release.manifest import RestingWake, SensorEstimator, SpeedRange
from examples.random_programs import random_program
from export.gates import QuantisationLimits
from export.int8 import rounded_estimator, rounded_on
from export.program.controller_program import ControllerProgram
from export.program.windows import random_windows
from export.release.gated import gate, lower
from export.release.pipeline import write_release
from export.to_onnx.sensor_estimator import build_estimator
from tests.conftest import model_of
from tests.contract.controller.test_estimator import random_network

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
    release(tmp_path / "release", program, trained)
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
    with pytest.raises(ExportError, match=r"int8 weights: rms_action_error is .*, at most 1e-15 is allowed"):
        gate(lowered, windows[:3], QuantisationLimits(rms_action_error=1e-15))
