"""A sensor estimator in a bundle: there if and only if the manifest says so, and judged like the controller."""

from dataclasses import replace
from typing import Any

import pytest

from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleError, BundleFileError
from contract.release import bundle
from contract.release.checks import CONTROLLER, SIGNATURE
from contract.release.container import image_of
from contract.release.manifest import MANIFEST, Manifest
from contract.shipped import BUNDLE

SHIPPED = bundle.load(BUNDLE)
CONTENTS = {CONTROLLER: SHIPPED.files[CONTROLLER], "notes.txt": b"hello"}


def manifest(**changes: Any) -> Manifest:
    return replace(SHIPPED.manifest, sensor_estimator=None, **changes)


def test_equal_bundles_have_equal_images():
    turned = dict(reversed(CONTENTS.items()))
    assert image_of(bundle.pack(manifest(), CONTENTS)) == image_of(bundle.pack(manifest(), turned))


def test_places_and_names_that_lead_elsewhere_are_refused(tmp_path):
    for name in ("../evil", "a/b", "", "..", MANIFEST, SIGNATURE, "a\\b"):
        with pytest.raises(BundleError, match="plain file name"):
            bundle.write(tmp_path / "b", manifest(), {**CONTENTS, name: b""})
        assert list(tmp_path.iterdir()) == [], name
    with pytest.raises(BundleError, match=r"nowhere: no such directory"):
        bundle.load(tmp_path / "nowhere")
    (tmp_path / "precious").write_text("thesis")
    with pytest.raises(BundleError, match="holds other files"):
        bundle.write(tmp_path, manifest(), CONTENTS)
    assert (tmp_path / "precious").read_text() == "thesis"
    with pytest.raises(BundleError, match=r"b\.zip: is written as a directory"):
        bundle.write(tmp_path / "b.zip", manifest(), CONTENTS)


def test_the_shipped_bundle_has_one_and_others_may_lack_it(tmp_path):
    assert SHIPPED.manifest.sensor_estimator is not None
    checks = {item.name: item.error for item in bundle.examine(BUNDLE)}
    assert checks.keys() >= {ESTIMATOR, "sensor graph"} and set(checks.values()) == {None}
    bundle.write(tmp_path / "bare", manifest(), CONTENTS)
    bare = bundle.load(tmp_path / "bare")
    assert (bare.manifest, bare.files) == (manifest(), CONTENTS)
    assert bare.short_hash == int.from_bytes(bytes.fromhex(bare.digest)[:4], "big")
    assert "sensor graph" not in {item.name for item in bundle.examine(tmp_path / "bare")}


def test_manifest_and_file_must_agree(tmp_path):
    """Both `load` and `examine` say so."""
    for stated, files, text in (
        (manifest(), SHIPPED.files, "sensors.onnx: manifest.json does not mention it"),
        (SHIPPED.manifest, CONTENTS, "sensors.onnx is missing: manifest.json has a sensor_estimator"),
    ):
        bundle.write(tmp_path / "b", stated, files)
        with pytest.raises(BundleFileError, match=text) as said:
            bundle.load(tmp_path / "b")
        failed = [item.error for item in bundle.examine(tmp_path / "b") if item.error is not None]
        assert [str(error) for error in failed] == [str(said.value)]
