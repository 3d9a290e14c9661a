"""`stillwake bundle diff`: nothing that was changed goes unseen, and the exit status is that of diff(1)."""

import json
import shutil

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.release import bundle, signing
from contract.release.checks import CONTROLLER
from contract.release.difference import differences
from contract.release.manifest import MANIFEST
from contract.shipped import BUNDLE
from stillwake.console.terminal import console
from tests.contract.release.resealing import resealed

KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))


@pytest.fixture
def changed(tmp_path):
    """A copy of the shipped bundle, to be changed."""
    return shutil.copytree(BUNDLE, tmp_path / "changed")


def rows_of(a, b) -> dict[str, tuple[str, str]]:
    return {row.name: (row.a, row.b) for row in differences(a, b)}


def test_its_status_is_that_of_diff(cli, refused, changed, tmp_path, monkeypatch):
    monkeypatch.setattr(console, "_width", 300)
    outcome = cli("bundle", "diff", BUNDLE, changed)
    assert (outcome.code, outcome.out, outcome.err) == (0, "no difference\n", "")
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


def test_every_field_of_the_manifest_is_compared_by_its_name(changed):
    body = json.loads((BUNDLE / MANIFEST).read_text())
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
