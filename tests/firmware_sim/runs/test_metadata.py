"""What a run was made with, as plain values and back."""

import json
from dataclasses import replace

import pytest

from contract.config.loading import load_config
from contract.release import bundle
from ecu.calibrating import release_calibration
from firmware_sim.runs.metadata import InjectedFault, RunEcu, RunMetadata

CORE = RunEcu.of("mcu", 480.0, [10_000_000, 12_000_000, 11_000_000])


def test_metadata_survive_json_also_those_of_an_earlier_version(run_metadata):
    fault = InjectedFault(text="noise:level=1", acted=3)
    other = replace(run_metadata, config=load_config(), signer="0123", ecu=CORE, faults=(fault,), fault_seed=7)
    for one in (run_metadata, other):
        tree = json.loads(json.dumps(one.to_tree()))
        assert RunMetadata.from_tree(tree) == one
        del tree["ecu"]
        assert RunMetadata.from_tree(tree).ecu == RunEcu(kind="python")


def test_the_bundle_gives_name_sensors_and_settings_and_other_weights_are_named(random_release, run_metadata):
    release = bundle.load(random_release)
    own = release_calibration(release, run_metadata.config)
    weights = release.manifest.mpc.weights

    def made(calibration) -> RunMetadata:
        names = ("settle", "averages", "plant", "computed_by", "status", "origin")
        given = {name: getattr(run_metadata, name) for name in names}
        return RunMetadata.of(release, run_metadata.config, calibration=calibration, **given)

    metadata = made(own)
    assert metadata.controller == f"random (int8, {release.digest[:12]})"
    assert (metadata.signer, metadata.changed_weights) == (None, {})
    assert {"python", "machine", "stillwake", "numpy"} <= set(metadata.versions)
    metadata = made(replace(own, weights=replace(weights, lift=9.0), action_limit=0.05))
    assert metadata.changed_weights == {"lift": (9.0, weights.lift)}
    assert metadata.mpc.weights == weights
    assert metadata.config.flow.action_limit == pytest.approx(0.05)


def test_an_emulated_core_has_median_and_longest_of_the_steps_that_planned():
    assert (CORE.modelled_ms, CORE.modelled_ms_max) == (11.0, 12.0)
    # Another ECU's compute time is a setting, and no figure of it.
    assert RunEcu.of("c", None, [8_000_000]) == RunEcu(kind="c")
    assert RunEcu.of("mcu", 480.0, []) == RunEcu(kind="mcu", clock_mhz=480.0)
