"""Every kind of damage to a release bundle, by accident or on purpose, refused by its name.

Done with the file system and `json` alone, as someone would who has the bundle but not the key.
"""

import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from contract import errors
from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleError
from contract.release import bundle, checks, signing
from contract.release.checks import CONTROLLER, SIGNATURE
from contract.release.manifest import MANIFEST, Manifest
from contract.shipped import BUNDLE
from tests.contract.release.resealing import resealed
from tests.examples import examples

SHIPPED = bundle.load(BUNDLE)
BARE = replace(SHIPPED.manifest, sensor_estimator=None)
CONTENTS = {CONTROLLER: SHIPPED.files[CONTROLLER], "notes.txt": b"hello"}
KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))
OTHER = Ed25519PrivateKey.from_private_bytes(bytes([1]) * 32)
TRUSTED = signing.public_key(KEY)
SENSORS = ["base_1", "base_2", "base_3", "base_4"]
Tamper = Callable[[Path], object]
"""Changes a folder."""


def edited(name: str, change: Callable[[bytes], bytes]) -> Tamper:
    return lambda folder: (folder / name).write_bytes(change((folder / name).read_bytes()))


def flipped(name: str, place: int) -> Tamper:
    return edited(name, lambda data: data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])


def of_the_shipped(*names: str) -> Tamper:
    return lambda folder: [shutil.copy(BUNDLE / name, folder / name) for name in names]


def in_the_trusted_keys_name(folder: Path) -> None:
    bundle.sign(folder, OTHER)
    named = (folder / SIGNATURE).read_bytes()
    own, trusted = (key.raw.hex().encode() for key in (signing.public_key(OTHER), TRUSTED))
    (folder / SIGNATURE).write_bytes(named.replace(own, trusted))


def packed(manifest: Manifest, contents: Mapping[str, bytes]) -> Tamper:
    return lambda folder: bundle.write(folder, manifest, contents, KEY)


def with_files(**sizes: int) -> Tamper:
    return lambda folder: [(folder / name).write_bytes(bytes(size)) for name, size in sizes.items()]


CASES: list[tuple[Tamper, type[errors.BundleError], str]] = [
    (flipped(CONTROLLER, 1000), errors.BundleFileError, "controller.onnx was altered"),
    (flipped(MANIFEST, 100), errors.BundleSignatureError, "bad signature: manifest.json or manifest.sig was altered"),
    (edited(SIGNATURE, lambda _: signing.sign(KEY, b"{}")), errors.BundleSignatureError, "bad signature"),
    (lambda folder: bundle.sign(folder, OTHER), errors.BundleSignerError, f"signed by key {TRUSTED.fingerprint}"),
    (in_the_trusted_keys_name, errors.BundleSignatureError, "bad signature"),
    (lambda folder: (folder / SIGNATURE).unlink(), errors.BundleSignerError, "is unsigned: must be signed by key"),
    (lambda folder: (folder / CONTROLLER).unlink(), errors.BundleFileError, "controller.onnx is missing"),
    (lambda folder: (folder / MANIFEST).unlink(), errors.BundleManifestError, "manifest.json is missing"),
    (lambda folder: (folder / "extra.bin").touch(), errors.BundleFileError, "extra.bin is not in the manifest"),
    (of_the_shipped(CONTROLLER, MANIFEST), errors.BundleSignatureError, "bad signature"),
    (lambda folder: resealed(folder, sensors=SENSORS), errors.BundleSignatureError, "bad signature"),
    (lambda folder: resealed(folder, OTHER, sensors=SENSORS), errors.BundleSignerError, "signed by key"),
    (lambda folder: resealed(folder, KEY, dbc_sha256="0" * 64), errors.BundleDbcError, "another stillwake.dbc"),
    (edited(MANIFEST, lambda data: data + b" " * 2**20), errors.BundleContainerError, "at most 1048576"),
    (with_files(more=20 * 2**20, zeros=20 * 2**20), errors.BundleContainerError, "33554432"),
    (with_files(**{f"{i}": 0 for i in range(100)}), errors.BundleContainerError, "more than 64 files"),
    (lambda folder: (folder / "link").symlink_to("/etc/passwd"), errors.BundleContainerError, "is a symbolic link"),
    (lambda folder: os.mkfifo(folder / "pipe"), errors.BundleContainerError, "'pipe' is not a plain file"),
    (packed(BARE, SHIPPED.files), errors.BundleFileError, "sensors.onnx: manifest.json does not mention it"),
    (packed(SHIPPED.manifest, CONTENTS), errors.BundleFileError, "is missing: manifest.json has a sensor_estimator"),
]


def test_damage_is_refused_by_its_name(sound, tmp_path):
    for number, (tamper, kind, named) in enumerate(CASES):
        folder = shutil.copytree(sound, tmp_path / str(number) / "bundle")
        tamper(folder)
        with pytest.raises(errors.BundleError) as refused:
            bundle.load(folder, TRUSTED)
        assert type(refused.value) is kind, (named, refused.value)
        assert named in str(refused.value) and str(folder) in str(refused.value), (named, refused.value)
        # The list that people read has the error that a loader raises as its first.
        first = next(check.error for check in bundle.examine(folder, TRUSTED) if check.error is not None)
        assert (type(first), str(first)) == (kind, str(refused.value)), named


@examples(100)
@given(name=st.sampled_from([MANIFEST, SIGNATURE]), data=st.data())
def test_no_bit_of_manifest_or_signature_can_change(sound, tmp_path_factory, name, data):
    folder = tmp_path_factory.getbasetemp() / "flipped"
    shutil.copytree(sound, folder, dirs_exist_ok=True)
    content = bytearray((folder / name).read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    (folder / name).write_bytes(content)
    # Whoever is trusted: a changed signature fails under any key.
    for trusted in (TRUSTED, None):
        with pytest.raises(errors.BundleSignatureError):
            bundle.load(folder, trusted)


def test_nothing_is_parsed_whose_signature_is_bad(signed, monkeypatch):
    flipped(MANIFEST, 100)(signed)
    monkeypatch.setattr(checks, "open_manifest", lambda path, raw: pytest.fail("was parsed"))
    with pytest.raises(errors.BundleSignatureError):
        bundle.load(signed, TRUSTED)


def test_everything_that_is_wrong_is_listed_and_nothing_if_all_is_sound(signed):
    assert bundle.load(signed, TRUSTED).signer == TRUSTED
    assert all(check.error is None for check in bundle.examine(signed, TRUSTED))
    # Everything that is wrong is listed.
    flipped(CONTROLLER, 1000)(signed)
    (signed / "extra.bin").touch()
    names = ["container", SIGNATURE, MANIFEST, CONTROLLER, "extra.bin", "DBC", "content"]
    made = bundle.examine(signed)
    assert [check.name for check in made] == names
    assert {check.name for check in made if check.error} == {CONTROLLER, "extra.bin"}


def test_places_and_names_that_lead_elsewhere_are_refused(tmp_path):
    for name in ("../evil", "a/b", "", "..", MANIFEST, SIGNATURE, "a\\b"):
        with pytest.raises(BundleError, match="plain file name"):
            bundle.write(tmp_path / "b", BARE, {**CONTENTS, name: b""})
        assert list(tmp_path.iterdir()) == [], name
    with pytest.raises(BundleError, match=r"nowhere: no such directory"):
        bundle.load(tmp_path / "nowhere")
    (tmp_path / "precious").write_text("thesis")
    with pytest.raises(BundleError, match="holds other files"):
        bundle.write(tmp_path, BARE, CONTENTS)
    assert (tmp_path / "precious").read_text() == "thesis"
    with pytest.raises(BundleError, match=r"b\.zip: a bundle is written as a directory"):
        bundle.write(tmp_path / "b.zip", BARE, CONTENTS)


def test_the_shipped_bundle_has_one_and_others_may_lack_it(tmp_path):
    assert SHIPPED.manifest.sensor_estimator is not None
    checks = {item.name: item.error for item in bundle.examine(BUNDLE)}
    assert checks.keys() >= {ESTIMATOR, "sensor graph"} and set(checks.values()) == {None}
    bundle.write(tmp_path / "bare", BARE, CONTENTS)
    bare = bundle.load(tmp_path / "bare")
    assert (bare.manifest, bare.files) == (BARE, CONTENTS)
    assert bare.short_hash == int.from_bytes(bytes.fromhex(bare.digest)[:4], "big")
    assert "sensor graph" not in {item.name for item in bundle.examine(tmp_path / "bare")}
