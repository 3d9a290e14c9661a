"""What a run was made with, as plain values and back."""

import json
from dataclasses import replace

from contract.config.loading import load_config
from contract.release import bundle
from firmware_sim.runs.metadata import RunMetadata


def test_metadata_survive_json(run_metadata):
    for one in (run_metadata, replace(run_metadata, config=load_config(), signer="0123")):
        assert RunMetadata.from_tree(json.loads(json.dumps(one.to_tree()))) == one


def test_the_bundle_gives_name_sensors_and_settings(random_release, run_metadata):
    release = bundle.load(random_release)
    found = RunMetadata.of(
        release, run_metadata.config, settle=1.5, status=run_metadata.status, plant="a", computed_by="b"
    )
    assert found.controller == f"random (int8, {release.digest[:12]})"
    assert (found.sensors, found.mpc, found.budget_ms) == (
        release.manifest.sensors, release.manifest.mpc, release.manifest.budget_ms,
    )  # fmt: skip
    assert (found.signer, found.settle, found.plant, found.computed_by) == (None, 1.5, "a", "b")
    assert {"python", "machine", "stillwake", "numpy"} <= set(found.versions)
