"""The files of a bundle in a directory or a zip: read with suspicion, written whole or not at all.

What is read may come from anyone. So names are plain, nothing is followed or unpacked to disk, and sizes are bounded
before a byte is read.
"""

import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from contract.atomic import replacing
from contract.errors import BundleContainerError

MAX_FILES: Final = 64
MAX_BYTES: Final = 64 * 2**20
"""Of all files together: several hundred controllers of the paper's size."""
MAX_BYTES_OF: Final = {"manifest.json": 2**20, "manifest.sig": 2**12}
"""Of files that are read before anything vouches for them."""

_PLAIN_METHODS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def is_plain_name(name: str) -> bool:
    """Whether this names a file and no path."""
    return name not in ("", ".", "..") and not any(character in name for character in "/\\:\0")


def read_files(path: Path) -> dict[str, bytes]:
    """All files of a bundle by name.

    Raises:
        BundleContainerError: it is neither directory nor whole zip, it is too large, or it holds something else than
            plain files of different names; the message names the entry.
    """
    try:
        if path.is_dir():
            return _collect(path, _directory(path))
        if path.is_file():
            with zipfile.ZipFile(path) as archive:
                return _collect(path, _archive(archive))
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, ValueError) as error:
        raise BundleContainerError(f"bundle {path}: cannot be read: truncated, damaged or no zip ({error})") from error
    except OSError as error:
        raise BundleContainerError(f"bundle {path}: cannot be read ({error})") from error
    raise BundleContainerError(f"bundle {path}: no such directory or zip")


def write_files(path: Path, contents: Mapping[str, bytes]) -> None:
    """Write a directory, or a zip if the path ends in .zip, in place of what is there.

    Raises StillwakeError if the place cannot be written.
    """
    with replacing(path) as temporary:
        if path.suffix == ".zip":
            with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
                for name, data in sorted(contents.items()):
                    # A fixed date keeps equal bundles equal byte for byte.
                    archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)
        else:
            temporary.mkdir()
            for name, data in contents.items():
                (temporary / name).write_bytes(data)


class _Entry(NamedTuple):
    """A file that was not read yet; `trouble` is the reason why it must not be."""

    name: str
    size: int
    trouble: str | None
    read: Callable[[], bytes]


def _directory(path: Path) -> Iterator[_Entry]:
    for item in path.iterdir():
        trouble = None
        if item.is_symlink():
            trouble = "is a symbolic link"
        elif not item.is_file():
            trouble = "is not a plain file"
        yield _Entry(item.name, item.lstat().st_size, trouble, item.read_bytes)


def _archive(archive: zipfile.ZipFile) -> Iterator[_Entry]:
    for info in archive.infolist():
        kind = stat.S_IFMT(info.external_attr >> 16)
        trouble = None
        # The library cuts a name at a zero byte and may take another one from an extra field: judge the stored one.
        if not is_plain_name(info.orig_filename) or info.filename != info.orig_filename:
            trouble = "is a path"
        elif kind == stat.S_IFLNK:
            trouble = "is a symbolic link"
        elif kind not in (0, stat.S_IFREG):
            trouble = "is not a plain file"
        elif info.compress_type not in _PLAIN_METHODS:
            trouble = f"is compressed by method {info.compress_type}"
        yield _Entry(info.orig_filename, info.file_size, trouble, partial(archive.read, info))


def _collect(path: Path, entries: Iterator[_Entry]) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    total = 0
    for entry in entries:
        limit = MAX_BYTES_OF.get(entry.name, MAX_BYTES)
        total += entry.size
        if entry.trouble is not None:
            raise BundleContainerError(f"bundle {path}: {entry.name!r} {entry.trouble}: must be a plain file")
        if entry.name in found:
            raise BundleContainerError(f"bundle {path}: {entry.name} is there twice")
        if entry.size > limit:
            raise BundleContainerError(f"bundle {path}: {entry.name} has {entry.size} bytes: at most {limit}")
        if total > MAX_BYTES or len(found) == MAX_FILES:
            raise BundleContainerError(f"bundle {path}: more than {MAX_FILES} files or {MAX_BYTES} bytes")
        found[entry.name] = entry.read()
    return found
