"""Every kind of damage to a release bundle, by accident or on purpose, refused by its name.

Done with the file system, `zipfile` and `json` alone, as someone would who has the bundle but not the key.
"""

import hashlib
import os
import shutil
import stat
import zipfile
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from contract import errors
from contract.release import bundle, signing
from contract.release.bundle import CONTROLLER, SIGNATURE
from contract.release.manifest import MANIFEST
from contract.shipped import BUNDLE
from tests.contract.release.resealing import resealed
from tests.examples import examples

KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))
OTHER = Ed25519PrivateKey.from_private_bytes(bytes([1]) * 32)
TRUSTED = signing.public_key(KEY)


def flip(path: Path, place: int) -> None:
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


def zipped(folder: Path, *added: tuple[str | zipfile.ZipInfo, bytes]) -> Path:
    path = folder.with_suffix(".zip")
    with zipfile.ZipFile(path, "w") as archive:
        for item in sorted(folder.iterdir()):
            archive.writestr(item.name, item.read_bytes())
        for name, data in added:
            archive.writestr(name, data)
    shutil.rmtree(folder)
    return path


def flipped_controller(folder: Path) -> Path:
    flip(folder / CONTROLLER, 1000)
    return folder


def flipped_manifest(folder: Path) -> Path:
    flip(folder / MANIFEST, 100)
    return folder


def flipped_signature(folder: Path) -> Path:
    # The last digit; a bit flipped in a hex digit below 8 may leave hex, and then it is damage instead.
    text = (folder / SIGNATURE).read_bytes()
    (folder / SIGNATURE).write_bytes(text[:-2] + (b"0\n" if text[-2:] == b"1\n" else b"1\n"))
    return folder


def garbled_signature(folder: Path) -> Path:
    (folder / SIGNATURE).write_bytes((folder / SIGNATURE).read_bytes() + b"\n")
    return folder


def signature_of_another_bundle(folder: Path) -> Path:
    (folder / SIGNATURE).write_bytes(signing.sign(KEY, b"{}"))
    return folder


def signed_by_another(folder: Path) -> Path:
    bundle.sign(folder, OTHER)
    return folder


def claimed_for_the_trusted_key(folder: Path) -> Path:
    """Another's signature under the trusted key's name."""
    text = signing.sign(OTHER, (folder / MANIFEST).read_bytes()).decode()
    text = text.replace(signing.public_key(OTHER).raw.hex(), TRUSTED.raw.hex())
    (folder / SIGNATURE).write_text(text)
    return folder


def without_signature(folder: Path) -> Path:
    (folder / SIGNATURE).unlink()
    return folder


def without_controller(folder: Path) -> Path:
    (folder / CONTROLLER).unlink()
    return folder


def without_manifest(folder: Path) -> Path:
    (folder / MANIFEST).unlink()
    return folder


def with_an_extra_file(folder: Path) -> Path:
    (folder / "extra.bin").write_bytes(b"")
    return folder


def with_anothers_controller(folder: Path) -> Path:
    shutil.copy(BUNDLE / CONTROLLER, folder / CONTROLLER)
    return folder


def with_anothers_manifest_and_controller(folder: Path) -> Path:
    for name in (CONTROLLER, MANIFEST):
        shutil.copy(BUNDLE / name, folder / name)
    return folder


def with_other_sensors(folder: Path) -> Path:
    return resealed(folder, sensors=["base_1", "base_2", "base_3", "base_4"])


def with_another_controller_and_its_hash(folder: Path) -> Path:
    (folder / CONTROLLER).write_bytes(b"mine")
    return resealed(folder, files={CONTROLLER: hashlib.sha256(b"mine").hexdigest()})


def with_other_sensors_signed_by_another(folder: Path) -> Path:
    return resealed(folder, OTHER, sensors=["base_1", "base_2", "base_3", "base_4"])


def of_another_schema(folder: Path) -> Path:
    return resealed(folder, KEY, schema="stillwake-bundle/9")


def for_another_dbc(folder: Path) -> Path:
    return resealed(folder, KEY, dbc_sha256="0" * 64)


def without_a_data_set(folder: Path) -> Path:
    return resealed(folder, KEY, dataset_sha256="")


def with_a_large_manifest(folder: Path) -> Path:
    (folder / MANIFEST).write_bytes((folder / MANIFEST).read_bytes() + b" " * 2**20)
    return folder


def with_a_large_manifest_in_a_zip(folder: Path) -> Path:
    return zipped(with_a_large_manifest(folder))


def with_too_many_bytes(folder: Path) -> Path:
    """Less than a hundred kilobytes that would unpack to eighty megabytes."""
    path = zipped(folder)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        for name in ("more", "zeros"):
            archive.writestr(name, bytes(40 * 2**20))
    return path


def with_too_many_files(folder: Path) -> Path:
    return zipped(folder, *((f"{i}", b"") for i in range(100)))


def truncated(folder: Path) -> Path:
    path = zipped(folder)
    path.write_bytes(path.read_bytes()[:-100])
    return path


def truncated_to_nothing(folder: Path) -> Path:
    path = zipped(folder)
    path.write_bytes(b"")
    return path


def with_a_way_up(folder: Path) -> Path:
    return zipped(folder, ("../evil", b""))


def with_an_absolute_path(folder: Path) -> Path:
    return zipped(folder, ("/tmp/evil", b""))


def with_a_folder(folder: Path) -> Path:
    return zipped(folder, ("sub/", b""))


def with_a_hidden_name(folder: Path) -> Path:
    """A name that the zip library cuts at its zero byte."""
    path = zipped(folder, ("controller.onnxZevil", b""))
    path.write_bytes(path.read_bytes().replace(b"onnxZevil", b"onnx\0evil"))
    return path


def with_a_name_twice(folder: Path) -> Path:
    with pytest.warns(UserWarning, match="Duplicate"):
        return zipped(folder, (CONTROLLER, b"another"))


def with_a_link(folder: Path) -> Path:
    elsewhere = folder.parent / "elsewhere"
    shutil.move(folder / CONTROLLER, elsewhere)
    (folder / CONTROLLER).symlink_to(elsewhere)
    return folder


def with_a_link_in_a_zip(folder: Path) -> Path:
    info = zipfile.ZipInfo("link")
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return zipped(folder, (info, b"/etc/passwd"))


def with_a_pipe(folder: Path) -> Path:
    os.mkfifo(folder / "pipe")
    return folder


TAMPERINGS = [
    (flipped_controller, errors.BundleFileError, "controller.onnx was altered"),
    (flipped_manifest, errors.BundleSignatureError, "bad signature: manifest.json or manifest.sig was altered"),
    (flipped_signature, errors.BundleSignatureError, "bad signature: manifest.json or manifest.sig was altered"),
    (garbled_signature, errors.BundleSignatureError, "manifest.sig is damaged"),
    (signature_of_another_bundle, errors.BundleSignatureError, "bad signature"),
    (claimed_for_the_trusted_key, errors.BundleSignatureError, "bad signature"),
    (signed_by_another, errors.BundleSignerError, f"must be signed by key {TRUSTED.fingerprint}"),
    (without_signature, errors.BundleSignerError, f"unsigned, must be signed by key {TRUSTED.fingerprint}"),
    (without_controller, errors.BundleFileError, "controller.onnx is missing"),
    (without_manifest, errors.BundleManifestError, "manifest.json is missing"),
    (with_an_extra_file, errors.BundleFileError, "extra.bin is not in the manifest"),
    (with_anothers_controller, errors.BundleFileError, "controller.onnx was altered"),
    (with_anothers_manifest_and_controller, errors.BundleSignatureError, "bad signature"),
    (with_other_sensors, errors.BundleSignatureError, "bad signature"),
    (with_another_controller_and_its_hash, errors.BundleSignatureError, "bad signature"),
    (with_other_sensors_signed_by_another, errors.BundleSignerError, "signed by key"),
    (of_another_schema, errors.BundleManifestError, "schema 'stillwake-bundle/9'"),
    (for_another_dbc, errors.BundleDbcError, "built for another stillwake.dbc"),
    (without_a_data_set, errors.BundleManifestError, "dataset_sha256 = '': must be a SHA-256"),
    (with_a_large_manifest, errors.BundleContainerError, "at most 1048576"),
    (with_a_large_manifest_in_a_zip, errors.BundleContainerError, "at most 1048576"),
    (with_too_many_bytes, errors.BundleContainerError, "more than 64 files or 33554432 bytes"),
    (with_too_many_files, errors.BundleContainerError, "more than 64 files"),
    (truncated, errors.BundleContainerError, "truncated, damaged or no zip"),
    (truncated_to_nothing, errors.BundleContainerError, "truncated, damaged or no zip"),
    (with_a_way_up, errors.BundleContainerError, "'../evil' is a path"),
    (with_an_absolute_path, errors.BundleContainerError, "'/tmp/evil' is a path"),
    (with_a_folder, errors.BundleContainerError, "'sub/' is a path"),
    (with_a_hidden_name, errors.BundleContainerError, "is a path"),
    (with_a_name_twice, errors.BundleContainerError, "controller.onnx is there twice"),
    (with_a_link, errors.BundleContainerError, "'controller.onnx' is a symbolic link"),
    (with_a_link_in_a_zip, errors.BundleContainerError, "'link' is a symbolic link"),
    (with_a_pipe, errors.BundleContainerError, "'pipe' is not a plain file"),
]


@pytest.mark.slow  # thirty bundles, among them one that would unpack to eighty megabytes
def test_damage_is_refused_by_its_name(sound, tmp_path):
    for tamper, kind, named in TAMPERINGS:
        path = tamper(shutil.copytree(sound, tmp_path / tamper.__name__ / "bundle"))
        with pytest.raises(errors.BundleError) as refused:
            bundle.load(path, TRUSTED)
        assert type(refused.value) is kind, (tamper, refused.value)
        assert named in str(refused.value) and str(path) in str(refused.value), (tamper, refused.value)
        # The list that people read has the error that a loader raises as its first.
        first = next(check.error for check in bundle.examine(path, TRUSTED) if check.error is not None)
        assert (type(first), str(first)) == (kind, str(refused.value)), tamper


@examples(200)
@given(name=st.sampled_from([MANIFEST, SIGNATURE]), data=st.data())
def test_no_bit_of_manifest_or_signature_can_change(sound, tmp_path_factory, name, data):
    folder = tmp_path_factory.getbasetemp() / "flipped"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(sound, folder)
    content = bytearray((folder / name).read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    (folder / name).write_bytes(content)
    # Whoever is trusted: a changed signature fails under any key.
    for trusted in (TRUSTED, None):
        with pytest.raises(errors.BundleSignatureError):
            bundle.load(folder, trusted)


def test_everything_that_is_wrong_is_listed(signed):
    with_an_extra_file(flipped_controller(signed))
    assert [(check.name, check.error is None) for check in bundle.examine(signed)] == [
        ("container", True),
        ("manifest.sig", True),
        ("manifest.json", True),
        ("controller.onnx", False),
        ("extra.bin", False),
        ("DBC", True),
        ("content", True),
    ]


def test_nothing_is_parsed_whose_signature_is_bad(signed, monkeypatch):
    flipped_manifest(signed)
    monkeypatch.setattr(bundle, "open_manifest", lambda path, raw: pytest.fail("was parsed"))
    with pytest.raises(errors.BundleSignatureError):
        bundle.load(signed, TRUSTED)


def test_a_signed_bundle_verifies_as_directory_and_zip(signed):
    for pack in (lambda folder: folder, zipped):
        path = pack(signed)
        assert bundle.load(path, TRUSTED).signer == TRUSTED
        assert all(check.error is None for check in bundle.examine(path, TRUSTED))
