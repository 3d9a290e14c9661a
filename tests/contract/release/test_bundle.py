import json
from dataclasses import replace
from typing import Any

import pytest

from contract.config.controller import MpcConfig
from contract.errors import BundleError
from contract.release import bundle
from contract.release.checks import CONTROLLER, SIGNATURE
from contract.release.image import image_of
from contract.release.manifest import MANIFEST, Manifest
from contract.shipped import BUNDLE

SHIPPED = bundle.load(BUNDLE)
CONTENTS = {CONTROLLER: SHIPPED.files[CONTROLLER], "notes.txt": b"hello"}


def manifest(**changes: Any) -> Manifest:
    return replace(SHIPPED.manifest, sensor_estimator=None, **changes)


def test_round_trip(tmp_path):
    bundle.write(tmp_path / "bundle", manifest(), CONTENTS)
    loaded = bundle.load(tmp_path / "bundle")
    assert loaded.manifest == manifest()
    assert loaded.files == CONTENTS
    assert loaded.short_hash == int.from_bytes(bytes.fromhex(loaded.digest)[:4], "big")


def test_equal_bundles_have_equal_images_and_every_part_moves_the_digest(tmp_path):
    assert image_of(bundle.pack(manifest(), CONTENTS)) == image_of(
        bundle.pack(manifest(), dict(reversed(CONTENTS.items())))
    )
    variants = [
        *((manifest(**change), CONTENTS) for change in ({}, {"name": "other"}, {"mpc": MpcConfig(horizon=24)})),
        *((manifest(**{name: "1" * 64}), CONTENTS) for name in ("dataset_sha256", "weights_sha256", "program_sha256")),
        (manifest(), {**CONTENTS, "notes.txt": b"hellp"}),
        (manifest(), {CONTROLLER: CONTENTS[CONTROLLER]}),
    ]
    digests = {json.loads(bundle.pack(*variant)[MANIFEST])["manifest_sha256"] for variant in variants}
    assert len(digests) == len(variants)


def test_places_and_names_that_lead_elsewhere_are_refused(tmp_path):
    for name in ("../evil", "a/b", "", "..", MANIFEST, SIGNATURE, "a\\b"):
        with pytest.raises(BundleError, match="plain file name"):
            bundle.write(tmp_path / "b", manifest(), {**CONTENTS, name: b""})
        assert list(tmp_path.iterdir()) == [], name
    with pytest.raises(BundleError, match=r"nowhere: no such directory"):
        bundle.load(tmp_path / "nowhere")
    (tmp_path / "precious").write_text("thesis")
    with pytest.raises(BundleError, match="holds something else"):
        bundle.write(tmp_path, manifest(), CONTENTS)
    assert (tmp_path / "precious").read_text() == "thesis"
    with pytest.raises(BundleError, match=r"b\.zip: is written as a directory"):
        bundle.write(tmp_path / "b.zip", manifest(), CONTENTS)
