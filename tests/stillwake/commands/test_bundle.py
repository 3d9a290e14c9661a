"""`stillwake bundle` and `keygen` as a user meets them: keys, signatures, key lists, what is printed; what a renewed
bundle keeps; and what two bundles or images differ in."""

import hashlib
import json
import re
import shutil
import stat
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cryptography.hazmat.primitives import serialization as ser
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from contract.config.loading import load_config
from contract.config.operating_point import OperatingPoint
from contract.controller.c_folder import ECU_SETTINGS, PROGRAM_SETTINGS, Numbers, settings_header
from contract.controller.estimator import ESTIMATOR
from contract.controller.image_payload import RELEASE_PART, WEIGHTS_PART, layout_of, payload_of, sha256_of
from contract.errors import BundleError
from contract.recording import dataset
from contract.recording.dataset import Dataset
from contract.release import bundle, key_list, signing
from contract.release.checks import CONTROLLER, SIGNATURE, sha256
from contract.release.controller_image import ImageFacts, read, seal
from contract.release.difference import differences
from contract.release.manifest import MANIFEST, SpeedRange
from contract.shipped import BUNDLE
from ecu.fit import check_vehicle
from stillwake.console.terminal import console
from tests.conftest import SIGNING_KEY
from tests.contract.release.resealing import resealed
from tests.train.test_sensor_estimator import episode

KEY, NEW_KEY = SIGNING_KEY, Ed25519PrivateKey.from_private_bytes(bytes([7]) * 32)
LISTED = {name: Ed25519PrivateKey.from_private_bytes(bytes([k]) * 32) for k, name in enumerate(("root", "new", "old"))}


@pytest.fixture
def keys(tmp_path) -> Path:
    signing.write_key_pair(tmp_path / "keys", NEW_KEY)
    return tmp_path / "keys" / "release.key"


def test_keys_are_made_once_and_readable_by_their_owner_alone(printed, refused, tmp_path, monkeypatch):
    out = printed("keygen", tmp_path / "keys")
    secret, public = tmp_path / "keys" / "release.key", tmp_path / "keys" / "release.pub"
    assert signing.read_public_key(public).fingerprint in out
    assert signing.public_key(signing.read_private_key(secret)) == signing.read_public_key(public)
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    before = secret.read_bytes(), public.read_bytes()
    line = f"error: {secret}: exists already; keys are never overwritten\n"
    assert refused("keygen", tmp_path / "keys") == line
    assert (secret.read_bytes(), public.read_bytes()) == before
    # A private key without its public half is not left behind either.
    secret.unlink()
    refused("keygen", tmp_path / "keys")
    monkeypatch.setattr("contract.release.signing.PUBLIC_KEY", 300 * "k")
    assert "too long" in refused("keygen", tmp_path / "others")


def test_a_bundle_verifies_against_the_key_that_signed_it_last(cli, printed, signed, keys, public_key_file):
    assert f"by the trusted key {signing.project_key().fingerprint}" in printed("bundle", "inspect")
    assert "checks failed: manifest.sig" in cli("bundle", "inspect", signed, "--trust", "project").err
    assert cli("bundle", "inspect", signed, "--trust", public_key_file).code == 0
    bill = signed.with_name(f"{signed.name}.cdx.json")
    bill.write_text("of the old signer")
    assert cli("bundle", "sign", signed, "--key", keys).code == 0
    assert signing.read_public_key(keys.with_name("release.pub")).fingerprint in bill.read_text()
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
    of_x25519 = other.public_bytes(ser.Encoding.PEM, ser.PublicFormat.SubjectPublicKeyInfo)
    no_key = dict.fromkeys((b"", b"\xff" * 40, private), "not a public key in PEM")
    for content, named in (no_key | {of_x25519: "must be an Ed25519 key"}).items():
        path.write_bytes(content)
        line = refused("bundle", "inspect", signed, "--trust", path)
        assert line.startswith(f"error: key {path}: ") and named in line, content
    locked.write_bytes(KEY.private_bytes(ser.Encoding.PEM, ser.PrivateFormat.PKCS8, ser.BestAvailableEncryption(b"x")))
    assert "is encrypted; must be a PEM file without" in refused("bundle", "sign", signed, "--key", locked)
    assert "not a private key in PEM" in refused("bundle", "sign", signed, "--key", public_key_file)
    line = refused("export", tmp_path / "model", tmp_path / "out", "--key", tmp_path / "nowhere")
    assert line == f"error: key {tmp_path / 'nowhere'}: No such file or directory\n"


def test_a_name_is_printed_as_it_is(printed, signed, keys):
    """Rich takes square brackets for colours; `tests/contract/release` has names that a terminal would obey."""
    name = "[/x] [bold]loud[/bold]"
    resealed(signed, name=name, sensors=["[red]a", "b[/]", "c", "d"])
    (signed / SIGNATURE).unlink()
    for verb, *more in (["inspect"], ["sign", "--key", keys]):
        out = printed("bundle", verb, signed, *more)
        assert name in out, verb
    assert "[red]a, b[/], c, d" in out


def test_a_key_list_is_made_that_the_root_key_signed_and_shown(printed, refused, all_refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, key in LISTED.items():
        signing.write_key_pair(tmp_path / name, key)
    make = ["bundle", "keylist", "list", "--key", "root/release.key", "--version", "3", "--allow", "new/release.pub"]
    rows = {
        "list --key root/release.pub --version 3 --allow new/release.pub": "not a private key",
        "list --key root/release.key --version 3 --allow new/release.key": "not a public key",
    }
    all_refused("bundle keylist", rows)
    made = printed(*make, "--revoke", "old/release.pub")
    public = {name: signing.public_key(key) for name, key in LISTED.items()}
    listed = key_list.decode((tmp_path / "list").read_bytes(), public["root"])
    assert listed == key_list.KeyList(version=3, keys=frozenset({public["new"]}), revoked=frozenset({public["old"]}))
    assert all(key.fingerprint in made for key in public.values())
    for more in ((), ("--trust", "root/release.pub")):
        assert printed("bundle", "inspect", "list", *more) == made.removesuffix("wrote list\n")
    assert "must be by the root key" in refused("bundle", "inspect", "list", "--trust", "new/release.pub")
    before = (tmp_path / "list").read_bytes()
    assert "list: exists already" in refused(*make)
    assert (tmp_path / "list").read_bytes() == before


@pytest.fixture
def old(tmp_path) -> Path:
    """The shipped controller in a bundle for a DBC of another time."""
    shutil.copytree(BUNDLE, tmp_path / "old")
    return resealed(tmp_path / "old", KEY, dbc_sha256="0" * 64)


def renew(cli, old, keys, tmp_path, *more, target="new"):
    return cli("bundle", "renew", old, tmp_path / target, "--name", "renewed", "--key", keys, *more)


def test_it_may_serve_a_part_of_the_speeds(cli, old, keys, tmp_path):
    assert renew(cli, old, keys, tmp_path, "--speeds", "0.75:1.2").code == 0
    made = bundle.load(tmp_path / "new").manifest
    assert (made.speeds, made.past) == (SpeedRange(slowest=0.75, fastest=1.2), 87)
    cases = {"0.1:1.2": "the old bundle serves 0.6:1.4", "fast": "must be two numbers", "1.1:1.2": "1"}
    for given, wrong in cases.items():
        done = renew(cli, old, keys, tmp_path, "--speeds", given, target="other")
        assert (done.code, wrong in done.err, (tmp_path / "other").exists()) == (1, True, False), given


def test_the_new_one_has_the_same_controller_and_names_where_it_comes_from(cli, old, keys, public_key_file, tmp_path):
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
    assert renew(cli, old, keys, tmp_path, *demanded, public_key_file).code == 0
    assert "must be signed by key" in renew(cli, old, keys, tmp_path, *demanded, keys.with_name("release.pub")).err


@pytest.mark.slow  # fits an estimator
def test_a_sensor_estimator_can_be_fitted_to_a_recording_that_does(printed, refused, old, keys, tmp_path):
    recording = tmp_path / "short.h5"
    dataset.write(recording, Dataset(episodes=(episode("a", "train", 20),)))
    words = ("bundle", "renew", old, tmp_path / "new", "--name", "renewed", "--key", keys, "--dataset", recording)
    assert "no training episode is longer than the window of 64" in refused(*words)
    dataset.write(recording, Dataset(episodes=(episode("a", "train", 100),)))
    assert "R2 of each sensor from the others, on train: upper_39" in printed(*words)
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
    with pytest.raises(BundleError, match=r"for operating point width 2\.5, speed 6\.25, .* has .*speed 25\.0"):
        check_vehicle(found, load_config())
    other = renew(cli, BUNDLE, keys, tmp_path, "--set", "flow.reynolds=400", target="other")
    assert "`bundle renew` does not use it; this command uses mpc.weights, operating_point" in other.err


def rows_of(a, b) -> dict[str, tuple[str, str]]:
    return {row.name: (row.a, row.b) for row in differences(a, b)}


def test_its_status_is_that_of_diff(cli, printed, refused, tmp_path, monkeypatch):
    changed = shutil.copytree(BUNDLE, tmp_path / "changed")
    monkeypatch.setattr(console, "_width", 300)
    assert printed("bundle", "diff", BUNDLE, changed) == "no difference\n"
    resealed(changed, KEY, name="other", security_version=7)
    outcome = cli("bundle", "diff", BUNDLE, changed)
    assert (outcome.code, outcome.err) == (1, "")
    lines = [line for line in outcome.out.splitlines() if "│" in line]
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines]
    assert [row[0] for row in rows] == ["name", "digest", "signer", "security_version"]
    assert rows[0] == ["name", json.loads((BUNDLE / MANIFEST).read_text())["name"], "other"]
    assert rows[2] == ["signer", signing.project_key().fingerprint, signing.public_key(KEY).fingerprint]
    assert rows[3] == ["security_version", "1", "7"]
    # What does not verify is not compared.
    (changed / CONTROLLER).write_bytes(b"x")
    for pair in ((changed, BUNDLE), (BUNDLE, changed)):
        line = refused("bundle", "diff", *pair, status=2)
        assert line.startswith(f"error: bundle {changed}: {CONTROLLER} was altered")


def test_every_field_of_the_manifest_is_compared_by_its_name(tmp_path):
    changed, body = shutil.copytree(BUNDLE, tmp_path / "changed"), json.loads((BUNDLE / MANIFEST).read_text())
    body["mpc"]["weights"]["lift"] = 0.25
    body["scaling"]["pressure_mean"][2] = 0.5
    body["sensor_estimator"]["fast"][1][3] = 0.75
    deep = {name: body[name] for name in ("mpc", "scaling", "sensor_estimator")}
    odd = {
        "created": "2020-01-01", "budget_ms": 19.5, "compute_time_ms": 1.5, "hardware": "x", "dataset_sha256": "1" * 64,
        "weights_sha256": "2" * 64, "program_sha256": "3" * 64, "action_limit": 0.05, "control_period": 0.1,
        "precision": "int8" if body["precision"] == "float32" else "float32",
    }  # fmt: skip
    rows = rows_of(BUNDLE, resealed(changed, KEY, **deep, **odd, provenance={"by": "hand"}))
    for name, value in odd.items():
        assert rows[name][1] == str(value), name
    assert rows["mpc.weights.lift"][1] == "0.25"
    assert rows["provenance.by"] == ("-", "hand")
    inner = {"mpc.weights.lift", "scaling.pressure_mean[2]", "sensor_estimator.fast[1][3]"}
    assert {name for name in rows if not name.startswith("provenance")} == {"digest", "signer", *odd, *inner}


def test_files_are_compared_by_hash_and_size(tmp_path):
    sound = bundle.load(BUNDLE)
    bundle.write(tmp_path / "b", sound.manifest, {**sound.files, "notes.txt": b"hello"})
    rows = rows_of(BUNDLE, tmp_path / "b")
    digest = "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824"  # of "hello", as published
    assert rows["file notes.txt"] == ("-", f"5 bytes, {digest}")
    assert rows["signer"][1] == "unsigned"
    assert f"file {CONTROLLER}" not in rows


def image_of(*, first=1.5, scale=1, alignment=16, key=None, **changes):
    """One with two structs of two arrays each."""
    of_release = {"fast": np.array([first, 2.0]), "base": np.arange(3, dtype=np.uint8)}
    release = Numbers(struct="sw_release", members=of_release)
    rows = scale * np.arange(10, dtype=np.int8).reshape(2, 5)
    of_weights = {"mean": np.array([3, 4], dtype=np.float32), "rows": rows}
    weights = Numbers(struct="sw_weights", members=of_weights, alignment=alignment)
    ecu = {**release.settings("SW_RELEASE"), "SW_PAST": 0, "SW_SENSOR_CHECK": 0, "SW_HOLD_PERIODS": 3}
    program = {"SW_PROGRAM_SHA256": f"{scale}", "SW_PRECISION": "int8", "SW_SENSOR_NAMES": "left right"}
    files = {
        PROGRAM_SETTINGS: settings_header({**program, "SW_ALIGNMENT": alignment, **weights.settings("SW_WEIGHTS")}),
        ECU_SETTINGS: settings_header(ecu),
        RELEASE_PART: release.packed(),
        WEIGHTS_PART: weights.packed(),
    }
    facts: dict[str, Any] = {"name": "small", "hardware": None, "security_version": 0, "action_limit": 0.075}
    facts |= {"layout": sha256_of(layout_of(files)), "dbc": bytes(32), "digest": bytes(32), "period_ns": 20_000_000}
    facts |= {"sensors": 2, "operating_point": (2.5, 25.0, 1.2), **changes}
    return seal(payload_of(files), ImageFacts(**facts), key)


def test_what_two_images_differ_in_is_named(tmp_path, cli, refused, monkeypatch):
    monkeypatch.setattr(console, "_width", 200)
    one, other = tmp_path / "one.swi", tmp_path / "other.swi"
    own = signing.public_key(KEY).fingerprint
    one.write_bytes(image_of(key=KEY))
    for changes, expected in (
        ({"key": KEY}, {}),
        ({"first": 2.5, "key": KEY}, {"array release.fast": ("1.5 2.0", "2.5 2.0")}),
        ({"hardware": "board"}, {"signer": (own, "unsigned"), "hardware": ("any", "board")}),
    ):
        other.write_bytes(image_of(**changes))
        assert rows_of(one, other) == expected
    # Of a long array the hash; the program's own hash is no part of the layout.
    other.write_bytes(image_of(scale=2, key=KEY))
    (row,) = differences(one, other)
    assert row.name == "array weights.rows" and row.a.startswith("int8 2x5, ") and row.a != row.b
    other.write_bytes(image_of(alignment=64, key=KEY))
    assert set(rows_of(one, other)) == {"layout", "payload", "SW_ALIGNMENT", "SW_WEIGHTS_BYTES"}
    assert cli("bundle", "diff", one, other).code == 1
    shown = cli("bundle", "inspect", one).out
    assert re.search(r"sensors +│ left, right", shown) and re.search(r"control period +│ 20 ms", shown)
    assert "must be signed by" in refused("bundle", "inspect", one, "--trust", "project")
    other.write_bytes(image_of(first=float("nan"), key=KEY))
    assert "image: release.fast holds nan: must be in -1" in refused("bundle", "inspect", other)
    other.write_bytes(image_of()[:-1])
    assert "but states a length of" in refused("bundle", "inspect", other)
    assert "No such file" in refused("bundle", "inspect", tmp_path / "none.swi")
    for line in (b"SW_X \xff", b"SW_ALIGNMENT", b"SW_ALIGNMENT 0", b'SW_WEIGHTS_LAYOUT "mean float9 2 0"'):
        payload = (image := read(one.read_bytes())).payload + line  # ends in a layout that no export wrote
        layout = bytes.fromhex(sha256(payload[payload.rindex(b"layout 2") :]))
        other.write_bytes(seal(payload, ImageFacts(**vars(image.facts) | {"layout": layout}), None))
        assert "image: its layout text" in refused("bundle", "diff", one, other, status=2)
