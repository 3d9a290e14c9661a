"""Which keys may sign releases for an ECU: a list with a version, signed by a root key that signs nothing else.

A release key that leaks is taken off the list; the root key, which is needed once in years, can stay in a safe. An ECU
knows its root key from production on. It takes a list only if the root key signed it and its version is greater than
that of the list it has, so that an old list cannot bring a revoked key back.
"""

import re
from dataclasses import dataclass
from typing import Final

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.errors import KeyFileError
from contract.printable import quoted, shown
from contract.release import signing, strict_json
from contract.release.signing import PublicKey

SCHEMA: Final = "stillwake-keys/1"
LARGEST_VERSION: Final = 2**32 - 1
MAX_KEYS: Final = 16
_FIELDS: Final = ["keys", "revoked", "schema", "version"]
_KEY: Final = re.compile("[0-9a-f]{64}")


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


def encode(listed: KeyList, root: Ed25519PrivateKey) -> bytes:
    """The signed list: JSON, then the signature as in `manifest.sig`."""
    body = {
        "schema": SCHEMA,
        "version": listed.version,
        "keys": sorted(key.raw.hex() for key in listed.keys),
        "revoked": sorted(key.raw.hex() for key in listed.revoked),
    }
    text = strict_json.encode(body)
    return text + signing.sign(root, text)


def signer(raw: bytes) -> PublicKey:
    """Who signed a list; raises KeyFileError if no one did."""
    text, signature = raw[: -signing.SIGNATURE_LENGTH], raw[-signing.SIGNATURE_LENGTH :]
    try:
        found = signing.signer(signature, text)
    except ValueError as error:
        raise KeyFileError(f"key list: has no signature ({error})") from error
    if found is None:
        raise KeyFileError("key list: the signature is not its signer's: list or signature was altered")
    return found


def decode(raw: bytes, root: PublicKey) -> KeyList:
    """A list that the root key signed.

    Raises:
        KeyFileError: another key signed it, or no one did, or it is damaged.
    """
    if (found := signer(raw)) != root:
        raise KeyFileError(f"key list: signed by key {found.fingerprint}, must be by the root key {root.fingerprint}")
    try:
        body = strict_json.decode(raw[: -signing.SIGNATURE_LENGTH])
        if sorted(body) != _FIELDS:
            raise ValueError("must have keys, revoked, schema and version, and nothing else")
        if body["schema"] != SCHEMA:
            raise ValueError(f"schema {quoted(body['schema'])}, this version reads {SCHEMA!r}")
        version = body["version"]
        if type(version) is not int:
            raise ValueError(f"version {quoted(version)} must be a whole number")
        return KeyList(version=version, keys=_keys(body["keys"]), revoked=_keys(body["revoked"]))
    except ValueError as error:
        raise KeyFileError(f"key list: is damaged ({shown(error)})") from error


def _keys(texts: object) -> frozenset[PublicKey]:
    if not isinstance(texts, list) or not all(isinstance(text, str) and _KEY.fullmatch(text) for text in texts):
        raise ValueError("keys must be a list of texts of 64 hex digits")
    if len(set(texts)) != len(texts):
        raise ValueError("a key is there twice")
    return frozenset(PublicKey(bytes.fromhex(text)) for text in texts)
