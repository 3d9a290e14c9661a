"""The list of keys that may sign releases for an ECU. The list has a version, and a root key signs it.

A release key that leaks is removed from the list. The root key signs only such lists, so it is rarely needed and can
stay in a safe. An ECU gets its root key in production. The ECU accepts a new list only if the root key signed it, and
only if its version is greater than the present list's version. So an old list cannot make a revoked key valid again.

    0   8   "SWKEYS01"
    8   4   version
    12  1   number of keys, n
    13  1   number of revoked keys, m
    14  2   zeros
    16  32  root key
    48      the n keys of 32 bytes, ascending, then the m revoked keys, ascending
        64  Ed25519 signature by the root key of all bytes before it

Numbers are big-endian.
"""

import struct
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.errors import KeyFileError
from contract.release import signing
from contract.release.signing import PublicKey

LARGEST_VERSION: Final = 2**32 - 1
MAX_KEYS: Final = 16
VERSION: Final = slice(8, 12)
"""Position of the version in a list."""
_MAGIC: Final = b"SWKEYS01"
_HEADER: Final = struct.Struct(">8sIBBH32s")
_KEY: Final = 32
_SIGNATURE: Final = 64


@dataclass(frozen=True, kw_only=True)
class KeyList:
    """The keys that may sign releases; `revoked` is only for people. Raises KeyFileError for an invalid part."""

    version: int
    keys: frozenset[PublicKey]
    revoked: frozenset[PublicKey] = frozenset()

    def __post_init__(self) -> None:
        if not 1 <= self.version <= LARGEST_VERSION:
            raise KeyFileError(f"key list: version {self.version}: must be in 1..{LARGEST_VERSION}")
        if not 1 <= len(self.keys) <= MAX_KEYS or len(self.revoked) > MAX_KEYS:
            raise KeyFileError(
                f"key list has {len(self.keys)} keys and {len(self.revoked)} revoked keys: must have 1 to "
                f"{MAX_KEYS} keys, and at most {MAX_KEYS} revoked keys"
            )
        if weak := [key.raw.hex() for key in self.keys if signing.is_of_small_order(key.raw)]:
            raise KeyFileError(f"key list: key {weak[0]} is of small order: anyone can sign anything for it")
        if both := self.keys & self.revoked:
            raise KeyFileError(f"key list: key {min(key.fingerprint for key in both)} is allowed and revoked")


def is_list(path: Path) -> bool:
    """Return whether a file begins as a key list does; False if the file cannot be read."""
    with suppress(OSError), path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC
    return False


def encode(listed: KeyList, root: Ed25519PrivateKey) -> bytes:
    """Return the bytes of the list, signed with the root key."""
    allowed, revoked = (sorted(key.raw for key in keys) for keys in (listed.keys, listed.revoked))
    header = _HEADER.pack(_MAGIC, listed.version, len(allowed), len(revoked), 0, signing.public_key(root).raw)
    text = header + b"".join(allowed + revoked)
    return text + root.sign(text)


def signer(raw: bytes) -> PublicKey:
    """Return the root key that signed a list. Raises KeyFileError if there is no valid signature."""
    if raw.startswith(b"{"):
        raise KeyFileError("key list has an old format; make it again with `stillwake bundle keylist`")
    if len(raw) < _HEADER.size + _SIGNATURE or not raw.startswith(_MAGIC):
        raise KeyFileError(f"key list of {len(raw)} bytes has no signature, or does not begin with {_MAGIC.decode()}")
    root = raw[_HEADER.size - _KEY : _HEADER.size]
    if not signing.is_good(raw[-_SIGNATURE:], root, raw[:-_SIGNATURE]):
        raise KeyFileError("key list: the signature does not match the root key: list or signature was altered")
    return PublicKey(root)


def decode(raw: bytes, root: PublicKey) -> KeyList:
    """Decode a list. Raises KeyFileError if the root key did not sign the list, or if the list is damaged."""
    if (found := signer(raw)) != root:
        raise KeyFileError(f"key list is signed by {found.fingerprint}: must be by the root key {root.fingerprint}")
    _, version, allowed, revoked, reserved, _ = _HEADER.unpack_from(raw)
    body = raw[_HEADER.size : -_SIGNATURE]
    if reserved or len(body) != (allowed + revoked) * _KEY:
        sizes = f"{allowed} + {revoked} keys in {len(body)} bytes; reserved bytes: {reserved}"
        raise KeyFileError(f"key list is damaged ({sizes})")
    keys = [body[at : at + _KEY] for at in range(0, len(body), _KEY)]
    parts = (keys[:allowed], keys[allowed:])
    if any(part != sorted(set(part)) for part in parts):
        raise KeyFileError("key list is damaged (keys must ascend, and each must occur once)")
    allowed_keys, revoked_keys = (frozenset(map(PublicKey, part)) for part in parts)
    return KeyList(version=version, keys=allowed_keys, revoked=revoked_keys)
