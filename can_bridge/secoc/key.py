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
"""Length of a key, in bytes: AES-128."""


class Key(NeverCopied):
    """A 128-bit key, never printed or pickled. Raises ValueError unless the secret has 16 bytes, not all zero."""

    INSTEAD: ClassVar = "a key is never shown; make another key of the same secret"

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_LENGTH:
            raise ValueError(f"a key of {len(secret)} bytes is invalid: must have {KEY_LENGTH}")
        if not any(secret):
            raise ValueError("a key of zeros is invalid: must be random")
        # Copying a prepared object for each frame is four times as fast as preparing a new object.
        self._prepared = CMAC(AES(secret))

    def cmac(self, message: bytes) -> bytes:
        """Return the AES-CMAC of a message, 16 bytes (NIST SP 800-38B, RFC 4493)."""
        computing = self._prepared.copy()
        computing.update(message)
        return computing.finalize()


def read_key(path: Path) -> Key:
    """Read the key in a file. Raises KeyFileError like `read_secret`."""
    return Key(read_secret(path))


def read_secret(path: Path) -> bytes:
    """Read the bytes of the key in a file: 16 bytes, or 32 hexadecimal digits with an optional end of line. Raises
    KeyFileError if the file is missing, has other contents, or can be accessed by users other than its owner."""
    try:
        # Without O_NONBLOCK, opening a named pipe without a writer would block for ever.
        with open(path, "rb", opener=lambda name, flags: os.open(name, flags | getattr(os, "O_NONBLOCK", 0))) as file:
            about = os.fstat(file.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise KeyFileError(f"{path}: not a key file; must be a regular file")
            content = file.read(2 * KEY_LENGTH + 3)  # a byte more than hexadecimal digits and the end of a line
    except OSError as error:
        raise KeyFileError(f"{path}: cannot read the key ({error.strerror or error})") from error
    if os.name == "posix" and about.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise KeyFileError(f"{path}: other users have access to the key; correct this with `chmod 600`")
    try:
        secret = _decoded(content)
        Key(secret)
        return secret
    except ValueError as error:
        # The message must not show the content of the file.
        raise KeyFileError(f"{path}: {error}; `stillwake keygen --secret` makes a key file") from None


def write_key(path: Path, secret: bytes) -> None:
    """Write a key as hexadecimal digits, readable by its owner alone. Raises KeyFileError if the file exists or cannot
    be written; ValueError for bytes that are not a key."""
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
    except BaseException as error:
        path.unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        raise KeyFileError(f"{path}: cannot write the key ({error.strerror or error})") from error


def _decoded(content: bytes) -> bytes:
    """Decode a key. Raises a ValueError that does not show the content."""
    if len(content) == KEY_LENGTH:
        return content
    try:
        digits = content.decode("ascii").removesuffix("\n").removesuffix("\r")
        if len(digits) == 2 * KEY_LENGTH and digits.isalnum():
            return bytes.fromhex(digits)
    except ValueError:
        pass
    raise ValueError(f"not a key; must have {KEY_LENGTH} bytes, or {2 * KEY_LENGTH} hexadecimal digits")
