"""The Ed25519 signatures (RFC 8032) of release manifests. Keys are PEM files; `manifest.sig` is a text file.

A signature covers the bytes of the manifest, so that nothing has to be parsed before the signature is verified. The
signature has its own file, together with the public key of its claimed signer:

    stillwake-signature/1
    key <32 bytes in hex>
    signature <64 bytes in hex>

The key in the file is no proof: it states only who claims to have signed. A reader must know a trusted key from another
source, and trusts only signatures by this key.
"""

import hashlib
import os
import re
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Final

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from contract.errors import KeyFileError

PRIVATE_KEY: Final = "release.key"
PUBLIC_KEY: Final = "release.pub"
_TEXT: Final = re.compile(rb"stillwake-signature/1\nkey ([0-9a-f]{64})\nsignature ([0-9a-f]{128})\n")
_SMALL_ORDER: Final = frozenset(
    bytes.fromhex(key)
    for key in (
        "00" * 32,
        "01" + "00" * 31,
        "26e8958fc2b227b045c3f489f2ef98f0d5dfac05d3c63339b13802886d53fc05",
        "c7176a703d4dd84fba3c0b760d10670f2a2053fa2c39ccc64ec7fd7792ac037a",
        "ec" + "ff" * 30 + "7f",
        "ed" + "ff" * 30 + "7f",
        "ee" + "ff" * 30 + "7f",
    )
)
"""The y coordinates of the points of small order; the last two are not reduced modulo p. Anyone can make a valid
signature for such a key, so these keys are refused (RFC 8032, section 8.8; the list is from libsodium)."""


@dataclass(frozen=True)
class PublicKey:
    """An Ed25519 public key, 32 bytes."""

    raw: bytes

    @property
    def fingerprint(self) -> str:
        """First 16 bytes of the key's SHA-256, in hex. People compare these bytes; programs compare whole keys."""
        return hashlib.sha256(self.raw).hexdigest()[:32]


def sign(key: Ed25519PrivateKey, data: bytes) -> bytes:
    """Return the content of the signature file for these bytes."""
    return f"stillwake-signature/1\nkey {public_key(key).raw.hex()}\nsignature {key.sign(data).hex()}\n".encode()


def signer(signature: bytes, data: bytes) -> PublicKey | None:
    """Check a signature file against the signed bytes. Returns the key in the file; None if the signature was not made
    with this key. Raises ValueError if the file does not have the form of `manifest.sig`."""
    match = _TEXT.fullmatch(signature)
    if match is None:
        raise ValueError("it does not have the form of stillwake-signature/1")
    raw, value = (bytes.fromhex(part.decode()) for part in match.groups())
    return PublicKey(raw) if is_good(value, raw, data) else None


def is_good(signature: bytes, key: bytes, data: bytes) -> bool:
    """Return whether a signature of 64 bytes is valid for the key and the data; False for every key of small order."""
    try:
        Ed25519PublicKey.from_public_bytes(key).verify(signature, data)
    except (InvalidSignature, ValueError):
        return False
    return not is_of_small_order(key)


def public_key(key: Ed25519PrivateKey) -> PublicKey:
    """Return the public key that belongs to a private key."""
    return PublicKey(key.public_key().public_bytes_raw())


def write_key_pair(folder: Path, key: Ed25519PrivateKey) -> PublicKey:
    """Write `release.key` (PKCS #8, readable only by its owner) and `release.pub` into a folder, which is created if
    needed. Raises KeyFileError if one of the files exists, or the folder cannot be written."""
    secret = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    public = key.public_key().public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo)
    written: list[Path] = []
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content, mode in ((PRIVATE_KEY, secret, 0o600), (PUBLIC_KEY, public, 0o644)):
            # The file is created exclusively and with its final mode, so that other users can never read the key.
            with os.fdopen(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
                written.append(folder / name)
                file.write(content)
    except BaseException as error:  # also for a stop signal: one file alone would block every later call
        for path in written:
            path.unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        if isinstance(error, FileExistsError):
            raise KeyFileError(f"{error.filename or folder}: exists already; keys are never overwritten") from error
        if is_new:
            with suppress(OSError):
                folder.rmdir()
        raise KeyFileError(f"cannot write keys into {folder}: {error.strerror or error}") from error
    return public_key(key)


def read_private_key(path: Path) -> Ed25519PrivateKey:
    """Read a private key. Raises KeyFileError if the file is missing, encrypted, or no Ed25519 private key in PEM."""
    try:
        key = serialization.load_pem_private_key(_read(path), password=None)
    except TypeError as error:
        raise KeyFileError(f"key {path}: is encrypted; must be a PEM file without a passphrase") from error
    except (ValueError, UnsupportedAlgorithm) as error:
        raise KeyFileError(f"key {path}: is not a private key in PEM") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise KeyFileError(f"key {path}: must be an Ed25519 key")
    return key


def read_public_key(path: Path) -> PublicKey:
    """Read a public key. Raises KeyFileError if the file is missing or not an Ed25519 public key in PEM."""
    return _parse_public(str(path), _read(path))


def project_key() -> PublicKey:
    """Return the key with which the shipped bundle is signed."""
    return _parse_public(f"contract/release/{PUBLIC_KEY}", files("contract.release").joinpath(PUBLIC_KEY).read_bytes())


def _parse_public(name: str, content: bytes) -> PublicKey:
    try:
        key = serialization.load_pem_public_key(content)
    except (ValueError, UnsupportedAlgorithm) as error:
        raise KeyFileError(f"key {name}: is not a public key in PEM") from error
    if not isinstance(key, Ed25519PublicKey):
        raise KeyFileError(f"key {name}: must be an Ed25519 key")
    if is_of_small_order(key.public_bytes_raw()):
        raise KeyFileError(f"key {name}: is of small order: anyone can sign anything for it")
    return PublicKey(key.public_bytes_raw())


def is_of_small_order(raw: bytes) -> bool:
    """Return whether a key is a point of small order; the sign bit of x is ignored."""
    return bytes([*raw[:31], raw[31] & 0x7F]) in _SMALL_ORDER


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise KeyFileError(f"key {path}: {error.strerror or error}") from error
