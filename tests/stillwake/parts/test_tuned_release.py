"""Controllers of other settings compute what the reference does with them, and belong to their release."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from contract.config.controller import CostWeights
from contract.errors import BundleError, DatasetError, ExportError
from contract.model import model_folder
from contract.release import bundle as bundles
from contract.release.checks import Bundle
from contract.shipped import BUNDLE, MODEL, RECORDING
from export.program.from_training import program_of
from export.reference.mpc import control_step
from stillwake.parts.tuned_release import ModelOf, controller_of, first_exported, release_of


@pytest.fixture(scope="module")
def release() -> Bundle:
    return bundles.load(BUNDLE)


@pytest.fixture(scope="module")
def source(release) -> ModelOf:
    return ModelOf.read(MODEL, RECORDING, release)


def test_a_controller_has_the_horizon_rate_and_weights_that_are_tried(release, source) -> None:
    mpc = replace(
        release.manifest.mpc, horizon=30, learning_rate=3e-3, weights=CostWeights(lift=0.25, rate=7.0, smoothness=1.0)
    )
    program = program_of(model_folder.read(MODEL), mpc)
    rng = np.random.default_rng(5)
    window = np.column_stack(
        [
            rng.normal(mean, std, program.window)
            for mean, std in zip(
                [*program.scaling.pressure_mean, 0.0], [*program.scaling.pressure_std, 0.03], strict=True
            )
        ]
    )
    plan, free = rng.uniform(-0.03, 0.03, 30), np.ones(30)
    free[0] = 0.0
    expected = control_step(program, window, plan, free)
    found = controller_of(release, source)(mpc).control_step(window, plan, free)
    # float32 against float64.
    np.testing.assert_allclose(found.plan, expected.plan, atol=2e-5)
    np.testing.assert_allclose(found.forces, expected.forces, atol=2e-4)


def test_other_weights_alone_leave_the_program_as_it_is(release, tmp_path) -> None:
    mpc = replace(release.manifest.mpc, weights=CostWeights(lift=0.25))
    made = release_of(release, mpc, None, tmp_path / "bundle", date(2026, 1, 2))
    assert made.manifest.mpc == mpc
    assert (made.files, made.manifest.program_sha256) == (release.files, release.manifest.program_sha256)
    assert list(tmp_path.iterdir()) == []


def test_settings_that_cannot_be_exported_give_way_to_the_next(release, source, monkeypatch, tmp_path) -> None:
    def refuse(*args: object, **options: object) -> None:
        raise ExportError("max_cost_gap")

    monkeypatch.setattr("export.release.pipeline.export_all", refuse)
    mpc = release.manifest.mpc
    better = {4: replace(mpc, horizon=30), 2: replace(mpc, weights=CostWeights(lift=0.25)), 3: mpc}
    best, skipped = first_exported(release, better, source, tmp_path / "bundle", date(2026, 1, 2))
    assert best is not None and (best[0], best[1].manifest.mpc, skipped) == (2, better[2], {4: "max_cost_gap"})


@pytest.mark.slow  # passes the gates
def test_another_learning_rate_is_exported_once_with_the_old_sensor_estimator(release, source, tmp_path) -> None:
    # Rounding would take most of the time.
    release = replace(release, manifest=replace(release.manifest, precision="float32"))
    mpc = replace(release.manifest.mpc, learning_rate=2e-3)
    folder = tmp_path / "bundle"
    made = release_of(release, mpc, source, folder, date(2026, 1, 2))
    assert (made.manifest.mpc, made.manifest.precision) == (mpc, "float32")
    assert made.files["sensors.onnx"] == release.files["sensors.onnx"]
    assert made.files["controller.onnx"] != release.files["controller.onnx"]
    assert made.manifest.operating_point == release.manifest.operating_point
    written = (folder / "manifest.json").stat().st_mtime_ns
    assert release_of(release, mpc, source, folder, date(2026, 1, 3)).digest == made.digest
    assert (folder / "manifest.json").stat().st_mtime_ns == written


def test_what_does_not_belong_together_is_refused(release, random_release, tmp_path) -> None:
    with pytest.raises(BundleError, match="name the bundle's own with --model"):
        ModelOf.read(MODEL, RECORDING, bundles.load(random_release))
    other = tmp_path / "other.h5"
    other.write_bytes(b"other")
    with pytest.raises(DatasetError, match="is not the recording that the model was fitted to"):
        ModelOf.read(MODEL, other, release)
    with pytest.raises(DatasetError, match=r"missing\.h5: No such file"):
        ModelOf.read(MODEL, tmp_path / "missing.h5", release)
