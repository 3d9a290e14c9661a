"""`stillwake bundle keylist`: a list that an ECU takes."""

import json

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.release import key_list, signing

KEYS = {name: Ed25519PrivateKey.from_private_bytes(bytes([at]) * 32) for at, name in enumerate(("root", "new", "old"))}


@pytest.fixture(autouse=True)
def _in_a_folder_with_keys(tmp_path, monkeypatch):
    for name, key in KEYS.items():
        signing.write_key_pair(tmp_path / name, key)
    monkeypatch.chdir(tmp_path)


def make(cli, *more: object):
    return cli(
        "bundle", "keylist", "list", "--root", "root/release.key", "--version", 3, "--key", "new/release.pub", *more
    )


def test_a_list_is_made_that_the_root_key_signed(cli, tmp_path):
    outcome = make(cli, "--revoke", "old/release.pub")
    assert (outcome.code, outcome.err) == (0, "")
    raw = (tmp_path / "list").read_bytes()
    listed = key_list.decode(raw, signing.public_key(KEYS["root"]))
    assert listed == key_list.KeyList(
        version=3,
        keys=frozenset({signing.public_key(KEYS["new"])}),
        revoked=frozenset({signing.public_key(KEYS["old"])}),
    )
    assert json.loads(raw[:-230])["keys"] == [KEYS["new"].public_key().public_bytes_raw().hex()]
    for name in KEYS:
        assert signing.public_key(KEYS[name]).fingerprint in outcome.out


def test_a_list_is_shown(cli):
    made = make(cli)
    for more in ([], ["--root", "root/release.pub"]):
        shown = cli("bundle", "keylist", "list", "--show", *more)
        assert (shown.code, shown.err) == (0, "")
        assert shown.out == made.out.removesuffix("wrote list\n")


def test_a_list_of_another_root_is_refused_where_one_is_demanded(cli):
    make(cli)
    outcome = cli("bundle", "keylist", "list", "--show", "--root", "new/release.pub")
    assert (outcome.code, outcome.out) == (1, "")
    assert "must be by the root key" in outcome.err


def test_a_list_is_not_replaced_unasked(cli, tmp_path):
    make(cli)
    before = (tmp_path / "list").read_bytes()
    again = make(cli, "--revoke", "old/release.pub")
    assert (again.code, "--overwrite" in again.err) == (1, True)
    assert (tmp_path / "list").read_bytes() == before
    assert make(cli, "--revoke", "old/release.pub", "--overwrite").code == 0
    assert (tmp_path / "list").read_bytes() != before


def test_what_makes_no_list_is_refused_in_one_line(cli, tmp_path):
    for arguments, message in (
        (["list"], "give --root, --version and at least one --key"),
        (["list", "--root", "root/release.key", "--version", 3], "at least one --key"),
        (["list", "--root", "root/release.pub", "--version", 3, "--key", "new/release.pub"], "not a private key"),
        (["list", "--root", "root/release.key", "--version", 0, "--key", "new/release.pub"], "version 0: must be in"),
        (["list", "--root", "root/release.key", "--version", 3, "--key", "none"], "No such file"),
        (["list", "--root", "root/release.key", "--version", 3, "--key", "new/release.key"], "not a public key"),
        (
            [
                "list",
                "--root",
                "root/release.key",
                "--version",
                3,
                *["--key", "new/release.pub"],
                *["--revoke", "new/release.pub"],
            ],
            "is allowed and revoked",
        ),
        (["list", "--show"], "No such file"),
        (["new", "--show"], "Is a directory"),
        (["root/release.pub", "--show"], "has no signature"),
        (["list", "--show", "--version", 3], "--show takes no --version"),
    ):
        outcome = cli("bundle", "keylist", *arguments)
        assert (outcome.code, outcome.out) == (1, "")
        assert message in outcome.err
        assert outcome.err.count("\n") == 1
        assert not (tmp_path / "list").exists()
