"""The releases of the proof: the shipped one, renewed under a key of the bench's own; the second replaces the first."""

import tempfile
from functools import cache
from pathlib import Path
from typing import Final

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.flashing.verdicts import Verdict
from contract.release import bundle, key_list, signing
from contract.release.bundle import Bundle
from contract.release.container import read_files
from contract.release.image import image_of
from contract.release.key_list import KeyList
from contract.shipped import BUNDLE

_ROOT_KEY: Final = Ed25519PrivateKey.from_private_bytes(b"root of the bench, secret to non")
_RELEASE_KEY: Final = Ed25519PrivateKey.from_private_bytes(b"key of the bench, secret to none")
ROOT: Final = signing.public_key(_ROOT_KEY)
ACCESS: Final = b"access to bench."
HARDWARE: Final = "bench"


def fits(_: Bundle) -> Verdict:
    """Whether a release is for the vehicle; here all are."""
    return Verdict.GOOD


@cache
def keys() -> bytes:
    """The key list."""
    return key_list.encode(KeyList(version=1, keys=frozenset({signing.public_key(_RELEASE_KEY)})), _ROOT_KEY)


@cache
def image(security_version: int, key: Ed25519PrivateKey = _RELEASE_KEY) -> bytes:
    """The image of the release with this security version."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "bundle"
        bundle.renew(
            BUNDLE,
            target,
            name=f"bench-{security_version}",
            created="2026-01-01",
            key=key,
            security_version=security_version,
        )
        return image_of(read_files(target))
