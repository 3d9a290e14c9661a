"""The folder of an ECU on a computer: made whole or not at all, never over something, run by one process."""

import os
import re
import resource
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization

from can_bridge.flashing.backing import MediumError
from can_bridge.flashing.verdicts import Verdict
from contract.errors import ConfigError, KeyFileError, OutputError
from contract.release import signing
from ecu.flashable.ecu_folder import IDENTITY, held, provision, read_folder
from tests.can_bridge.flashing.releases import RELEASE, ROOT, STRANGER, image, keys


def public(path: Path, key=ROOT) -> Path:
    form = serialization.PublicFormat.SubjectPublicKeyInfo
    path.write_bytes(key.public_key().public_bytes(serialization.Encoding.PEM, form))
    return path


def made(tmp_path: Path, **changes):
    root, fits = public(tmp_path / "root.pub"), lambda bundle: Verdict.GOOD
    usual = {"root": root, "keys": keys(), "image": image("first"), "hardware": "bench", "serial": "42", "fits": fits}
    return provision(tmp_path / "ecu", **{**usual, **changes})


def test_what_is_made_can_be_read_and_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "ecu").mkdir()
    folder = made(tmp_path)
    before = {path: path.read_bytes() for path in (tmp_path / "ecu").iterdir()}
    with pytest.raises(OutputError, match="exists already"):
        made(tmp_path, image=None)
    assert {path: path.read_bytes() for path in (tmp_path / "ecu").iterdir()} == before
    assert folder == read_folder(tmp_path / "ecu")
    assert (folder.hardware, folder.serial, folder.root) == ("bench", "42", signing.public_key(ROOT))
    assert read_folder(tmp_path / "ecu", hardware="other").hardware == "other"
    other = public(tmp_path / "other.pub", RELEASE)
    assert read_folder(tmp_path / "ecu", root=other).root == signing.public_key(RELEASE)


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    for changes, error, words in (
        ({"keys": keys()[:-1]}, KeyFileError, "key list"),
        ({"image": image("foreign", key=STRANGER)}, ConfigError, "is not in this ECU"),
        ({"image": image("first")[:-1]}, ConfigError, "not a valid bundle"),
        ({"fits": lambda bundle: Verdict.WRONG_VEHICLE}, ConfigError, "another vehicle"),
        ({"hardware": ""}, ConfigError, "hardware"),
        ({"serial": "a\nb"}, ConfigError, "serial"),
    ):
        with pytest.raises(error, match=words):
            made(tmp_path, **changes)
        assert not (tmp_path / "ecu").exists(), words


def test_a_full_disk_is_named_without_the_temporary_folder(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(MediumError, match=re.escape(f"store {tmp_path / 'ecu'}/") + ".*: File too large"):
            made(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not (tmp_path / "ecu").exists()


def test_one_process_runs_it_and_another_identity_or_folder_is_no_ecu(tmp_path: Path) -> None:
    made(tmp_path)
    with held(tmp_path / "ecu"), pytest.raises(ConfigError, match="another process"), held(tmp_path / "ecu"):
        pass
    with held(tmp_path / "ecu"):
        pass
    (tmp_path / "ecu" / "lock").unlink()
    os.mkfifo(tmp_path / "ecu" / "lock")
    with pytest.raises(ConfigError, match="lock: "), held(tmp_path / "ecu"):
        pass
    for raw in (b"", b"{}", b'{"schema": "stillwake-ecu/2", "hardware": "a", "serial": "b"}', b"\xff"):
        (tmp_path / "ecu" / IDENTITY).write_bytes(raw)
        with pytest.raises(ConfigError, match=IDENTITY):
            read_folder(tmp_path / "ecu")
