"""`stillwake bundle diff`: nothing that was changed in a bundle or an image goes unseen, and the exit status is that of
diff(1)."""

import json
import re
import shutil
from typing import Any

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.controller.c_folder import ECU_SETTINGS, PROGRAM_SETTINGS, Numbers, settings_header
from contract.controller.image_payload import RELEASE_PART, WEIGHTS_PART, layout_of, payload_of, sha256_of
from contract.release import bundle, signing
from contract.release.checks import CONTROLLER, sha256
from contract.release.controller_image import ImageFacts, read, seal
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


def image_of(*, first=1.5, scale=1, alignment=16, key=None, **changes):
    """One with two structs of two arrays each."""
    release = Numbers(
        struct="sw_release", members={"fast": np.array([first, 2.0]), "base": np.arange(3, dtype=np.uint8)}
    )
    rows = scale * np.arange(10, dtype=np.int8).reshape(2, 5)
    weights = Numbers(
        struct="sw_weights", members={"mean": np.array([3, 4], dtype=np.float32), "rows": rows}, alignment=alignment
    )
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
    assert "bytes states" in refused("bundle", "inspect", other)
    assert "No such file" in refused("bundle", "inspect", tmp_path / "none.swi")
    for line in (b"SW_X \xff", b"SW_ALIGNMENT", b"SW_ALIGNMENT 0", b'SW_WEIGHTS_LAYOUT "mean float9 2 0"'):
        payload = (image := read(one.read_bytes())).payload + line  # ends in a layout that no export wrote
        layout = bytes.fromhex(sha256(payload[payload.rindex(b"layout 2") :]))
        other.write_bytes(seal(payload, ImageFacts(**vars(image.facts) | {"layout": layout}), None))
        assert "image: the text of its layout" in refused("bundle", "diff", one, other, status=2)
