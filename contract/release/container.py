"""The two containers of a bundle's files: a directory, and an image for transfers. A boot loader in C can read an image
without a library. A microcontroller has another image (`contract.release.controller_image`).

A bundle may come from anyone. So the readers accept only plain names, follow no links, and limit sizes. An image has

    0   8  "SWIMAGE1"
    8   4  length of the whole image
    12  4  number of files, n
    16     n entries: length of the name (2), length of the file (4), name (UTF-8)
           the files' contents, in the same order, without gaps

Numbers are big-endian. `manifest.json` and `manifest.sig` come first, so that the receiver of an image can check the
manifest before the rest arrives; the other files follow in the order of their names. Equal bundles have equal images.
"""

import errno
import os
import stat
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Final

from contract.errors import BundleContainerError
from contract.printable import is_name, quoted, shown

MAX_FILES: Final = 64
MAX_BYTES: Final = 32 * 2**20
"""Largest size of all files together, in bytes: enough for nearly two hundred controllers of the paper's size."""
MAX_BYTES_OF: Final = {"manifest.json": 2**20, "manifest.sig": 2**12}
"""Largest sizes, in bytes, of the first files of an image, which are read before the signature is verified."""
_MAGIC: Final = b"SWIMAGE1"
_HEADER: Final = struct.Struct(">8sII")
_ENTRY: Final = struct.Struct(">HI")


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
                content = file.read(min(limit, left) + 1)  # a sparse file can have more bytes than the memory
            if len(content) > limit:
                raise BundleContainerError(f"bundle {path}: {item.name} is too large: must have at most {limit} bytes")
            left -= len(content)
            if left < 0 or len(found) == MAX_FILES:
                raise BundleContainerError(f"bundle {path}: has more than {MAX_FILES} files or {MAX_BYTES} bytes")
            found[item.name] = content
    return found


def _open_plain(path: Path, name: str) -> IO[bytes]:
    """Open a file that was listed as a plain file, and check the open file. No link is followed; no pipe blocks."""
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


def image_of(files: Mapping[str, bytes]) -> bytes:
    """Build the image of a bundle's files; raises BundleContainerError for too many files or bytes."""
    if len(files) > MAX_FILES or sum(map(len, files.values())) > MAX_BYTES:
        raise BundleContainerError(f"the image has more than {MAX_FILES} files or {MAX_BYTES} bytes")
    names = sorted(files, key=lambda name: (name not in MAX_BYTES_OF, name))
    entries = b"".join(_ENTRY.pack(len(name.encode()), len(files[name])) + name.encode() for name in names)
    contents = b"".join(files[name] for name in names)
    return _HEADER.pack(_MAGIC, _HEADER.size + len(entries) + len(contents), len(names)) + entries + contents


def files_of(image: bytes) -> dict[str, bytes]:
    """Return an image's files by name. Raises BundleContainerError for anything but an image of plain files."""
    if len(image) < _HEADER.size:
        raise BundleContainerError(f"the image has {len(image)} bytes: must have {_HEADER.size} or more")
    magic, length, count = _HEADER.unpack_from(image)
    if magic != _MAGIC:
        raise BundleContainerError(f"image begins with {magic.hex()}: must begin with {_MAGIC.hex()}")
    if length != len(image):
        raise BundleContainerError(f"the image has {len(image)} bytes, but states a length of {length}")
    if count > MAX_FILES:
        raise BundleContainerError(f"the image has {count} files: must have at most {MAX_FILES}")
    sizes, at = dict[str, int](), _HEADER.size
    for _ in range(count):
        if at + _ENTRY.size > length:
            raise BundleContainerError("image ends within its list of files")
        name_length, size = _ENTRY.unpack_from(image, at)
        at += _ENTRY.size
        try:
            name = image[at : at + name_length].decode()
        except UnicodeDecodeError as error:
            raise BundleContainerError("image: a file's name is not UTF-8") from error
        if len(name.encode()) != name_length or not is_plain_name(name) or name in sizes:
            raise BundleContainerError(f"image: {quoted(name)} must be a plain file name, and must occur once")
        sizes[name] = size
        at += name_length
    if (end := at + sum(sizes.values())) != length:
        raise BundleContainerError(f"the image has {length} bytes, but its files end at {end}")
    found = {}
    for name, size in sizes.items():
        found[name] = image[at : at + size]
        at += size
    return found
