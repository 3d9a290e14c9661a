"""The record of calibrations: one a release, tied to its digest, so that no release runs with another one's."""

import json
from collections.abc import Mapping
from typing import Final

from can_bridge.flashing.backing import MAX_RECORD
from contract.release import strict_json

SCHEMA: Final = "stillwake-calibrations/1"
MAX_CALIBRATION: Final = 1024
"""Bytes of one."""


def encode(kept: Mapping[str, bytes]) -> bytes:
    """The record of calibrations by digest; raises ValueError for one that is too long."""
    for digest, blob in kept.items():
        if len(blob) > MAX_CALIBRATION:
            raise ValueError(f"calibration of {digest[:8]}: {len(blob)} bytes, must be at most {MAX_CALIBRATION}")
    body = {"schema": SCHEMA, "kept": {digest: blob.hex() for digest, blob in sorted(kept.items())}}
    return json.dumps(body, separators=(",", ":")).encode()


def decode(raw: bytes) -> dict[str, bytes]:
    """Calibrations by digest; raises ValueError if the record is damaged."""
    if len(raw) > MAX_RECORD:
        raise ValueError(f"calibrations: {len(raw)} bytes, must be at most {MAX_RECORD}")
    body = strict_json.decode(raw)
    if body.keys() != {"schema", "kept"} or body["schema"] != SCHEMA or not isinstance(body["kept"], dict):
        raise ValueError(f"calibrations: must be a table of schema {SCHEMA!r}")
    if not all(isinstance(text, str) for text in body["kept"].values()):
        raise ValueError("calibrations: must be texts of hex digits")
    return {digest: bytes.fromhex(text) for digest, text in body["kept"].items()}
