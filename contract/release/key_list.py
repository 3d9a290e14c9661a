"""Which keys may sign releases for an ECU: a list with a version, signed by a root key that signs nothing else.

A release key that leaks is taken off the list; the root key, which is needed once in years, can stay in a safe. An ECU
knows its root key from production on. It takes a list only if the root key signed it and its version is greater than
that of the list it has, so that an old list cannot bring a revoked key back.

    0   8   "SWKEYS01"
    8   4   version
    12  1   number of keys, n
    13  1   number of revoked keys, m
    14  2   zeros
    16  32  root key
    48      the n keys of 32 bytes, ascending, then the m revoked ones, ascending
        64  Ed25519 signature of all before it by the root key

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
_MAGIC: Final = b"SWKEYS01"
_HEADER: Final = struct.Struct(">8sIBBH32s")
_KEY: Final = 32
_SIGNATURE: Final = 64


@dataclass(frozen=True, kw_only=True)
class KeyList:
    """Raises KeyFileError for a version or a number of keys out of range.

    Attributes:
        version: of the list; a greater one replaces it.
        keys: that may sign releases, by their bytes.
        revoked: that must not any more. A key that is on neither list may not either; this one is for people to see.
    """

    version: int
    keys: frozenset[PublicKey]
    revoked: frozenset[PublicKey] = frozenset()

    def __post_init__(self) -> None:
        if not 1 <= self.version <= LARGEST_VERSION:
            raise KeyFileError(f"key list: version {self.version}: must be in 1..{LARGEST_VERSION}")
        if not 1 <= len(self.keys) <= MAX_KEYS or len(self.revoked) > MAX_KEYS:
            raise KeyFileError(
                f"key list: {len(self.keys)} keys and {len(self.revoked)} revoked: must be 1 to {MAX_KEYS} and at most "
                f"{MAX_KEYS}"
            )
        if weak := [key.raw.hex() for key in self.keys if signing.is_of_small_order(key.raw)]:
            raise KeyFileError(f"key list: key {weak[0]} is of small order: anyone can sign anything for it")
        if both := self.keys & self.revoked:
            raise KeyFileError(f"key list: key {min(key.fingerprint for key in both)} is allowed and revoked")


def is_list(path: Path) -> bool:
    """Whether a file begins as a list does; False where it cannot be read."""
    with suppress(OSError), path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC
    return False


def encode(listed: KeyList, root: Ed25519PrivateKey) -> bytes:
    """The signed list."""
    allowed, revoked = (sorted(key.raw for key in keys) for keys in (listed.keys, listed.revoked))
    header = _HEADER.pack(_MAGIC, listed.version, len(allowed), len(revoked), 0, signing.public_key(root).raw)
    text = header + b"".join(allowed + revoked)
    return text + root.sign(text)


def signer(raw: bytes) -> PublicKey:
    """The root key that signed a list; raises KeyFileError if none did."""
    if raw.startswith(b"{"):
        raise KeyFileError("key list: is of an older version; make it again with `stillwake bundle keylist`")
    if len(raw) < _HEADER.size + _SIGNATURE or not raw.startswith(_MAGIC):
        raise KeyFileError(f"key list: {len(raw)} bytes: has no signature, or does not begin with {_MAGIC.decode()}")
    root = raw[_HEADER.size - _KEY : _HEADER.size]
    if not signing.is_good(raw[-_SIGNATURE:], root, raw[:-_SIGNATURE]):
        raise KeyFileError("key list: the signature is not its root key's: list or signature was altered")
    return PublicKey(root)


def decode(raw: bytes, root: PublicKey) -> KeyList:
    """A list that the root key signed.

    Raises:
        KeyFileError: another key signed it, or no one did, or it is damaged.
    """
    if (found := signer(raw)) != root:
        raise KeyFileError(f"key list: signed by key {found.fingerprint}, must be by the root key {root.fingerprint}")
    _, version, allowed, revoked, reserved, _ = _HEADER.unpack_from(raw)
    body = raw[_HEADER.size : -_SIGNATURE]
    if reserved or len(body) != (allowed + revoked) * _KEY:
        raise KeyFileError(
            f"key list: is damaged ({len(body)} bytes of {allowed} + {revoked} keys, {reserved} reserved)"
        )
    keys = [body[at : at + _KEY] for at in range(0, len(body), _KEY)]
    for part in (keys[:allowed], keys[allowed:]):
        if part != sorted(set(part)):
            raise KeyFileError("key list: is damaged (keys must ascend, each once)")
    allowed_keys, revoked_keys = (frozenset(map(PublicKey, part)) for part in (keys[:allowed], keys[allowed:]))
    return KeyList(version=version, keys=allowed_keys, revoked=revoked_keys)
