"""A sensor estimator in a bundle: there if and only if the manifest says so, and judged like the controller."""

from dataclasses import replace
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleError, BundleFileError
from contract.release import bundle, signing
from contract.release.bundle import MadeEstimator
from contract.release.checks import CONTROLLER, Bundle
from contract.release.manifest import SensorEstimator
from contract.shipped import BUNDLE

KEY = Ed25519PrivateKey.from_private_bytes(bytes([3]) * 32)


@pytest.fixture
def shipped() -> Bundle:
    return bundle.load(BUNDLE)


def test_the_shipped_bundle_has_one_and_others_may_lack_it(shipped, tmp_path):
    assert shipped.manifest.sensor_estimator is not None
    checks = {item.name: item.error for item in bundle.examine(BUNDLE)}
    assert checks.keys() >= {ESTIMATOR, "sensor graph"} and set(checks.values()) == {None}
    contents = {CONTROLLER: shipped.files[CONTROLLER]}
    bundle.write(tmp_path / "bare", replace(shipped.manifest, sensor_estimator=None), contents)
    assert ESTIMATOR not in bundle.load(tmp_path / "bare").files
    assert "sensor graph" not in {item.name for item in bundle.examine(tmp_path / "bare")}


def refused(path: Path) -> BundleError:
    """What both `load` and `examine` say."""
    with pytest.raises(BundleError) as said:
        bundle.load(path)
    failed = [item for item in bundle.examine(path) if item.error is not None]
    assert [str(item.error) for item in failed] == [str(said.value)]
    return said.value


def test_manifest_and_file_must_agree(shipped, tmp_path):
    bundle.write(tmp_path / "b", replace(shipped.manifest, sensor_estimator=None), shipped.files)
    error = refused(tmp_path / "b")
    assert isinstance(error, BundleFileError)
    assert "sensors.onnx: manifest.json does not mention it" in str(error)
    bundle.write(tmp_path / "b", shipped.manifest, {CONTROLLER: shipped.files[CONTROLLER]})
    assert "sensors.onnx is missing: manifest.json has a sensor_estimator" in str(refused(tmp_path / "b"))


def test_renewal_keeps_it_or_puts_another_one_in_its_place(shipped, tmp_path):
    kept = bundle.renew(BUNDLE, tmp_path / "kept", name="kept", created="2026-01-02", key=KEY)
    assert kept.files[ESTIMATOR] == shipped.files[ESTIMATOR]
    assert kept.manifest.sensor_estimator == shipped.manifest.sensor_estimator
    figures = SensorEstimator(fast=((0.5,) * 4,) * 4, slow=((0.25,) * 4,) * 4)
    made = MadeEstimator(graph=shipped.files[ESTIMATOR], figures=figures, provenance={"r2": {"base_7": 0.9}})
    other = bundle.renew(BUNDLE, tmp_path / "new", name="new", created="2026-01-02", key=KEY, estimator=made)
    assert other.manifest.sensor_estimator == figures
    assert other.manifest.provenance["sensor_estimator"] == {"r2": {"base_7": 0.9}}
    assert other.signer == signing.public_key(KEY)
