"""The key that the nodes of a bus share, and its file."""

import os
import stat
from pathlib import Path
from typing import ClassVar, Final

from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

from contract.errors import KeyFileError
from contract.runtime.copies import NeverCopied

KEY_LENGTH: Final = 16
"""Bytes: AES-128."""

_LONGEST: Final = 2 * KEY_LENGTH + 2
"""Bytes of a key file: hexadecimal digits and the end of a line."""


class Key(NeverCopied):
    """A 128-bit key, prepared for use. It shows itself nowhere: not when printed, and it cannot be pickled. Raises
    ValueError for another length, or a key of zeros, which is an empty memory's."""

    INSTEAD: ClassVar = "a key shows itself nowhere; make another one of the same secret"

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_LENGTH:
            raise ValueError(f"a key of {len(secret)} bytes: must have {KEY_LENGTH}")
        if not any(secret):
            raise ValueError("a key of zeros: must be a random one")
        # Copies of a prepared one are four times as fast as one made for each frame.
        self._prepared = CMAC(AES(secret))

    def cmac(self, message: bytes) -> bytes:
        """AES-CMAC of a message, 16 bytes (NIST SP 800-38B, RFC 4493)."""
        computing = self._prepared.copy()
        computing.update(message)
        return computing.finalize()


def read_key(path: Path) -> Key:
    """The key in a file; raises as `read_secret`."""
    return Key(read_secret(path))


def read_secret(path: Path) -> bytes:
    """The key in a file, to be built into a firmware: 16 bytes, or 32 hexadecimal digits and perhaps the end of a line.
    Raises KeyFileError: no such file, other contents, a key of zeros, or one that others than its owner may read."""
    try:
        with open(path, "rb", opener=_open_without_waiting) as file:
            about = os.fstat(file.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise KeyFileError(f"{path}: no key file; must be a regular file")
            content = file.read(_LONGEST + 1)
    except OSError as error:
        raise KeyFileError(f"{path}: cannot read the key ({error.strerror or error})") from error
    if os.name == "posix" and about.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise KeyFileError(f"{path}: others than its owner have access to the key; put it right with `chmod 600`")
    try:
        secret = _decoded(content)
        Key(secret)
        return secret
    except ValueError as error:
        # What is in the file stays out of the message.
        raise KeyFileError(f"{path}: {error}; `stillwake keygen --secret` makes a key file") from None


def write_key(path: Path, secret: bytes) -> None:
    """Write a key as hexadecimal digits, for its owner alone. Raises KeyFileError if there is a file already, or none
    can be written; ValueError for what is no key."""
    Key(secret)
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError as error:
        raise KeyFileError(f"{path}: exists already; a key is never overwritten") from error
    except OSError as error:
        raise KeyFileError(f"{path}: cannot write the key ({error.strerror or error})") from error
    try:
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            file.write(secret.hex() + "\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        path.unlink(missing_ok=True)
        raise KeyFileError(f"{path}: cannot write the key ({error.strerror or error})") from error


def _open_without_waiting(path: str, flags: int) -> int:
    # A named pipe without a writer would keep a reader waiting for ever.
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _decoded(content: bytes) -> bytes:
    """Raises ValueError, without the content."""
    if len(content) == KEY_LENGTH:
        return content
    try:
        digits = content.decode("ascii").removesuffix("\n").removesuffix("\r")
        if len(digits) == 2 * KEY_LENGTH and digits.isalnum():
            return bytes.fromhex(digits)
    except ValueError:
        pass
    raise ValueError(f"not a key; must have {KEY_LENGTH} bytes, or {2 * KEY_LENGTH} hexadecimal digits")
