"""`bundle renew`: a bundle for another version's DBC becomes one for this version's; nothing else about it changes."""

import hashlib
import json
import shutil
from dataclasses import asdict
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.config.loading import load_config
from contract.config.operating_point import OperatingPoint
from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleError
from contract.recording import dataset
from contract.recording.dataset import Dataset
from contract.release import bundle, signing
from contract.release.checks import CONTROLLER
from contract.release.manifest import MANIFEST, SpeedRange
from contract.shipped import BUNDLE
from ecu.fit import check_vehicle
from tests.contract.release.resealing import resealed
from tests.train.test_sensor_estimator import episode

OLD_KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))
NEW_KEY = Ed25519PrivateKey.from_private_bytes(bytes([7]) * 32)


@pytest.fixture
def old(tmp_path) -> Path:
    """The shipped controller in a bundle for a DBC of another time."""
    shutil.copytree(BUNDLE, tmp_path / "old")
    return resealed(tmp_path / "old", OLD_KEY, dbc_sha256="0" * 64)


@pytest.fixture
def keys(tmp_path) -> Path:
    signing.write_key_pair(tmp_path / "keys", NEW_KEY)
    signing.write_key_pair(tmp_path / "old-keys", OLD_KEY)
    return tmp_path / "keys" / "release.key"


def renew(cli, old, keys, tmp_path, *more, target="new"):
    return cli("bundle", "renew", old, tmp_path / target, "--name", "renewed", "--key", keys, *more)


def test_it_may_serve_a_part_of_the_speeds(cli, old, keys, tmp_path):
    assert renew(cli, old, keys, tmp_path, "--speeds", "0.75:1.2").code == 0
    made = bundle.load(tmp_path / "new").manifest
    assert (made.speeds, made.past) == (SpeedRange(slowest=0.75, fastest=1.2), 87)
    for given, wrong in (
        ("0.1:1.2", "the old bundle serves 0.6:1.4"),
        ("fast", "must be two numbers"),
        ("1.1:1.2", "1"),
    ):
        done = renew(cli, old, keys, tmp_path, "--speeds", given, target="other")
        assert (done.code, wrong in done.err, (tmp_path / "other").exists()) == (1, True, False), given


def test_the_new_one_has_the_same_controller_and_names_where_it_comes_from(cli, old, keys, tmp_path):
    before = json.loads((old / MANIFEST).read_bytes())
    done = renew(cli, old, keys, tmp_path)
    assert done.code == 0, done.err
    renewed = bundle.load(tmp_path / "new", signing.public_key(NEW_KEY))
    assert renewed.files == {name: (old / name).read_bytes() for name in (CONTROLLER, ESTIMATOR)}
    assert json.loads(json.dumps(asdict(renewed.manifest)))["sensor_estimator"] == before["sensor_estimator"]
    assert renewed.manifest.name == "renewed"
    assert renewed.manifest.provenance == {**before["provenance"], "renewed_from": before["manifest_sha256"]}
    for name in ("dataset_sha256", "weights_sha256", "program_sha256", "precision", "window", "action_limit"):
        assert getattr(renewed.manifest, name) == before[name]
    assert "is written as a directory" in renew(cli, old, keys, tmp_path, target="new.zip").err
    assert "--overwrite" in renew(cli, old, keys, tmp_path).err
    demanded = ("--overwrite", "--trust")
    assert renew(cli, old, keys, tmp_path, *demanded, tmp_path / "old-keys" / "release.pub").code == 0
    assert "must be signed by key" in renew(cli, old, keys, tmp_path, *demanded, tmp_path / "keys" / "release.pub").err


@pytest.mark.slow  # fits an estimator
def test_a_sensor_estimator_can_be_fitted_to_a_recording_that_does(cli, refused, old, keys, tmp_path):
    recording = tmp_path / "short.h5"
    dataset.write(recording, Dataset(episodes=(episode("a", "train", 20),)))
    words = ("bundle", "renew", old, tmp_path / "new", "--name", "renewed", "--key", keys, "--dataset", recording)
    assert "no training episode is longer than the window of 64" in refused(*words)
    dataset.write(recording, Dataset(episodes=(episode("a", "train", 100),)))
    done = cli(*words)
    assert done.code == 0, done.err
    assert "R2 of each sensor from the others, on train: upper_39" in done.out
    fitted = bundle.load(tmp_path / "new")
    assert fitted.files[ESTIMATOR] != (old / ESTIMATOR).read_bytes()
    assert fitted.files[CONTROLLER] == (old / CONTROLLER).read_bytes()
    provenance = fitted.manifest.provenance["sensor_estimator"]
    assert provenance["dataset_sha256"] == hashlib.sha256(recording.read_bytes()).hexdigest()
    assert set(provenance["r2"]) == set(fitted.manifest.sensors)


def test_a_bundle_for_a_slower_vehicle_fits_it_and_no_other(cli, keys, tmp_path):
    slow = "operating_point.speed=6.25"
    assert renew(cli, BUNDLE, keys, tmp_path, "--set", slow).code == 0
    found = bundle.load(tmp_path / "new", signing.public_key(NEW_KEY))
    assert found.files[CONTROLLER] == bundle.load(BUNDLE).files[CONTROLLER]
    # A quarter of the speed: four times 20 ms. Width and density are the old bundle's.
    assert found.manifest.budget_ms == 80.0
    assert found.manifest.operating_point == OperatingPoint(width=2.5, speed=6.25, density=1.2)
    check_vehicle(found, load_config(None, [slow]))
    with pytest.raises(BundleError, match=r"another operating point: width 2\.5, speed 6\.25, .* has .*speed 25\.0"):
        check_vehicle(found, load_config())
    other = renew(cli, BUNDLE, keys, tmp_path, "--set", "flow.reynolds=400", target="other")
    assert "`bundle renew` does not use it; it uses mpc.weights, operating_point" in other.err
