"""What is shipped belongs together before anything is replaced."""

import json
import shutil
from datetime import date

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from benchmarks.release.ship import ship
from contract.errors import BundleError
from contract.release import bundle as bundles
from contract.shipped import BUNDLE, MODEL
from tests.contract.release.resealing import resealed

ON = date(2026, 1, 2)


@pytest.fixture
def places(tmp_path):
    """Where a checkout has model and bundle; both empty, with another file's record."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "provenance.json").write_text('{"recording.h5": {"command": "stillwake record"}}')
    return {"data": tmp_path / "data", "bundle": tmp_path / "bundle"}


def test_model_bundle_and_record_are_put_in_place(places):
    ship(MODEL, BUNDLE, command="stillwake train", on=ON, **places)
    assert bundles.load(places["bundle"]).manifest == bundles.load(BUNDLE).manifest
    for item in MODEL.iterdir():
        assert (places["data"] / "model" / item.name).read_bytes() == item.read_bytes()
    records = json.loads((places["data"] / "provenance.json").read_text())
    assert records["recording.h5"] == {"command": "stillwake record"}
    assert (records["model"]["command"], records["model"]["date"]) == ("stillwake train", "2026-01-02")


@pytest.mark.parametrize("changed", [{"weights_sha256": "0" * 64}, {}])
def test_a_bundle_that_is_not_the_models_or_not_the_projects_replaces_nothing(places, tmp_path, changed):
    shutil.copytree(BUNDLE, tmp_path / "other")
    resealed(tmp_path / "other", Ed25519PrivateKey.generate(), **changed)
    with pytest.raises(BundleError):
        ship(MODEL, tmp_path / "other", command="stillwake train", on=ON, **places)
    assert [item.name for item in places["data"].iterdir()] == ["provenance.json"]
    assert not places["bundle"].exists()
