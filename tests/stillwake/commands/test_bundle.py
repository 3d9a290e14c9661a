"""Release bundles as a user meets them: keys, signatures, what `bundle` prints, and what a run reports of them."""

import hashlib
import json
import shutil
import stat

import onnx
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.release import bundle, signing
from contract.release.bundle import CONTROLLER, SIGNATURE
from contract.release.manifest import MANIFEST
from stillwake.console.terminal import console
from tests.contract.release.resealing import resealed

KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))
TRUSTED = signing.public_key(KEY)


def test_the_shipped_bundle_verifies_against_the_projects_key(cli):
    outcome = cli("bundle", "verify")
    assert (outcome.code, outcome.err) == (0, "")
    assert f"by the trusted key {signing.project_key().fingerprint}" in outcome.out


def test_the_shipped_bundle_is_not_anyones(cli, public_key_file, tmp_path):
    outcome = cli("run", tmp_path / "run", "--trust", public_key_file)
    assert outcome.code == 1
    assert f"signed by key {signing.project_key().fingerprint}, must be signed by key {TRUSTED.fingerprint}" in (
        outcome.err
    )


def test_a_bundle_of_someone_else_is_not_the_projects(cli, signed):
    assert "checks failed: manifest.sig" in cli("bundle", "verify", signed, "--trust", "project").err


def test_signing_does_not_change_the_digest(random_release, sound):
    assert bundle.load(random_release).digest == bundle.load(sound).digest


@pytest.mark.slow  # whole runs with their reports
def test_a_run_reports_what_a_signature_is_worth_and_keeps_it(cli, signed, tmp_path):
    spans = ["--lead-in", 0.4, "--controlled", 0.4, "--no-averages"]
    outcome = cli("run", tmp_path / "run", "--bundle", signed, *spans)
    # Too short for the controller's window: never in control.
    assert (outcome.code, outcome.err) == (3, "")
    assert outcome.out.count("warning: ") == 1
    assert f"warning: signed by key {TRUSTED.fingerprint}: unknown here" in outcome.out
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["signer"] == TRUSTED.fingerprint
    assert f"signed by key {TRUSTED.fingerprint}" in (tmp_path / "run" / "report.html").read_text()


def test_inspect_shows_what_the_manifest_ties_together(cli, signed, monkeypatch):
    monkeypatch.setattr(console, "_width", 200)
    out = cli("bundle", "inspect", signed).out
    manifest = json.loads((signed / MANIFEST).read_text())
    hashes = [manifest[f"{name}_sha256"] for name in ("dataset", "weights", "program", "dbc", "manifest")]
    size = (signed / CONTROLLER).stat().st_size
    weights = [f"{name} {value:g}" for name, value in manifest["mpc"]["weights"].items()]
    point = ["W 2.5 m", "U_inf 25 m/s", "rho 1.2 kg/m3"]
    timing = ["0.2 t_c, 20 ms", "8 ms for the control step"]
    facts = [manifest["name"], manifest["created"], "int8", *manifest["sensors"], "horizon 8", "5 iterations", "0.075"]
    for text in [*hashes, *weights, *point, *timing, *facts, f"{size} bytes", TRUSTED.fingerprint]:
        assert text in out


def test_keys_are_made_once_and_readable_by_their_owner_alone(cli, tmp_path):
    made = cli("bundle", "keygen", tmp_path / "keys")
    secret, public = tmp_path / "keys" / "release.key", tmp_path / "keys" / "release.pub"
    assert signing.read_public_key(public).fingerprint in made.out
    assert signing.public_key(signing.read_private_key(secret)) == signing.read_public_key(public)
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    before = secret.read_bytes(), public.read_bytes()
    again = cli("bundle", "keygen", tmp_path / "keys")
    assert (again.code, again.err) == (1, f"error: {secret}: is there already; keys are never overwritten\n")
    assert (secret.read_bytes(), public.read_bytes()) == before
    # A private key without its public half is not left behind either.
    secret.unlink()
    assert cli("bundle", "keygen", tmp_path / "keys").code == 1
    assert not secret.exists()


def test_sign_then_verify_then_sign_again(cli, random_release, tmp_path):
    path = shutil.copytree(random_release, tmp_path / "bundle")
    for folder in ("first", "second"):
        cli("bundle", "keygen", tmp_path / folder)
        assert cli("bundle", "sign", path, "--key", tmp_path / folder / "release.key").code == 0
        assert cli("bundle", "verify", path, "--trust", tmp_path / folder / "release.pub").code == 0
    assert cli("bundle", "verify", path, "--trust", tmp_path / "first" / "release.pub").code == 1


def test_an_altered_bundle_is_not_signed(cli, signed, tmp_path):
    cli("bundle", "keygen", tmp_path / "keys")
    (signed / CONTROLLER).write_bytes((signed / CONTROLLER).read_bytes()[:-1])
    before = (signed / SIGNATURE).read_bytes()
    outcome = cli("bundle", "sign", signed, "--key", tmp_path / "keys" / "release.key")
    assert "controller.onnx was altered" in outcome.err
    assert (signed / SIGNATURE).read_bytes() == before


def test_a_key_that_is_none_is_named(cli, signed, tmp_path):
    from cryptography.hazmat.primitives import serialization as ser
    from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

    path = tmp_path / "key.pem"
    private = KEY.private_bytes(ser.Encoding.PEM, ser.PrivateFormat.PKCS8, ser.NoEncryption())
    other = X25519PrivateKey.generate().public_key()
    x25519 = other.public_bytes(ser.Encoding.PEM, ser.PublicFormat.SubjectPublicKeyInfo)
    for content, named in (
        (None, "No such file"),
        (b"", "not a public key in PEM"),
        (b"\xff" * 40, "not a public key in PEM"),
        (private, "not a public key in PEM"),
        (x25519, "must be an Ed25519 key"),
    ):
        if content is not None:
            path.write_bytes(content)
        outcome = cli("bundle", "verify", signed, "--trust", path)
        assert (outcome.code, outcome.err.count("\n")) == (1, 1), content
        assert outcome.err.startswith(f"error: key {path}: ") and named in outcome.err, content


def test_a_private_key_that_is_none_is_named(cli, signed, public_key_file, tmp_path):
    from cryptography.hazmat.primitives import serialization as ser

    locked = tmp_path / "locked.pem"
    locked.write_bytes(KEY.private_bytes(ser.Encoding.PEM, ser.PrivateFormat.PKCS8, ser.BestAvailableEncryption(b"x")))
    assert "is encrypted; must be a PEM file without" in cli("bundle", "sign", signed, "--key", locked).err
    assert "not a private key in PEM" in cli("bundle", "sign", signed, "--key", public_key_file).err
    line = cli("export", tmp_path / "model", tmp_path / "out", "--key", tmp_path / "nowhere").err
    assert line == f"error: key {tmp_path / 'nowhere'}: No such file or directory\n"


def test_signatures_follow_the_published_test_vector():
    """RFC 8032, section 7.1, test 1: the empty message."""
    key = Ed25519PrivateKey.from_private_bytes(
        bytes.fromhex("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60")
    )
    text = signing.sign(key, b"").decode()
    assert text.splitlines()[1:] == [
        "key d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a",
        "signature e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e06522490155"
        "5fb8821590a33bacc61e39701cf9b46bd25bf5f0595bbe24655141438e7a100b",
    ]
    assert signing.signer(text.encode(), b"") == signing.public_key(key)
    assert signing.signer(text.encode(), b"\0") is None


def test_a_name_with_markup_is_printed_as_it_is(cli, signed, tmp_path):
    """Rich takes square brackets for colours; an unknown closing one would be an error of its own."""
    name = "[/x] [bold]loud[/bold]"
    resealed(signed, name=name, sensors=["[red]a", "b[/]", "c", "d"])
    (signed / SIGNATURE).unlink()
    assert name in cli("bundle", "verify", signed).out
    assert name in cli("bundle", "inspect", signed).out
    cli("bundle", "keygen", tmp_path / "keys")
    outcome = cli("bundle", "sign", signed, "--key", tmp_path / "keys" / "release.key")
    assert (outcome.code, outcome.err) == (0, "")
    assert f"bundle {name} " in outcome.out
    assert "[red]a, b[/], c, d" in outcome.out


def test_a_name_that_a_terminal_would_obey_never_reaches_it(cli, signed, tmp_path):
    cli("bundle", "keygen", tmp_path / "keys")
    (signed / SIGNATURE).unlink()
    for name in ("\x1b[2J\x1b]0;title\x07", "\ud800", "a\nb", "x" * 10_000):
        resealed(signed, name=name)
        for verb, *more in (["verify"], ["inspect"], ["sign", "--key", tmp_path / "keys" / "release.key"]):
            outcome = cli("bundle", verb, signed, *more)
            assert outcome.code == 1, (verb, name)
            assert all(line.isprintable() for line in (outcome.out + outcome.err).splitlines()), (verb, name)
            assert len(outcome.err.splitlines()) == 1, (verb, name)


def test_inspect_shows_positions_where_they_are_known(cli, signed, monkeypatch):
    monkeypatch.setattr(console, "_width", 200)
    assert "position" not in cli("bundle", "inspect", signed).out
    sensors = json.loads((signed / MANIFEST).read_bytes())["sensors"]
    resealed(signed, sensor_positions=[[0.25 * k, -0.5] for k in range(len(sensors))])
    (signed / SIGNATURE).unlink()
    out = cli("bundle", "inspect", signed).out
    assert f"position {sensors[1]}" in out
    assert "x +0.2500 W, y -0.5000 W" in out


def test_a_graph_that_reads_other_files_is_neither_signed_nor_loaded(cli, signed, tmp_path):
    """Its own hash is right, and so could a signature be: what it computes would lie in the working directory."""
    model = onnx.load_from_string((signed / CONTROLLER).read_bytes())
    tensor = next(item for item in model.graph.initializer if item.data_type == onnx.TensorProto.FLOAT)
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="weights.bin")
    tensor.ClearField("raw_data")
    content = model.SerializeToString()
    (signed / CONTROLLER).write_bytes(content)
    resealed(signed, KEY, files={CONTROLLER: hashlib.sha256(content).hexdigest()})
    cli("bundle", "keygen", tmp_path / "keys")
    expected = "a constant is kept in another file"
    assert expected in cli("bundle", "sign", signed, "--key", tmp_path / "keys" / "release.key").err
    assert expected in cli("bundle", "inspect", signed).err
    verified = cli("bundle", "verify", signed)
    assert "checks failed: graph" in verified.err
    assert expected in verified.out
