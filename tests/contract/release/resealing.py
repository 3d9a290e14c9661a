"""A bundle's manifest changed by someone who knows its format, with `json` and `hashlib` alone."""

import hashlib
import json
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.release import signing
from contract.release.checks import SIGNATURE
from contract.release.manifest import MANIFEST


def sealed(body: dict[str, Any]) -> bytes:
    body = {key: value for key, value in body.items() if key != "manifest_sha256"}
    plain = json.dumps(body, sort_keys=True, separators=(",", ":")).encode()
    return json.dumps({**body, "manifest_sha256": hashlib.sha256(plain).hexdigest()}).encode()


def resealed(folder: Path, key: Ed25519PrivateKey | None = None, **changes: object) -> Path:
    """Change the manifest and make its own hash right again, which needs no key; sign it only if there is one."""
    raw = sealed({**json.loads((folder / MANIFEST).read_bytes()), **changes})
    (folder / MANIFEST).write_bytes(raw)
    if key is not None:
        (folder / SIGNATURE).write_bytes(signing.sign(key, raw))
    return folder
