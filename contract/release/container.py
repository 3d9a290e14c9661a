"""A reader and a writer of a bundle's directory. The reader limits sizes; the writer writes all files or none.

A bundle may come from anyone. So the reader accepts only plain names, follows no links, and limits sizes.

For transfer, a bundle is packed into an image (`contract.release.image`, `contract.release.controller_image`).
"""

import errno
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Final

from contract.atomic import replacing
from contract.errors import BundleContainerError
from contract.printable import is_name, quoted, shown

MAX_FILES: Final = 64
MAX_BYTES: Final = 32 * 2**20
"""Largest size of all files together, in bytes: enough for nearly two hundred controllers of the paper's size."""
MAX_BYTES_OF: Final = {"manifest.json": 2**20, "manifest.sig": 2**12}
"""Largest sizes, in bytes, of the files that are read before a signature has been verified."""

_CHUNK: Final = 2**20


def is_plain_name(name: str) -> bool:
    """Return whether the name is a file name, not a path, and consists of printable characters."""
    return is_name(name) and name not in (".", "..") and not any(character in name for character in "/\\:")


def read_files(path: Path) -> dict[str, bytes]:
    """Read all files of a bundle by name. Raises BundleContainerError if the path is no directory, if the files are too
    large, or if the directory contains anything but plain files; the message states the entry."""
    try:
        if path.is_dir():
            return _collect(path)
        if path.is_file():
            with path.open("rb") as file:
                # Up to version 1.0.0 a bundle could be a zip file, so the message for a zip file contains a hint.
                is_zip = file.read(4) == b"PK\x03\x04"
            hint = f"; unpack it: python -m zipfile -e {path} FOLDER" if is_zip else ""
            raise BundleContainerError(f"bundle {path}: must be a directory{hint}")
    except OSError as error:
        raise BundleContainerError(f"bundle {path}: cannot be read ({error.strerror or shown(error)})") from error
    raise BundleContainerError(f"bundle {path}: no such directory")


def write_files(path: Path, contents: Mapping[str, bytes]) -> None:
    """Write a directory, replacing an existing directory. Raises StillwakeError if the directory cannot be written."""
    with replacing(path) as temporary:
        temporary.mkdir()
        for name, data in contents.items():
            (temporary / name).write_bytes(data)


def _collect(path: Path) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    left = MAX_BYTES
    # `iterdir` would list a directory with millions of entries before the first entry is counted.
    with os.scandir(path) as items:
        for item in items:
            trouble = None
            if not is_plain_name(item.name):
                trouble = "is not a plain name"
            elif item.is_symlink():
                trouble = "is a symbolic link"
            elif not item.is_file(follow_symlinks=False):
                trouble = "is not a plain file"
            if trouble is not None:
                raise BundleContainerError(f"bundle {path}: {quoted(item.name)} {trouble}: must be a plain file")
            limit = MAX_BYTES_OF.get(item.name, MAX_BYTES)
            with _open_plain(path, item.name) as file:
                content = _read_at_most(file, min(limit, left) + 1)
            if len(content) > limit:
                raise BundleContainerError(f"bundle {path}: {item.name} is too large: at most {limit} bytes")
            left -= len(content)
            if left < 0 or len(found) == MAX_FILES:
                raise BundleContainerError(f"bundle {path}: more than {MAX_FILES} files or {MAX_BYTES} bytes")
            found[item.name] = content
    return found


def _open_plain(path: Path, name: str) -> IO[bytes]:
    """Open a file that was listed as plain, and check it again. Links are not followed; pipes do not block."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    try:
        file = os.fdopen(os.open(path / name, flags), "rb")
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise BundleContainerError(f"bundle {path}: {name!r} is a symbolic link: must be a plain file") from error
        raise
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise BundleContainerError(f"bundle {path}: {name!r} is not a plain file: must be a plain file")
    return file


def _read_at_most(file: IO[bytes], most: int) -> bytes:
    """Read up to `most` bytes in pieces, because a sparse file can state a size that exceeds the memory."""
    pieces: list[bytes] = []
    while most > 0 and (piece := file.read(min(most, _CHUNK))):
        pieces.append(piece)
        most -= len(piece)
    return pieces[0] if len(pieces) == 1 else b"".join(pieces)
