"""Releases: what is written loads and answers like the reference; what fails a gate is not written at all."""

import re
from datetime import date

import numpy as np
import onnxruntime
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.config.tree import ModelConfig, MpcConfig
from contract.errors import ExportError, StillwakeError
from contract.operating_point import OperatingPoint
from contract.release import bundle, signing
from export.gates.quantisation import QuantisationLimits
from export.int8.nearest import quantise
from export.program.controller_program import ControllerProgram
from export.program.random_program import random_program, random_window
from export.reference.mpc import control_step
from export.release.bundle import ReleaseReport, write_release
from export.release.c_folder import int8_library
from export.to_c.library import c_library

LOOSE = QuantisationLimits(rms_action_error=0.01, max_cost_gap=0.01)


@pytest.fixture(scope="module")
def program() -> ControllerProgram:
    model = ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8)
    return random_program(0, model=model, mpc=MpcConfig(horizon=6))


def release(path, program, **changes) -> ReleaseReport:
    settings = {
        "precision": "int8",
        "name": "test",
        "operating_point": OperatingPoint(),
        "budget_ms": 20.0,
        "compute_time_ms": 8.0,
        "control_period": 0.2,
        "created": date(2026, 1, 2),
        "dataset_sha256": "0" * 64,
        "weights_sha256": "1" * 64,
        "provenance": {"versions": {"torch": "2"}},
        "limits": LOOSE,
    }
    return write_release(path, program, **{**settings, **changes})


@pytest.mark.parametrize("name", ["release", "release.zip"])
@pytest.mark.parametrize("precision", ["float32", "int8"])
def test_a_written_release_loads_and_controls(tmp_path, program, name, precision):
    report = release(tmp_path / name, program, precision=precision)
    loaded = bundle.load(tmp_path / name)
    manifest = loaded.manifest
    assert (manifest.sensors, manifest.window, manifest.mpc) == (program.sensors, program.window, program.mpc)
    assert (manifest.scaling, manifest.precision) == (program.scaling, precision)
    assert (manifest.created, manifest.compute_time_ms) == ("2026-01-02", 8.0)
    assert (manifest.dataset_sha256, manifest.weights_sha256) == ("0" * 64, "1" * 64)
    assert manifest.provenance["versions"] == {"torch": "2"}
    assert loaded.signer is None
    assert manifest.provenance["export"]["parity"]["action"] == report.parity.action
    assert (report.quantisation is None) == (precision == "float32")

    model = loaded.files[bundle.CONTROLLER]
    assert len(model) == report.controller_bytes
    window = random_window(program, np.random.default_rng(3)).astype(np.float32)
    plan, free = np.zeros(6, np.float32), np.ones(6, np.float32)
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(model, options)
    new_plan, *_ = session.run(None, {"window": window, "plan": plan, "free": free})
    effective = quantise(program) if precision == "int8" else program
    expected = control_step(effective, window.astype(float), plan.astype(float), free.astype(float))
    np.testing.assert_allclose(new_plan, expected.plan, atol=2.5e-5)


@pytest.mark.parametrize("precision", ["float32", "int8"])
def test_a_bundle_and_a_c_library_of_one_program_name_the_same_program(tmp_path, program, precision):
    calibration = [random_window(program, np.random.default_rng(i)) for i in range(3)]
    release(tmp_path / "release", program, precision=precision, calibration=calibration)
    library = c_library(program) if precision == "float32" else int8_library(program, calibration)
    stated = re.search(r'SW_PROGRAM_SHA256 "(\w+)"', library["sw_settings.h"].decode())
    assert bundle.load(tmp_path / "release").manifest.program_sha256 == stated.group(1)


def test_a_release_is_signed_with_the_key_given(tmp_path, program):
    key = Ed25519PrivateKey.generate()
    release(tmp_path / "release", program, key=key)
    trusted = signing.public_key(key)
    assert bundle.load(tmp_path / "release", trusted).signer == trusted


def test_recorded_windows_are_used_by_the_gates(tmp_path, program):
    windows = [random_window(program, np.random.default_rng(i)) for i in range(3)]
    report = release(tmp_path / "release", program, windows=windows)
    assert (report.parity.cases, report.quantisation.cases) == (3, 3)


def test_a_controller_that_int8_changes_too_much_is_not_written(tmp_path, program):
    with pytest.raises(ExportError, match="rms_action_error"):
        release(tmp_path / "release", program, limits=QuantisationLimits(rms_action_error=1e-15))
    assert list(tmp_path.iterdir()) == []


def test_a_graph_that_fails_parity_is_not_written(tmp_path, program, monkeypatch):
    other = random_program(1, model=ModelConfig(window=5, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8))
    other = ControllerProgram(**{**vars(other), "mpc": program.mpc})
    from export.release import bundle as bundle_writer

    built = bundle_writer.build_controller
    monkeypatch.setattr(bundle_writer, "build_controller", lambda _, precision: built(other, precision))
    with pytest.raises(ExportError, match="ONNX graph and reference differ"):
        release(tmp_path / "release", program, precision="float32")
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_place_is_a_clear_error(tmp_path, program):
    (tmp_path / "file").write_text("")
    with pytest.raises(StillwakeError, match="cannot write"):
        release(tmp_path / "file" / "release", program)
