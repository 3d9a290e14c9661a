"""Controller images as people see them: what one holds, and in what two differ."""

import re
from typing import Any

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.controller.c_folder import ECU_SETTINGS, PROGRAM_SETTINGS, settings_header
from contract.controller.c_numbers import Numbers
from contract.controller.image_payload import RELEASE_PART, WEIGHTS_PART, layout_of, payload_of, sha256_of
from contract.errors import BundleContainerError
from contract.release import signing
from contract.release.controller_image import ImageFacts, seal
from contract.release.difference import differences, opened
from stillwake.console.terminal import console

KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))
OWN = signing.public_key(KEY).fingerprint


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
    one.write_bytes(image_of(key=KEY))
    for changes, expected in (
        ({"key": KEY}, {}),
        ({"first": 2.5, "key": KEY}, {"array release.fast": ("1.5 2.0", "2.5 2.0")}),
        (
            {"hardware": "board"},
            {"signer": (signing.public_key(KEY).fingerprint, "unsigned"), "hardware": ("any", "board")},
        ),
    ):
        other.write_bytes(image_of(**changes))
        assert {row.name: (row.a, row.b) for row in differences(one, other)} == expected
    # Of a long array the hash; the program's own hash is no part of the layout.
    other.write_bytes(image_of(scale=2, key=KEY))
    (row,) = differences(one, other)
    assert row.name == "array weights.rows" and row.a.startswith("int8 2x5, ") and row.a != row.b
    other.write_bytes(image_of(alignment=64, key=KEY))
    assert {row.name for row in differences(one, other)} == {"layout", "payload", "SW_ALIGNMENT", "SW_WEIGHTS_BYTES"}
    assert cli("bundle", "diff", one, other).code == 1
    shown = cli("bundle", "inspect", one).out
    assert re.search(r"sensors +│ left, right", shown) and re.search(r"control period +│ 20 ms", shown)
    assert "must be signed by" in refused("bundle", "inspect", one, "--trust", "project")
    other.write_bytes(image_of(first=float("nan"), key=KEY))
    assert "image: release.fast holds nan: must be in -1" in refused("bundle", "inspect", other)
    other.write_bytes(image_of()[:-1])
    with pytest.raises(BundleContainerError, match="bytes states"):
        opened(other)
    with pytest.raises(BundleContainerError, match="No such file"):
        opened(tmp_path / "none.swi")
