"""What a run was made with, as plain values and back."""

import json
from dataclasses import replace
from typing import Any

import pytest

from contract.config.loading import load_config
from contract.release import bundle
from firmware_sim.ecu.calibrating import release_calibration
from firmware_sim.runs.metadata import RunEcu, RunMetadata, RunOrigin


def test_metadata_survive_json(run_metadata):
    for one in (run_metadata, replace(run_metadata, config=load_config(), signer="0123")):
        assert RunMetadata.from_tree(json.loads(json.dumps(one.to_tree()))) == one


def made(release, run_metadata, **changes) -> RunMetadata:
    given: dict[str, Any] = {
        "settle": 1.5,
        "averages": False,
        "plant": "a",
        "computed_by": "b",
        "origin": RunOrigin(day="2026-03-04"),
    }
    given["calibration"] = release_calibration(release, run_metadata.config)
    return RunMetadata.of(release, run_metadata.config, status=run_metadata.status, **{**given, **changes})


def test_the_bundle_gives_name_sensors_and_settings(random_release, run_metadata):
    release = bundle.load(random_release)
    found = made(release, run_metadata)
    assert found.controller == f"random (int8, {release.digest[:12]})"
    assert found.digest == release.digest
    assert (found.sensors, found.mpc, found.budget_ms) == (
        release.manifest.sensors, release.manifest.mpc, release.manifest.budget_ms,
    )  # fmt: skip
    assert (found.signer, found.settle, found.plant, found.computed_by) == (None, 1.5, "a", "b")
    assert (found.averages, found.origin.day) == (False, "2026-03-04")
    assert {"python", "machine", "stillwake", "numpy"} <= set(found.versions)


def test_weights_that_are_not_the_bundles_are_named(random_release, run_metadata):
    release = bundle.load(random_release)
    weights = release.manifest.mpc.weights
    assert made(release, run_metadata).changed_weights == {}
    own = release_calibration(release, run_metadata.config)
    found = made(release, run_metadata, calibration=replace(own, weights=replace(weights, lift=9.0), action_limit=0.05))
    assert found.changed_weights == {"lift": (9.0, weights.lift)}
    assert found.mpc.weights == weights
    assert found.config.flow.action_limit == pytest.approx(0.05)


def test_a_run_of_an_earlier_version_had_the_ecu_in_python(run_metadata):
    tree = run_metadata.to_tree()
    del tree["ecu"]
    assert RunMetadata.from_tree(tree).ecu == RunEcu(kind="python")


def test_an_emulated_core_says_what_its_steps_took(run_metadata):
    """Median and longest of the steps that planned; another ECU's compute time is a setting, and no figure of it."""
    core = RunEcu.of("cortex-m7", 480.0, [10_000_000, 12_000_000, 11_000_000])
    assert (core.modelled_ms, core.modelled_ms_max) == (11.0, 12.0)
    assert RunEcu.of("c", None, [8_000_000]) == RunEcu(kind="c")
    assert RunEcu.of("cortex-m7", 480.0, []) == RunEcu(kind="cortex-m7", clock_mhz=480.0)
    found = replace(run_metadata, ecu=core)
    assert RunMetadata.from_tree(json.loads(json.dumps(found.to_tree()))) == found
