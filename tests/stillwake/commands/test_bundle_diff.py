"""`stillwake bundle diff`: nothing that was changed goes unseen, and the exit status is that of diff(1)."""

import json
import shutil
import subprocess

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.release import bundle, signing
from contract.release.bundle import CONTROLLER
from contract.release.difference import differences
from contract.release.manifest import MANIFEST
from contract.shipped import BUNDLE
from tests.contract.release.resealing import resealed

KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))

ALWAYS = {"digest"}
"""Of bundles with another manifest."""


@pytest.fixture
def shipped(tmp_path):
    """A copy of the shipped bundle, to be changed."""
    shutil.copytree(BUNDLE, tmp_path / "changed")
    return tmp_path / "changed"


def found(a, b) -> dict[str, tuple[str, str]]:
    return {row.name: (row.a, row.b) for row in differences(a, b)}


def test_the_same_bundle_is_the_same_in_a_zip(cli, shipped, tmp_path):
    subprocess.run(["zip", "-qr", tmp_path / "b.zip", "."], cwd=shipped, check=True)
    for other in (shipped, tmp_path / "b.zip"):
        outcome = cli("bundle", "diff", BUNDLE, other)
        assert (outcome.code, outcome.out, outcome.err) == (0, "no difference\n", "")


def test_what_differs_is_a_table(cli, shipped):
    resealed(shipped, KEY, name="other", security_version=7)
    outcome = cli("bundle", "diff", BUNDLE, shipped)
    assert (outcome.code, outcome.err) == (1, "")
    rows: list[list[str]] = []
    for line in outcome.out.splitlines():
        if "│" in line:
            cells = [cell.strip() for cell in line.split("│")[1:-1]]
            if cells[0]:
                rows.append(cells)
            else:
                # What a narrow column did not hold.
                rows[-1] = [above + below for above, below in zip(rows[-1], cells, strict=True)]
    shipped_name = json.loads((BUNDLE / MANIFEST).read_text())["name"]
    signers = signing.project_key().fingerprint, signing.public_key(KEY).fingerprint
    assert [row[0] for row in rows] == ["name", "digest", "signer", "security_version"]
    assert rows[0] == ["name", shipped_name, "other"]
    assert rows[2] == ["signer", *signers]
    assert rows[3] == ["security_version", "1", "7"]


def test_a_single_figure_of_a_table_is_named(shipped):
    body = json.loads((BUNDLE / MANIFEST).read_text())
    body["mpc"]["weights"]["lift"] = 0.25
    body["scaling"]["pressure_mean"][2] = 0.5
    body["sensor_estimator"]["fast"][1][3] = 0.75
    changes = {name: body[name] for name in ("mpc", "scaling", "sensor_estimator")}
    rows = found(BUNDLE, resealed(shipped, KEY, **changes))
    assert rows.keys() - ALWAYS == {
        "signer", "mpc.weights.lift", "scaling.pressure_mean[2]", "sensor_estimator.fast[1][3]"
    }  # fmt: skip
    assert rows["mpc.weights.lift"][1] == "0.25"


def test_every_field_of_the_manifest_is_compared(shipped):
    body = json.loads((BUNDLE / MANIFEST).read_text())
    odd = {
        "created": "2020-01-01", "budget_ms": 19.5, "compute_time_ms": 1.5, "hardware": "x", "window": body["window"],
        "dataset_sha256": "1" * 64, "weights_sha256": "2" * 64, "program_sha256": "3" * 64, "precision": "float32",
        "action_limit": 0.05, "control_period": 0.1, "provenance": {"by": "hand"},
    }  # fmt: skip
    odd["precision"] = "int8" if body["precision"] == "float32" else "float32"
    rows = found(BUNDLE, resealed(shipped, KEY, **odd))
    for name in odd.keys() - {"window", "provenance"}:
        assert rows[name][1] == str(odd[name])
    assert rows["provenance.by"] == ("-", "hand")


def test_files_are_compared_by_hash_and_size(tmp_path):
    sound = bundle.load(BUNDLE)
    changed = {**sound.files, "notes.txt": b"hello"}
    bundle.write(tmp_path / "b", sound.manifest, changed)
    rows = found(BUNDLE, tmp_path / "b")
    digest = "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824"  # of "hello", as published
    assert rows["file notes.txt"] == ("-", f"5 bytes, {digest}")
    assert rows["signer"][1] == "unsigned"
    assert f"file {CONTROLLER}" not in rows


def test_what_does_not_verify_is_not_compared(cli, shipped):
    for first in (
        True,
        False,
    ):
        (shipped / CONTROLLER).write_bytes(b"x")
        outcome = cli("bundle", "diff", *((shipped, BUNDLE) if first else (BUNDLE, shipped)))
        assert outcome.code == 2
        assert outcome.err.startswith(f"error: bundle {shipped}: {CONTROLLER} was altered")
        assert outcome.err.count("\n") == 1


def test_a_key_can_be_demanded_of_both(cli, shipped):
    resealed(shipped, KEY, name="other")
    outcome = cli("bundle", "diff", BUNDLE, shipped, "--trust", "project")
    assert (outcome.code, "must be signed by" in outcome.err) == (2, True)
