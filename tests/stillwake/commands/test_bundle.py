"""Release bundles as a user meets them: keys, signatures, key lists, and what `bundle` prints."""

import json
import stat

import pytest
from cryptography.hazmat.primitives import serialization as ser
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from contract.release import key_list, signing
from contract.release.checks import CONTROLLER, SIGNATURE
from contract.release.manifest import MANIFEST
from contract.release.signing import read_public_key
from stillwake.console.terminal import console
from tests.contract.release.resealing import resealed

KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))
LISTED = {
    name: Ed25519PrivateKey.from_private_bytes(bytes([at]) * 32) for at, name in enumerate(("root", "new", "old"))
}


@pytest.fixture
def keys(cli, tmp_path):
    cli("keygen", tmp_path / "keys")
    return tmp_path / "keys" / "release.key"


def test_keys_are_made_once_and_readable_by_their_owner_alone(cli, tmp_path, monkeypatch):
    made = cli("keygen", tmp_path / "keys")
    secret, public = tmp_path / "keys" / "release.key", tmp_path / "keys" / "release.pub"
    assert signing.read_public_key(public).fingerprint in made.out
    assert signing.public_key(signing.read_private_key(secret)) == signing.read_public_key(public)
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    before = secret.read_bytes(), public.read_bytes()
    again = cli("keygen", tmp_path / "keys")
    assert (again.code, again.err) == (1, f"error: {secret}: exists already; keys are never overwritten\n")
    assert (secret.read_bytes(), public.read_bytes()) == before
    # A private key without its public half is not left behind either.
    secret.unlink()
    assert cli("keygen", tmp_path / "keys").code == 1
    monkeypatch.setattr("contract.release.signing.PUBLIC_KEY", 300 * "k")
    assert "too long" in cli("keygen", tmp_path / "others").err
    assert not (tmp_path / "others").exists()
    assert not secret.exists()


def test_a_bundle_verifies_against_the_key_that_signed_it_last(cli, signed, keys, public_key_file):
    ours = cli("bundle", "inspect")
    assert (ours.code, ours.err) == (0, "")
    assert f"by the trusted key {signing.project_key().fingerprint}" in ours.out
    assert "checks failed: manifest.sig" in cli("bundle", "inspect", signed, "--trust", "project").err
    assert cli("bundle", "inspect", signed, "--trust", public_key_file).code == 0
    bill = signed.with_name(f"{signed.name}.cdx.json")
    bill.write_text("of the old signer")
    assert cli("bundle", "sign", signed, "--key", keys).code == 0
    assert read_public_key(keys.with_name("release.pub")).fingerprint in bill.read_text()
    assert cli("bundle", "inspect", signed, "--trust", keys.with_name("release.pub")).code == 0
    assert cli("bundle", "inspect", signed, "--trust", public_key_file).code == 1
    # What is altered is not signed.
    (signed / CONTROLLER).write_bytes((signed / CONTROLLER).read_bytes()[:-1])
    before = (signed / SIGNATURE).read_bytes()
    assert "controller.onnx was altered" in cli("bundle", "sign", signed, "--key", keys).err
    assert (signed / SIGNATURE).read_bytes() == before


def test_inspect_shows_what_the_manifest_ties_together(cli, signed, monkeypatch):
    monkeypatch.setattr(console, "_width", 200)
    out = cli("bundle", "inspect", signed).out
    manifest = json.loads((signed / MANIFEST).read_text())
    facts = [manifest[f"{name}_sha256"] for name in ("dataset", "weights", "program", "dbc", "manifest")]
    facts += [f"{name} {value:g}" for name, value in manifest["mpc"]["weights"].items()]
    facts += [manifest["name"], manifest["created"], "int8", *manifest["sensors"], "W 2.5 m", "20 ms", "horizon 8"]
    facts += [f"{(signed / CONTROLLER).stat().st_size} bytes", signing.public_key(KEY).fingerprint]
    assert [text for text in facts if text not in out] == []
    resealed(signed, KEY, sensor_positions=None)
    assert "position" not in cli("bundle", "inspect", signed).out
    resealed(signed, KEY, sensor_positions=[[0.25 * k, -0.5] for k in range(len(manifest["sensors"]))])
    out = cli("bundle", "inspect", signed).out
    assert f"position {manifest['sensors'][1]}" in out
    assert "x +0.2500 W, y -0.5000 W" in out


def test_a_file_that_is_no_key_is_named(refused, signed, public_key_file, tmp_path):
    path, locked = tmp_path / "key.pem", tmp_path / "locked.pem"
    private = KEY.private_bytes(ser.Encoding.PEM, ser.PrivateFormat.PKCS8, ser.NoEncryption())
    other = X25519PrivateKey.generate().public_key()
    for content, named in (
        (b"", "not a public key in PEM"),
        (b"\xff" * 40, "not a public key in PEM"),
        (private, "not a public key in PEM"),
        (other.public_bytes(ser.Encoding.PEM, ser.PublicFormat.SubjectPublicKeyInfo), "must be an Ed25519 key"),
    ):
        path.write_bytes(content)
        line = refused("bundle", "inspect", signed, "--trust", path)
        assert line.startswith(f"error: key {path}: ") and named in line, content
    locked.write_bytes(KEY.private_bytes(ser.Encoding.PEM, ser.PrivateFormat.PKCS8, ser.BestAvailableEncryption(b"x")))
    assert "is encrypted; must be a PEM file without" in refused("bundle", "sign", signed, "--key", locked)
    assert "not a private key in PEM" in refused("bundle", "sign", signed, "--key", public_key_file)
    line = refused("export", tmp_path / "model", tmp_path / "out", "--key", tmp_path / "nowhere")
    assert line == f"error: key {tmp_path / 'nowhere'}: No such file or directory\n"


def test_a_name_is_printed_as_it_is(cli, signed, keys):
    """Rich takes square brackets for colours; `tests/contract/release` has names that a terminal would obey."""
    name = "[/x] [bold]loud[/bold]"
    resealed(signed, name=name, sensors=["[red]a", "b[/]", "c", "d"])
    (signed / SIGNATURE).unlink()
    for verb, *more in (["inspect"], ["sign", "--key", keys]):
        outcome = cli("bundle", verb, signed, *more)
        assert (outcome.code, outcome.err, name in outcome.out) == (0, "", True), verb
    assert "[red]a, b[/], c, d" in outcome.out


def test_a_key_list_is_made_that_the_root_key_signed_and_shown(cli, all_refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, key in LISTED.items():
        signing.write_key_pair(tmp_path / name, key)
    make = ["bundle", "keylist", "list", "--key", "root/release.key", "--version", "3", "--allow", "new/release.pub"]
    all_refused(
        "bundle keylist",
        {
            "list --key root/release.pub --version 3 --allow new/release.pub": "not a private key",
            "list --key root/release.key --version 0 --allow new/release.pub": "version 0: must be in",
            "list --key root/release.key --version 3 --allow new/release.key": "not a public key",
            f"{' '.join(make[2:])} --revoke new/release.pub": "is allowed and revoked",
        },
    )
    made = cli(*make, "--revoke", "old/release.pub")
    assert (made.code, made.err) == (0, "")
    public = {name: signing.public_key(key) for name, key in LISTED.items()}
    listed = key_list.decode((tmp_path / "list").read_bytes(), public["root"])
    assert listed == key_list.KeyList(version=3, keys=frozenset({public["new"]}), revoked=frozenset({public["old"]}))
    assert all(key.fingerprint in made.out for key in public.values())
    for more in ((), ("--trust", "root/release.pub")):
        shown = cli("bundle", "inspect", "list", *more)
        assert (shown.code, shown.err, shown.out) == (0, "", made.out.removesuffix("wrote list\n"))
    other = cli("bundle", "inspect", "list", "--trust", "new/release.pub")
    assert (other.code, other.out, "must be by the root key" in other.err) == (1, "", True)
    before = (tmp_path / "list").read_bytes()
    assert "list: exists already" in cli(*make).err
    assert (tmp_path / "list").read_bytes() == before
